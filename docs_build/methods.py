"""The list of all methods: a line and a picture each, under the headings of the navigation."""

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig

from .examples import Drawn

FOLDER = "methods/"
QUESTION = re.compile(r"^\*\*Question it answers\.\*\* (.*?)(?:\n\n|\Z)", flags=re.MULTILINE | re.DOTALL)
SENTENCE = re.compile(r"(.+?[.?])(?=\s+[A-Z(]|\s*$)", flags=re.DOTALL)


def is_method(source: str) -> bool:
    """Whether a page is about a method."""
    return source.startswith(FOLDER) and source != f"{FOLDER}index.md"


def title(text: str) -> str:
    """The title of a page."""
    return text.partition("\n")[0].removeprefix("# ")


def question(text: str) -> str:
    """The first question that a page says it answers.

    >>> question("# Kalman\\n\\n**Question it answers.** It moves. Where is\\nit? Now.\\n\\nMore.")
    'Where is it?'
    """
    found = QUESTION.search(text)
    if found is None:
        raise ValueError(f"the page {title(text)!r} has no line **Question it answers.**")
    sentences = SENTENCE.findall(" ".join(found[1].split()))
    return next((one.strip() for one in sentences if one.endswith("?")), sentences[0])


def sections(nav: list[Any], heading: str = "") -> Iterator[tuple[str, list[str]]]:
    """The headings of the navigation, and the pages about methods below each."""
    own = [page for item in nav for page in (item.values() if isinstance(item, dict) else [item])]
    listed = [page for page in own if isinstance(page, str) and is_method(page)]
    if listed:
        yield heading, listed
    for item in nav:
        for name, below in item.items() if isinstance(item, dict) else ():
            if isinstance(below, list):
                yield from sections(below, name)


def listed(config: MkDocsConfig, draw: Callable[[str, str], Drawn | None] | None) -> str:
    """The list as Markdown with a card for each method."""
    parts = []
    for heading, pages in sections(config.nav or []):
        parts += [f"## {heading}", '<div class="methods" markdown>']
        parts += [_card(Path(config.docs_dir), page, draw) for page in pages]
        parts.append("</div>")
    return "\n\n".join(parts)


def _card(folder: Path, page: str, draw: Callable[[str, str], Drawn | None] | None) -> str:
    text = (folder / page).read_text()
    found = draw(page, text) if draw else None
    link = page.removeprefix(FOLDER)
    picture = f"[{found.thumbnail}]({link}){{tabindex=-1}}\n\n" if found else ""
    return f'<div class="method" markdown>\n\n{picture}**[{title(text)}]({link})**\n\n{question(text)}\n\n</div>'
