"""The files of an example: a recorded flight and the model file of its aircraft. `path(name)` gives their paths."""

from importlib.resources import as_file, files
from pathlib import Path


def path(name: str) -> Path:
    """Path of a packaged file: "f16-flight.csv", "f16-model.toml"."""
    with as_file(files(__name__) / name) as found:
        return found
