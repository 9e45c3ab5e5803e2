"""How a step is executed. Nothing here knows about estimation."""
