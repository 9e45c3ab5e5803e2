"""The drivers, one verb a file: the only callers of the engines."""
