"""The drivers of filters: over a record, many at once, sample by sample, backwards, ahead; and the tuning of noises."""
