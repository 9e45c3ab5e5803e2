"""Models, priors, noise, and their files: what is known before any data."""
