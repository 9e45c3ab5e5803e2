"""Rows as Markdown: the summary, the whole table, and the page of the documentation."""

import os
import platform
from importlib import metadata
from itertools import groupby

PACKAGES = ("jax", "llvmlite", "numpy", "scipy", "statsmodels", "filterpy", "pykalman", "simdkalman", "dynamax", "cuthbert",
            "kalman-py", "slycot")  # fmt: skip


def of_workloads(rows):
    """(workload, its rows), in the order in which they ran."""
    return [(name, list(group)) for name, group in groupby(rows, key=lambda one: one["workload"])]


def summary(rows):
    """One line for each workload that others also run: the time of the fastest of them relative to ours."""
    lines = ["| workload | ours [s] | fastest library | times ours | fastest by hand | times ours |",
             "|---|---|---|---|---|---|"]  # fmt: skip
    for workload, group in of_workloads(rows):
        ran = [one for one in group if not one["absent"]]
        kinds = [[one for one in ran if one["whose"] == whose] for whose in ("ours", "library", "by hand")]
        if not kinds[0] or not (kinds[1] or kinds[2]):
            continue
        ours, cells = kinds[0][0]["seconds"], []
        for kind in kinds[1:]:
            fastest = min(kind, key=lambda one: one["seconds"], default=None)
            cells += [fastest["contender"], _figures(fastest["seconds"] / ours)] if fastest else ["", ""]
        lines.append(f"| {workload} | {ours:.3g} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _figures(ratio):
    return f"{ratio:.0f}" if ratio >= 10 else f"{ratio:.2g}"


def table(rows):
    """Every row; ratios are to the first of the same workload that ran."""
    lines = ["| workload | contender | seconds | ratio | first call [s] | error | log-likelihood error |",
             "|---|---|---|---|---|---|---|"]  # fmt: skip
    for workload, group in of_workloads(rows):
        first = next((one["seconds"] for one in group if not one["absent"]), None)
        for one in group:
            cells = [workload, one["contender"], f"absent: {one['absent']}", "", "", "", ""]
            if not one["absent"]:
                cells[2:4] = f"{one['seconds']:.3g}", f"{one['seconds'] / first:.2f}"
                for place, key in enumerate(("first_call", "error", "log_likelihood_error"), 4):
                    cells[place] = "" if one[key] is None else f"{one[key]:.2g}"
            lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def page(rows, options):
    """The page of the documentation."""
    installed = {d.metadata["Name"].lower().replace("_", "-"): d.version for d in metadata.distributions()}
    versions = ", ".join(f"{name} {installed[name]}" for name in PACKAGES if name in installed)
    machine = f"{os.cpu_count()} processors ({platform.machine()}), Python {platform.python_version()}"
    return f"""# Benchmarks

*Question it answers: how fast is it, compared with other libraries and with a loop written by hand for that one case?*

Made by `python -m benchmarks {options}` on {machine}, {versions}. The other libraries are those of extra `bench`.

In short, for each workload that others run too; a ratio above 1 means that ours is faster. Ours is the first row of the workload
in the second table.

{summary(rows)}

## Every contender

Each time is the shortest of several after a first call. The first call has its own column and includes the compilation. The ratio
is to the first row of the workload. Errors: of a mean, the largest difference from a NumPy loop that deletes what is missing; of
an equation, the residual relative to the solution; of a log-likelihood, relative. All in double precision, with the same model,
prior and data.

- W1, W3, W5, W13 with `keep=all`: means, covariances and log-likelihood of every sample. statsmodels runs with its defaults
  and, under `conserve_memory`, set to store what ours stores: filtered means and forecasts and, unless `keep=means`, their
  covariances. The plain scan is the filter that one would write in JAX for the model at hand: a Joseph form in one `lax.scan`,
  with masked outputs. filterpy and pykalman give no log-likelihood with it; dynamax and cuthbert return the stored arrays from
  their jitted function.
- W2: log-likelihoods only. The C loop runs eight models in the lanes of a vector, with the groups shared among threads.
- W4: seconds of one step called from Python.
- W11: seconds of the first call in a new process whose JAX has started. Which engine is better when: [engines](engines.md).

{table(rows)}
"""
