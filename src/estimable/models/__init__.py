"""What is known before any data: models, priors, noise, and their files."""
