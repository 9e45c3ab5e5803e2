"""The drivers of filters: run one over a record, many at once, a sample at a time, backwards, ahead; and tune its noises."""
