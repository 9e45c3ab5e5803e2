"""Parameter estimators, one per file: batch methods have `fit(records) -> Fit`, recursive methods have steps."""
