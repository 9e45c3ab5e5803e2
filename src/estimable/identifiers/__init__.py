"""Parameter estimators, one a file: `fit(record) -> Fit` for those that take a record at once, steps for the recursive."""
