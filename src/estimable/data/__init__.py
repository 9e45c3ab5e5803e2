"""Records of measurements, and the files they come from."""
