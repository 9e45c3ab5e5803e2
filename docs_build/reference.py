"""The pages of the API reference: every public name once, in the order of a reader's work."""

import inspect
from collections.abc import Iterator

import estimable

OWN = "What an algorithm, link or plant of yours must have"
PAGES: dict[str, tuple[tuple[str, tuple[str, ...]], ...]] = {  # headings, and the rooms whose names stand below each
    "verbs": (
        ("Read, save, load", ("data", "store", "models", "packaged")),
        ("Before any data", ("analysis",)),
        ("Estimate", ("estimation",)),
        ("Identify", ("identification",)),
        ("Simulate", ("simulation", "plants")),
        ("Design", ("design",)),
    ),
    "algorithms": (
        ("Filters", ("filters",)),
        ("Identifiers", ("identifiers",)),
        ("Controllers", ("controllers",)),
        (OWN, ("protocols",)),
    ),
    "models": (
        ("Models", ("models", "simulation", "design")),
        ("Records", ("data", "estimation")),
        ("Links", ("networks",)),
    ),
    "errors": (("All errors and warnings", ("errors",)),),
}
MODULES = ("diagnostics", "plants", "report", "packaged", "catalogue")
CALLED = {"HoKalman": "realise", "Phasor": "second_order", "Dither": "sized"}  # by users; drivers call other methods


def names_of(page: str) -> Iterator[tuple[str, list[str]]]:
    """The headings of a page, and the public names below each."""
    if page == "results":
        yield "All records", [f"results.{name}" for name in public("results")]
        return
    if page == "modules":
        for module in MODULES:
            yield f"estimable.{module}", [f"{module}.{name}" for name in public(module)]
        return
    is_of = inspect.isfunction if page == "verbs" else inspect.isclass
    homes = {name: home.split(".")[0] for name, home in vars(estimable)["_HOMES"].items()}
    for heading, rooms in PAGES[page]:
        named = [name for name, room in homes.items() if room in rooms and is_of(getattr(estimable, name))]
        yield heading, sorted(named, key=str.lower)


def public(module: str) -> list[str]:
    """The public names of a module of the package."""
    found = getattr(estimable, module)
    own = [
        name for name, thing in vars(found).items()
        if getattr(thing, "__module__", None) == found.__name__ and not name.startswith("_")
    ]  # fmt: skip
    return list(getattr(found, "__all__", own))


def directives(page: str) -> str:
    """What mkdocstrings reads on a page of the reference."""
    parts = []
    for heading, names in names_of(page):
        parts.append(f"## {heading}")
        if page == "modules":
            parts.append((inspect.getdoc(getattr(estimable, heading.split(".")[1])) or "").splitlines()[0])
        parts += [f"::: estimable.{name}{_options(page, heading, name)}" for name in names]
    return "\n\n".join(parts)


def _options(page: str, heading: str, name: str) -> str:
    """What is shown of a class besides its docstring."""
    if page == "results":
        return "\n    options:\n      inherited_members: true"
    if page == "algorithms" and heading != OWN:
        return f"\n    options:\n      members: [{CALLED.get(name, '')}]"
    return ""
