"""The package is built as it says: names, imports one way, sizes, words."""

import ast
import importlib
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from jaxtyping import TypeCheckError

import estimable
from estimable.kernels import small
from slow import SLOW, SLOW_FOLDERS

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "src" / "estimable"
FILES = sorted(SOURCE.rglob("*.py"))
ROOMS = (  # each may know those before it
    ("errors", "annotations", "forks", "frozen", "interpreter", "lazy", "precision", "phrases", "checks", "packaged"),
    ("tables", "writing", "progress"),
    ("cache_folder",),
    ("engines/program",),
    ("engines/disk_cache", "engines/plain_format"),
    ("engines/llvm",),
    ("engines",),
    ("kernels",),
    ("models", "networks"),
    ("data",),
    ("results",),
    ("protocols",),
    ("store",),
    ("diagnostics",),
    ("analysis",),
    ("design",),
    ("filters",),
    ("identifiers",),
    ("controllers",),
    ("estimation",),
    ("identification",),
    ("simulation",),
    ("catalogue", "plants"),
    ("figures",),
    ("report", "reproductions"),
    ("commands",),
    ("__main__",),
)
LAZY = {  # (room, room): imports inside a function that go the other way
    ("results", "figures"),  # .plot()
    ("analysis", "figures"),  # CovarianceAnalysis.plot()
    ("results", "estimation"),  # Estimate.outputs() samples the model of its record
    ("results", "analysis"),  # TransKalman.margin() is the rho_margin of its error
}
LAZY_NAMES = {  # of `results`, from a later room
    "Online",  # it runs engines, and changes
    "CovarianceAnalysis",  # it answers changed questions about its model
}
NAMED = {"": estimable, "results": estimable.results}  # packages that load their names when they are asked for
LEVEL = {room: level for level, rooms in enumerate(ROOMS) for room in rooms}
MODULES = {str(path.relative_to(SOURCE).with_suffix("")).removesuffix("__init__").strip("/"): path for path in FILES}
RUNNERS = {"estimation", "identification", "simulation"}


def room(module):
    """The room of a module, or of a folder of modules."""
    first, *rest = module.split("/")
    return f"{first}/{rest[0]}" if rest and f"{first}/{rest[0]}" in LEVEL else first


@cache
def imported(module):
    """(module, whether the line is inside a function) of every import of ours."""
    return list(_imported(module))


def _imported(module):
    path = MODULES[module]
    tree, folder = ast.parse(path.read_text()), path.relative_to(SOURCE).parts[:-1]
    inside = {id(n) for f in ast.walk(tree) if isinstance(f, ast.FunctionDef) for n in ast.walk(f)}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.level:
            whence = [*folder[: len(folder) - node.level + 1], *(node.module.split(".") if node.module else [])]
            for alias in node.names:
                package = "/".join(whence)
                whole = "/".join([*whence, alias.name])
                homes = NAMED[package]._HOMES if package in NAMED else {}
                home = whole if whole in MODULES else homes.get(alias.name, package).replace(".", "/")
                yield home, id(node) in inside


def test_imports_go_one_way():
    for module in MODULES:
        for other, lazy in imported(module):
            here, there = room(module), room(other)
            if not other or module == "":  # the package itself: its version, its lazy names
                continue
            assert there in LEVEL, f"{other} is no room"
            allowed = LEVEL[there] <= LEVEL[here] or ((here, there) in LAZY and lazy)
            assert allowed, f"{module} may not know {other}"


def test_engines_know_nothing_of_estimation_and_few_rooms_run_them():
    for module in MODULES:
        for other, _ in imported(module):
            if room(module).startswith("engines") and not room(other).startswith("engines"):
                assert other in ("annotations", "forks", "frozen", "checks", "errors", "cache_folder"), (
                    f"{module} may not know {other}"
                )
            if room(other).startswith("engines") and not room(module).startswith("engines"):
                assert room(module) in RUNNERS, f"{module} may not run {other}"


def test_no_files_import_each_other_in_a_circle():
    graph = {module: {other for other, _ in imported(module) if other in MODULES} for module in MODULES if module}
    while free := {module for module, needs in graph.items() if not needs & graph.keys()}:
        graph = {module: needs for module, needs in graph.items() if module not in free}
    assert not graph, f"in circles, or needing one: {sorted(graph)}"


