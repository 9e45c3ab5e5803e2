"""Model and requirement in, gains out."""
