"""The documentation as a site: built without a warning, complete, and whole without a network."""

import doctest
import importlib
import os
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote, urldefrag

import pytest

import estimable

for needed in ("mkdocs", "material", "mkdocstrings_handlers.python", "latex2mathml"):
    pytest.importorskip(needed, reason="the site needs the extra `docs`")

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
METHODS = sorted(path for path in (DOCS / "methods").glob("*.md") if path.name != "index.md")
PARTS = ("**Question it answers.**", "**Model.**", "**Assumptions, and what happens without them.**", "```python")
PARTS += ("How to set it", "How it fails", "**Cost.**", "**References.**", "**Neighbours.**")
LOADED = dict.fromkeys(("script", "img", "iframe", "source", "video", "audio"), "src") | {"link": "href"}


class Parsed(NamedTuple):
    """A page of the site: what it links to, what it loads, the names of its places, and how many formulas it has."""

    links: list[str]
    loads: list[str]
    places: set[str]
    formulas: int


class Reader(HTMLParser):
    def __init__(self):
        super().__init__()
        self.links, self.loads, self.places, self.formulas = [], [], set(), 0

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.places |= {given[name] for name in ("id", "name") if given.get(name)}
        self.formulas += tag == "math"
        if tag == "a" and given.get("href"):
            self.links.append(given["href"])
        if given.get(LOADED.get(tag)):
            self.loads.append(given[LOADED[tag]])


def parsed(path):
    reader = Reader()
    reader.feed(path.read_text())
    return Parsed(reader.links, reader.loads, reader.places, reader.formulas)


def build(folder, figures):
    """Build the site in a process of its own, as a reader does."""
    environment = os.environ | {"PYTHONPATH": str(ROOT / "src"), "ESTIMABLE_DOCS_FIGURES": figures}
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    run = subprocess.run(
        command, cwd=ROOT, env=environment | {"NO_MKDOCS_2_WARNING": "1"}, capture_output=True, text=True
    )
    said = run.stdout + run.stderr
    assert run.returncode == 0, said
    assert "WARNING" not in said
    return folder


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    return build(tmp_path_factory.mktemp("site"), figures="0")


@pytest.fixture(scope="module")
def pages(site):
    """Every page of the site by its path."""
    return {path: parsed(path) for path in sorted(site.rglob("*.html")) if path.name != "404.html"}


def of_the_navigation(nav):
    for item in nav:
        for entry in item.values() if isinstance(item, dict) else [item]:
            yield from [entry] if isinstance(entry, str) else of_the_navigation(entry)


def test_every_page_is_in_the_navigation_once():
    from mkdocs.config import load_config

    listed = list(of_the_navigation(load_config(str(ROOT / "mkdocs.yml")).nav))
    assert sorted(listed) == sorted(str(path.relative_to(DOCS)) for path in DOCS.rglob("*.md"))


def test_the_site_loads_nothing_from_a_host(site, pages):
    assert len(pages) == len(list(DOCS.rglob("*.md")))
    for path, page in pages.items():
        assert page.loads
        foreign = [address for address in page.loads if address.startswith(("http:", "https:", "//"))]
        assert not foreign, path
    for path in site.rglob("*.css"):
        assert "url(http" not in path.read_text()
        assert "@import" not in path.read_text()


def test_every_link_of_the_site_leads_to_a_place(site, pages):
    looked_at = 0
    for path, page in pages.items():
        for address in page.links + page.loads:
            target, place = urldefrag(address)
            if target.startswith(("http:", "https:", "mailto:")):
                continue
            file = (path.parent / unquote(target)).resolve() if target else path
            assert file.exists(), (path.relative_to(site), address)
            if place and file in pages and not place.startswith("__"):
                assert unquote(place) in pages[file].places, (path.relative_to(site), address)
            looked_at += 1
    assert looked_at > 1000


def test_every_method_has_a_page_which_is_on_the_list(site, pages):
    listed = pages[site / "methods" / "index.html"].links
    assert {f"{path.stem}.html" for path in METHODS} <= set(listed)
    catalogue = estimable.catalogue
    for entry in catalogue.ENTRIES + catalogue.IDENTIFIERS:
        assert (DOCS / "methods" / f"{entry.name}.md") in METHODS


def test_the_reference_has_every_public_name(site, pages):
    places = set().union(*(page.places for path, page in pages.items() if path.parent == site / "api"))
    modules = set(estimable.__all__) & {"catalogue", "diagnostics", "packaged", "plants", "report", "results"}
    names = [*(set(estimable.__all__) - modules), *(f"results.{name}" for name in estimable.results.__all__)]
    names += [f"{module}.{name}" for module in ("diagnostics", "report") for name in getattr(estimable, module).__all__]
    assert {f"estimable.{name}" for name in names} <= places


def test_formulas_are_markup_and_no_source_is_left(site, pages):
    assert pages[site / "methods" / "kalman.html"].formulas > 2
    for path in pages:
        assert "arithmatex" not in path.read_text(), path


@pytest.mark.parametrize("page", METHODS, ids=lambda path: path.stem)
def test_a_page_about_a_method_has_its_parts(page):
    text = page.read_text()
    for part in PARTS:
        assert part in text, part


@pytest.mark.slow
@pytest.mark.skipif(os.environ.get("ESTIMABLE_DOCS_FIGURES") != "1", reason="two minutes: set ESTIMABLE_DOCS_FIGURES=1")
def test_the_build_draws_a_figure_for_every_method(tmp_path):
    site = build(tmp_path / "site", figures="1")
    for path in METHODS:
        text = (site / "methods" / f"{path.stem}.html").read_text()
        assert '<figure class="drawn">' in text, path
        assert "../assets/plotly.min.js" in text
    assert (site / "methods" / "index.html").read_text().count('<svg class="thumbnail"') == len(METHODS)
    assert (site / "assets" / "plotly.min.js").stat().st_size > 1e6
    for path in site.rglob("*.html"):
        assert not [one for one in parsed(path).loads if one.startswith("http")], path


@pytest.mark.parametrize("name", ["examples", "mathematics", "methods", "docstrings"])
def test_the_examples_of_the_build_run(name):
    failed, tried = doctest.testmod(importlib.import_module(f"docs_build.{name}"))
    assert tried
    assert failed == 0
