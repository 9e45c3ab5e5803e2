"""The events of mkdocs: figures under the examples, formulas, the list of methods, the API reference.

`ESTIMABLE_DOCS_FIGURES=0` in the environment leaves the figures out; the build then takes seconds.
"""

import os
import re
import sys
from html import escape
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

sys.path.insert(0, str(Path(__file__).parents[1]))  # mkdocs puts it back
from docs_build import examples, mathematics, methods, reference

FIGURES = os.environ.get("ESTIMABLE_DOCS_FIGURES", "1") != "0"
API = re.compile(r"^<!-- api: (\w+) -->$", flags=re.MULTILINE)
LIST = "<!-- methods -->"


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the one script that draws."""
    if FIGURES:
        from plotly.offline import get_plotlyjs

        files.append(File.generated(config, "assets/plotly.min.js", content=get_plotlyjs()))
    return files


def on_page_markdown(markdown: str, *, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Fill in the lists, and a figure under its example."""
    markdown = API.sub(lambda found: reference.directives(found[1]), markdown)
    if LIST in markdown:
        markdown = markdown.replace(LIST, methods.listed(config, _drawn if FIGURES else None))
    return _with_figure(markdown, page) if FIGURES else markdown


def on_page_content(html: str, **_: Any) -> str:
    """Turn formulas into MathML."""
    return mathematics.with_mathematics(html)


def on_post_page(output: str, *, page: Page, **_: Any) -> str:
    """Load the script on pages that have a figure."""
    if 'class="drawn"' not in output:
        return output
    up = "../" * page.url.count("/")
    scripts = "".join(f'<script src="{up}assets/{name}" defer></script>' for name in ("plotly.min.js", "figures.js"))
    return output.replace("</body>", f"{scripts}</body>")


def _drawn(source: str, text: str) -> examples.Drawn | None:
    """The figure of a page; a page about a method has one."""
    try:
        return examples.drawn(text, method=methods.is_method(source))
    except Exception as error:
        raise PluginError(f"{source}: its example has no figure: {type(error).__name__}: {error}") from error


def _with_figure(markdown: str, page: Page) -> str:
    found = _drawn(page.file.src_uri, markdown)
    if found is None:
        return markdown
    block = list(examples.BLOCK.finditer(markdown))[found.blocks - 1]
    drawing = (
        f'\n\n<figure class="drawn"><div style="height: {found.height}px"></div>'
        f'<script type="application/json">{found.figure}</script>'
        f"<figcaption>{escape(found.caption)}</figcaption></figure>\n\n"
    )
    return markdown[: block.end()] + drawing + markdown[block.end() :]
