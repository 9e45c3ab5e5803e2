"""The drivers of identifiers: identify, compare methods, choose orders."""
