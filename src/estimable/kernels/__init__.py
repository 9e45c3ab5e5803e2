"""Array mathematics only: pure functions of arrays, in the letters of the paper each one cites."""
