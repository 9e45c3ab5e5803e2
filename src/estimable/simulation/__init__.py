"""The drivers of plants: drawn records, closed loops, and many repetitions of both."""
