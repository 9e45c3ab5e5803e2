"""Every example that a reader can copy runs: docstrings, README and docs."""

import doctest
import importlib
import pkgutil
import re
from pathlib import Path

import numpy as np
import pytest
from docs_build.examples import blocks

import estimable

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
FOREIGN = {"from-filterpy.md": "filterpy"}  # pages whose examples run another library
MODULES = sorted(
    m.name for m in pkgutil.walk_packages(estimable.__path__, "estimable.") if m.name != "estimable.__main__"
)


@pytest.mark.parametrize("name", MODULES)
def test_docstring_examples_run(name):
    module = importlib.import_module(name)
    public = {name: getattr(package, name) for package in (estimable, estimable.results) for name in package.__all__}
    names = public | {"np": np, "float64": np.float64} | vars(module)
    finder = doctest.DocTestFinder(exclude_empty=True)
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE)
    for example in finder.find(module, globs=dict(names)):
        runner.run(example)
    assert runner.failures == 0


@pytest.mark.parametrize("page", [p for p in PAGES if blocks(p.read_text())], ids=lambda p: p.name)
def test_every_python_block_of_a_page_runs(page, tmp_path, monkeypatch):
    if page.name in FOREIGN:
        pytest.importorskip(FOREIGN[page.name], reason="it is in the extra `bench`")
    monkeypatch.chdir(tmp_path)
    names = {}
    for block in blocks(page.read_text()):
        exec(compile(block, str(page), "exec"), names)


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_links_between_pages_lead_somewhere(page):
    for target in re.findall(r"\]\((?!https?:)([^)#]+)", page.read_text()):
        assert (page.parent / target).exists(), target


def test_the_readme_shows_the_two_commands():
    text = (ROOT / "README.md").read_text()
    assert "python3 -m venv .venv && .venv/bin/pip install -c requirements.lock . && .venv/bin/estimable demo" in text
    tests = (
        "python3 -m venv .venv && .venv/bin/pip install -c requirements.lock '.[test]' && "
        "PYTEST_ADDOPTS='-n 2' .venv/bin/python -m pytest\n"
    )
    assert tests in text
    assert "pytest$" in (ROOT / ".ci" / "run").read_text()


def test_the_changelog_and_the_citation_are_of_this_version():
    versions = re.findall(r"^## \[([^\]]+)\]", (ROOT / "CHANGELOG.md").read_text(), flags=re.MULTILINE)
    assert versions[0] == estimable.__version__
    assert f"version: {estimable.__version__}\n" in (ROOT / "CITATION.cff").read_text()
    assert f'version = "{estimable.__version__}"' in (ROOT / "pyproject.toml").read_text()