def test_no_two_files_have_one_name():
    names = [path.name for path in FILES if path.name not in ("__init__.py",)]
    assert sorted(set(names)) == sorted(names)


WRITES = re.compile(r"""\.write_(text|bytes|html|image)\(|\.to_parquet\(|shutil\.(copy|move)
                    |open\([^)]*"[wax]|np\.savez?\w*\((?!stream)|to_csv\(\w+,""", re.VERBOSE)  # fmt: skip


def test_files_are_written_in_one_place():
    """`writing.write` writes a file whole or not at all; what a simulator reads in a folder of its own is no user's file."""
    found = {
        (str(path.relative_to(SOURCE)), line.strip())
        for path in FILES
        for line in path.read_text().splitlines()
        if WRITES.search(line)
    }
    assert {file for file, _ in found} == {"writing.py", "plants/jsbsim_f16.py"}


def test_functions_are_compiled_by_forks_jit_which_refuses_in_forked_processes():
    """`kernels/small` names parts of steps, which are traced only."""
    found = {
        str(path.relative_to(SOURCE)) for path in FILES if re.search(r"^(?! *>>>).*jax\.jit\b", path.read_text(), re.M)
    }
    assert found == {"forks.py", "kernels/small.py"}


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(SOURCE)))
def test_files_and_functions_are_short_enough_to_read(path):
    text = path.read_text()
    assert text.count("\n") <= 400
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef):
            docstring = len((ast.get_docstring(node) or "").splitlines())
            assert node.end_lineno - node.lineno - docstring <= 60, node.name


def test_no_two_files_have_a_class_of_one_name():
    homes = {}
    for module, path in MODULES.items():
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.ClassDef):
                homes.setdefault(node.name, []).append(module)
    assert len(homes) > 300
    assert {name: where for name, where in homes.items() if len(where) > 1} == {}


def test_public_names_are_exactly_the_sorted_lists():
    assert estimable.__all__ == sorted(estimable.__all__)
    assert dir(estimable) == sorted(["__version__", *estimable.__all__])
    assert dir(estimable.results) == estimable.results.__all__ == sorted(estimable.results.__all__)
    assert not set(estimable.__all__) & set(estimable.results.__all__)


@pytest.mark.parametrize(("package", "name"), [("estimable", "Kalmann"), ("estimable.results", "Kalman")])
def test_a_name_that_is_not_public_is_no_attribute(package, name):
    with pytest.raises(AttributeError, match=f"module '{package}' has no attribute '{name}'"):
        getattr(importlib.import_module(package), name)


@pytest.mark.parametrize("folder", NAMED)
def test_type_checkers_see_the_names_and_homes_that_python_loads(folder):
    package = NAMED[folder]
    tree = ast.parse((SOURCE / folder / "__init__.pyi").read_text())
    seen = {}
    for node in tree.body:
        for alias in node.names if isinstance(node, ast.ImportFrom) else ():
            whence = package.__name__.split(".")[: 3 - node.level if folder else None]
            home = ".".join([*whence[1:], *(node.module or alias.name).split(".")])
            seen |= {alias.asname: home} if alias.asname == alias.name else {}
    assert seen == package._HOMES
    for name, home in seen.items():
        module = importlib.import_module(f"estimable.{home}")
        assert getattr(package, name) is (module if home == name else getattr(module, name))


def test_results_has_every_record_of_its_room_and_few_of_others():
    """The bases of records have no public name; a record of a later room is named in `LAZY_NAMES`, with the reason."""
    homes = estimable.results._HOMES
    classes = {
        node.name: node.bases
        for module, path in MODULES.items()
        if module.startswith("results/")
        for node in ast.parse(path.read_text()).body
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    }
    bases = {base.id for listed in classes.values() for base in listed if isinstance(base, ast.Name)}
    assert set(classes) - bases == {name for name, home in homes.items() if home.startswith("results.")} - {
        "OUTCOMES", "outcome_code"
    }  # fmt: skip
    later = {name for name, home in homes.items() if LEVEL[room(home.replace(".", "/"))] > LEVEL["results"]}
    assert later == LAZY_NAMES


@pytest.mark.parametrize("package", NAMED.values(), ids=lambda package: package.__name__)
def test_every_public_name_is_documented(package):
    for name in package.__all__:
        assert getattr(package, name).__doc__, name


