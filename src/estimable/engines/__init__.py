"""The execution of steps. The engines know nothing about estimation."""
