"""Print each workload: seconds of each contender, the ratio to ours, and how far its numbers are from an exact loop."""

import argparse
import json
import os
import sys
import tempfile
import time
from pathlib import Path
from unittest import mock

from .equations import lyapunov, riccati
from .filtering import bank, large, one_record, one_step
from .identifications import comparisons, output_error
from .likelihoods import fitted, score
from .loops import loops
from .nonlinear import nonlinear
from .report import page, summary, table
from .smoothers import nonlinear_smoothers, smoothers
from .start import first_calls, starts
from .windows import windows

PAGE = Path(__file__).parents[1] / "docs" / "benchmarks.md"


def workloads(quick):
    """(function of its rows, name, sizes) of each workload."""
    T, runs, steps, rows = (10_000, 1_000, 1_000, 1_000) if quick else (100_000, 10_000, 2_000, 2_000)
    return [
        (one_record, f"W1 one record, n=4 p=2, T={T:,}", T, 0.0),
        (bank, f"W2 {runs:,} models of n=4 p=2, 200 samples each", runs, 200),
        (one_record, f"W3 as W1, 30 % of channels missing, T={T:,}", T, 0.3),
        *((one_step, f"W4 one step online, n={n} p={p}", n, p, steps) for n, p in ((4, 2), (12, 6))),
        *((large, f"W5 one record, n={n} p=2, T={rows:,}, keep={keep}", n, 2, rows, keep, 0.0)
          for n in (4, 16, 64, 256) for keep in ("all", "means") if n > 16 or keep == "all"),
        (windows, f"W6 window of 30, {runs // 10:,} flights of the F-16, 1,650 samples each", runs // 10),
        *((solve, f"W7 {solve.__name__}, n={n}", n) for n in (4, 20, 100) for solve in (riccati, lyapunov)),
        (loops, f"W8 {runs:,} closed loops of the F-16, 1,650 samples each", runs),
        (starts, "W9 start"),
        *((nonlinear, f"W10 nonlinear, n=4 p=2, T={T:,}, keep={keep}", T, keep) for keep in ("all", "likelihood")),
        *((first_calls, f"W11 first call, n={n} p=2", n) for n in (2, 4, 8, 64)),
        *((large, f"W13 as W5, 30 % of channels missing, n={n} p={p}, T={rows:,}, keep=all", n, p, rows, "all", 0.3)
          for n in (16, 48, 64, 256) for p in (2, n // 4)),
        *((score, f"W12 score, n=4 p=2, 8 numbers, T={T:,}, {100 * share:.0f} % missing", T, share) for share in (0.0, 0.3)),
        (fitted, "W14 fit_noise, n=4 p=2, 6 variances, T=1,201", 1201),
        *((make, f"W15 {what}, n=4 p=2, T={T:,}{', 30 % of channels missing' if missing else ''}", T, missing)
          for make, what in ((smoothers, "smoother"), (nonlinear_smoothers, "nonlinear smoother")) for missing in (0.0, 0.3)),
        *((comparisons, f"W17 compare, T={T:,}, {k} inputs and outputs, {100 * share:.0f} % of inputs missing", T, k, share)
          for T, k, share in ((1_000, 1, 0.0), (6_300, 3, 0.0), (2_400, 1, 0.1))),
        (output_error, "W17 OutputErrorML(2, 1, delay=1), 2,000 rows", 2_000),
    ]  # fmt: skip


def chosen(workloads, only):
    """The workloads that `only` names, as in "W1,W7"; all of them without names. Raises `ValueError` for an unknown name."""
    names = {each[1].split()[0] for each in workloads}
    words = {word.strip() for word in only.split(",")} if only else names
    if words - names:
        raise ValueError(f"--only knows {', '.join(sorted(names, key=lambda name: int(name[1:])))}. Got {only}")
    return [each for each in workloads if each[1].split()[0] in words]


def measured(some):
    """Their rows, starting with an empty disk cache; progress goes to stderr."""
    rows, start = [], time.perf_counter()
    with tempfile.TemporaryDirectory() as cache, mock.patch.dict(os.environ, ESTIMABLE_CACHE=cache):
        for make, name, *sizes in some:
            for one in make(name, *sizes):
                print(f"{time.perf_counter() - start:6.1f} s  {name}: {one['contender']}", file=sys.stderr, flush=True)
                rows.append(one)
    return rows


def parser():
    """The options."""
    options = argparse.ArgumentParser(description=__doc__, prog="python -m benchmarks")
    options.add_argument(
        "--quick", action="store_true", help="a tenth of the rows and runs: two minutes instead of ten"
    )
    options.add_argument("--json", action="store_true", help="rows as JSON instead of a table")
    options.add_argument("--markdown", action="store_true", help="write docs/benchmarks.md too")
    options.add_argument(
        "--only", default="", metavar="W1,W7", help="only some workloads; not with --markdown, which needs all"
    )
    return options


def main(arguments=None):
    """Run the workloads."""
    options = parser().parse_args(arguments)
    if options.markdown and options.only:
        parser().error("--markdown writes the page of all workloads, measured in one run: leave out --only")
    try:
        some = chosen(workloads(options.quick), options.only)
    except ValueError as unknown:
        parser().error(str(unknown))
    rows = measured(some)
    if options.markdown:
        PAGE.write_text(page(rows, "--quick --markdown" if options.quick else "--markdown"))
    print(json.dumps(rows) if options.json else f"{summary(rows)}\n\n{table(rows)}")


if __name__ == "__main__":
    main()
