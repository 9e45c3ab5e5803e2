"""The Python blocks of a page, and the figure of its example."""

import contextlib
import hashlib
import io
import json
import os
import re
import tempfile
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).parents[1]
CACHE = ROOT / ".cache" / "figures"
BLOCK = re.compile(r"^```python\n(.*?)^```", flags=re.MULTILINE | re.DOTALL)
OF = re.compile(r"^<!-- figure: (\w+) -->$", flags=re.MULTILINE)  # the record that is drawn, where it is not the last


class Drawn(NamedTuple):
    """The figure of an example: its number of blocks, what it shows, its height, plotly's JSON, and a small SVG."""

    blocks: int
    caption: str
    height: int
    figure: str
    thumbnail: str


def blocks(text: str) -> list[str]:
    """The Python blocks of a page.

    >>> blocks("Prose.\\n```python\\nx = 1\\n```\\n")
    ['x = 1\\n']
    """
    return BLOCK.findall(text)


def shown_blocks(text: str, *, method: bool) -> list[str]:
    """The blocks up to the last that makes a `figure`; of a page about a method at least the first."""
    found = blocks(text)
    makers = [i for i, block in enumerate(found, start=1) if re.search(r"^figure = ", block, flags=re.MULTILINE)]
    return found[: makers[0] if makers else int(method)]


def drawn(text: str, *, method: bool) -> Drawn | None:
    """The figure of a page, from the cache where neither its example nor the package has changed; None of a page without one."""
    source, record = shown_blocks(text, method=method), OF.search(text)
    if not source:
        return None
    of = record[1] if record else ""
    path = CACHE / f"{_key([of, *source])}.json"
    if path.exists():
        return Drawn(**json.loads(path.read_text()))
    made = _run(source, of)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(made._asdict()))
    return made


def _run(source: list[str], of: str) -> Drawn:
    """Run the blocks in a folder of their own, in silence, and draw what they leave."""
    from . import pictures, thumbnails

    names: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder, _inside(folder), contextlib.redirect_stdout(io.StringIO()):
        for block in source:
            exec(compile(block, "<example>", "exec"), names)
        figure, caption = pictures.picture(names, of)
    height = pictures.height_of(figure)
    return Drawn(len(source), caption, height, pictures.json_of(figure), thumbnails.svg(figure))


@contextlib.contextmanager
def _inside(folder: str):
    here = os.getcwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(here)


def _key(source: list[str]) -> str:
    return hashlib.sha256("\0".join([_package(), *source]).encode()).hexdigest()[:32]


@cache
def _package() -> str:
    """A hash of everything that draws: the package, and this folder."""
    files = sorted([*(ROOT / "src").rglob("*.py"), *Path(__file__).parent.glob("*.py")])
    return hashlib.sha256(b"\0".join(path.read_bytes() for path in files)).hexdigest()
