"""Print each workload: seconds of each contender, the ratio to ours, and how far its numbers are from an exact loop."""

import argparse
import json
import os
import platform
from importlib import metadata
from pathlib import Path

from .equations import lyapunov, riccati
from .filtering import bank, large, one_record, one_step
from .loops import loops
from .nonlinear import nonlinear
from .start import starts
from .windows import windows

PAGE = Path(__file__).parents[1] / "docs" / "benchmarks.md"
PACKAGES = ("jax", "llvmlite", "numpy", "scipy", "statsmodels", "filterpy", "slycot")


def workloads(quick):
    """(what makes its rows, name, sizes) of each workload."""
    T, runs, steps, rows = (10_000, 1_000, 1_000, 200) if quick else (100_000, 10_000, 10_000, 2_000)
    return [
        (one_record, f"W1 one record, n=4 p=2, T={T:,}", T, 0.0),
        (bank, f"W2 {runs:,} models of n=4 p=2, 200 samples each", runs, 200),
        (one_record, f"W3 as W1, 30 % of channels missing, T={T:,}", T, 0.3),
        *((one_step, f"W4 one step online, n={n} p={p}", n, p, steps) for n, p in ((4, 2), (12, 6))),
        *((large, f"W5 one record, n={n} p=2, T={rows:,}", n, rows) for n in (4, 16, 64, 256)),
        *((solve, f"W7 {solve.__name__}, n={n}", n) for n in (4, 20, 100) for solve in (riccati, lyapunov)),
        (windows, f"W6 window of 30, {runs // 10:,} flights of the F-16, 1,650 samples each", runs // 10),
        (loops, f"W8 {runs:,} closed loops of the F-16, 1,650 samples each", runs),
        (starts, "W9 start"),
        *((nonlinear, f"W10 nonlinear, n=4 p=2, T={T:,}, keep={keep}", T, keep) for keep in ("all", "likelihood")),
    ]


def table(rows):
    """The rows as a Markdown table; ratios are to the first of the same workload that ran."""
    lines = ["| workload | contender | seconds | ratio | first call [s] | error | log-likelihood error |",
             "|---|---|---|---|---|---|---|"]  # fmt: skip
    for told in rows:
        if told["absent"]:
            lines.append(f"| {told['workload']} | {told['contender']} | absent: {told['absent']} | | | | |")
            continue
        first = next(r["seconds"] for r in rows if r["workload"] == told["workload"] and not r["absent"])
        cells = [told["workload"], told["contender"], f"{told['seconds']:.3g}", f"{told['seconds'] / first:.2f}"]
        for key in ("first_call", "error", "log_likelihood_error"):
            cells.append("" if told[key] is None else f"{told[key]:.2g}")
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def page(rows):
    """The page of the documentation."""
    installed = {
        distribution.metadata["Name"].lower(): distribution.version for distribution in metadata.distributions()
    }
    versions = ", ".join(f"{name} {installed[name]}" for name in PACKAGES if name in installed)
    machine = f"{os.cpu_count()} processors ({platform.machine()}), Python {platform.python_version()}"
    return f"""# Benchmarks

Made by `python -m benchmarks --quick --markdown` on {machine}, {versions}.

Each time is the shortest of several after a first call, which stands beside it and holds the compilation; the ratio is to the
first row of the workload. Errors: the largest of a mean against a NumPy loop that deletes what is missing; of an equation, the
residual relative to the solution; of a log-likelihood, relative. W4 counts the seconds of one step.

{table(rows)}
"""


def main():
    """Run the workloads whose algorithms exist so far."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a tenth of the rows and runs")
    parser.add_argument("--json", action="store_true", help="rows as JSON in place of a table")
    parser.add_argument("--markdown", action="store_true", help="write docs/benchmarks.md too")
    parser.add_argument("--only", default="", metavar="W7", help="the workloads whose names begin so")
    options = parser.parse_args()
    rows = [
        told
        for make, name, *sizes in workloads(options.quick)
        if name.startswith(options.only)
        for told in make(name, *sizes)
    ]
    if options.markdown:
        PAGE.write_text(page(rows))
    print(json.dumps(rows) if options.json else table(rows))


if __name__ == "__main__":
    main()
