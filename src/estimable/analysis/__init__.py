"""Model in, verdict out, before any data."""
