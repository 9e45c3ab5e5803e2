"""The drivers of plants: draw records, close loops, and repeat both many times."""
