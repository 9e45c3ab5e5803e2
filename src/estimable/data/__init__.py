"""What was measured: records, and the files they come from."""