def loaded_by(code):
    """The modules that a new process has loaded after `code`."""
    code = f"import sys; {code}; print(*sys.modules)"
    return set(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split())


def test_importing_costs_what_importing_jax_costs():
    beyond = loaded_by("import estimable") - loaded_by("import jax")
    parts = ("errors", "forks", "interpreter", "lazy", "precision")
    assert beyond == {"estimable", *(f"estimable.{part}" for part in parts)}


def test_the_results_are_loaded_when_they_are_asked_for():
    beyond = loaded_by("import estimable; estimable.results") - loaded_by("import estimable")
    assert beyond == {"estimable.results"}


def test_using_any_name_loads_nothing_heavy():
    heavy = {"scipy", "pandas", "plotly", "typer", "rich", "xarray", "control", "llvmlite", "matplotlib"}
    heavy |= {"jaxtyping", "unittest", "asyncio"}
    assert not heavy & loaded_by("from estimable import *; from estimable.results import *")


def test_shapes_are_checked_in_the_tests():
    with pytest.raises(TypeCheckError, match="factor"):
        small.factor(np.ones((2, 3)))


def test_float64_is_enabled_and_earlier_float32_arrays_are_warned_of():
    code = "import jax.numpy as jnp; x = jnp.ones(2); import estimable; print(jnp.ones(1).dtype)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "float64"
    assert "float32 arrays were made before" in run.stderr
    quiet = subprocess.run([sys.executable, "-c", "import estimable"], capture_output=True, text=True, check=True)
    assert quiet.stderr == ""


def forbidden_words():
    """The synonyms in the last column of the glossary."""
    page = ROOT / "docs" / "glossary.md"
    rows = [line.split("|") for line in page.read_text().splitlines() if line.startswith("| ")]
    return [word for row in rows[1:] for word in re.findall(r"`([^`]+)`", row[3])]


def test_one_idea_has_one_word():
    words = forbidden_words()
    assert len(words) > 5
    for path in FILES:
        found = [word for word in words if re.search(rf"\b{re.escape(word)}\b", path.read_text())]
        assert not found, (path.name, found)


UNTYPED = 170  # parameters of the package, at most, that may be anything: they are 163 of some 7,000


def is_anything(annotation, aliases):
    """Whether an annotation says nothing: none, `Any`, `object`, another name of these, or a union with one."""
    if isinstance(annotation, ast.Constant) and isinstance(annotation.value, str):
        annotation = ast.parse(annotation.value, mode="eval").body
    if isinstance(annotation, ast.BinOp):
        return is_anything(annotation.left, aliases) or is_anything(annotation.right, aliases)
    return annotation is None or (isinstance(annotation, ast.Name) and annotation.id in aliases)


def untyped(trees):
    """(function, parameter) of all that may be anything."""
    nodes = [node for tree in trees for node in ast.walk(tree)]
    assigned = [node for node in nodes if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None]
    aliases = {"Any", "object"}
    for node in assigned:
        if isinstance(node.value, ast.Name) and node.value.id in ("Any", "object"):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            aliases |= {target.id for target in targets if isinstance(target, ast.Name)}
    for node in nodes:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            given = node.args
            for one in [*given.posonlyargs, *given.args, *given.kwonlyargs, given.vararg, given.kwarg]:
                if one is not None and one.arg not in ("self", "cls") and is_anything(one.annotation, aliases):
                    yield node.name, one.arg


def test_few_parameters_may_be_anything():
    code = "Thing = Any\ndef f(a, b: int, *c: Any, d: 'object | None' = None, e: Thing = 0, f: list[Any] = ()): pass"
    assert list(untyped([ast.parse(code)])) == [("f", "a"), ("f", "d"), ("f", "e"), ("f", "c")]
    found = list(untyped([ast.parse(path.read_text()) for path in FILES]))
    assert len(found) <= UNTYPED, found


def test_the_slow_tests_are_there():
    """So that a renamed test does not become fast by its name."""
    for place, names in SLOW.items():
        text = (ROOT / "tests" / place).read_text()
        for name in names:
            assert f"def {name}(" in text, f"{place}::{name}"
    assert all((ROOT / "tests" / folder).is_dir() for folder in SLOW_FOLDERS)
