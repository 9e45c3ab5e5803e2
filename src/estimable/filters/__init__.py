"""State estimators, one a file."""
