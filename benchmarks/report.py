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

Made by `python -m benchmarks {options}` on {machine}, {versions}. The extra `bench` installs the other libraries.

The first table is a summary. For each workload that other libraries can run too, it compares estimable with the fastest of
them, and with the fastest loop written by hand. "Times ours" is the ratio of their time to that of estimable: above 1 estimable
is faster. The time of estimable is the first row of the workload in the second table. n is the number of states, p that of
outputs, and T that of samples.

{summary(rows)}

## Every contender

Each time is the shortest of several calls after a first call. The first call has its own column, and includes the compilation.
The ratio is the time divided by that of the first row of the workload. The error of a filter is the largest difference of a
mean from that of a NumPy loop which deletes missing outputs. The error of an equation is its residual relative to the solution,
and that of a log-likelihood is relative. All contenders use double precision, and the same model, prior and data.

- W1, W3, W5, W13 with `keep=all`: the results are means, covariances and log-likelihood of every sample. statsmodels runs with
  its default settings and, in the rows `conserve_memory`, with settings to store the same as estimable: filtered means,
  forecasts and, unless `keep=means`, their covariances. The plain scan is the filter that one would write in JAX for the model
  at hand: Joseph's form in one `lax.scan`, with a mask for missing outputs. filterpy and pykalman give no log-likelihood.
  dynamax and cuthbert return the stored arrays from their compiled function.
- W2: log-likelihoods only. The C loop computes eight models at once by vector instructions, and divides the models among
  threads.
- W4: seconds of one step (`correct` and `predict`) called from Python.
- W11: seconds of the first call in a new process that has used JAX before. The page on [engines](engines.md) says which engine
  to use.
- W17: `compare` chooses its methods and orders. The error of the fit by SciPy is in standard errors of the parameters.
- W15: the results are smoothed means and covariances of every sample; estimable computes the log-likelihood too.

{table(rows)}
"""
