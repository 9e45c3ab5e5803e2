"""H. Fang, Estimation, identification and adaptive control over networks (2009)."""

from collections.abc import Callable
from functools import partial
from typing import Any

from . import fang_inputs as inputs
from . import fang_lossy as lossy
from . import fang_tracking as tracking
from .entries import Reproduction

SOURCE = "Fang (2009)"
DRAWING = "a drawing, with nothing to compute"


def _done(name: str, title: str, compute: Callable[..., Any]) -> Reproduction:
    return Reproduction(f"fang-{name}", SOURCE, title, compute)


def _not_yet(name: str, title: str, reason: str) -> Reproduction:
    return Reproduction(f"fang-{name}", SOURCE, title, None, reason)


ENTRIES = (
    _done("table-2-1", "Example 1: norms of the input and state errors", inputs.table(inputs.FIRST)),
    _done("table-2-2", "Example 2: norms of the input and state errors", inputs.table(inputs.SECOND)),
    _done("table-3-1", "Example 1: parameter estimates, 80 % and 70 % arrive", partial(lossy.table, 1)),
    _done("table-3-2", "Example 2: parameter estimates, 40 % and 20 % arrive", partial(lossy.table, 2)),
    _not_yet("fig-1-1", "A networked control system", DRAWING),
    _not_yet("fig-2-1", "Block diagram of input and state estimation", DRAWING),
    _done("fig-2-2", "Example 1: input and states with their estimates", inputs.estimates(inputs.FIRST)),
    _done("fig-2-3", "Example 1: trace of the state covariance", inputs.traces(inputs.FIRST)),
    _done("fig-2-4", "Example 2: input and states with their estimates", inputs.estimates(inputs.SECOND)),
    _done("fig-2-5", "Example 2: trace of the state covariance", inputs.traces(inputs.SECOND)),
    _done("fig-2-6", "Example 3: input and states with their estimates", inputs.estimates(inputs.THIRD)),
    _not_yet("fig-3-1", "Identification over a lossy network", DRAWING),
    _done("fig-3-2", "Example 1: parameter estimates over time", partial(lossy.parameters, 1)),
    _done("fig-3-3", "Example 1: relative parameter error", partial(lossy.errors, 1)),
    _done("fig-3-4", "Example 1: estimated and true outputs", partial(lossy.outputs, 1)),
    _done("fig-3-5", "Example 1: average output error", partial(lossy.output_errors, 1)),
    _done("fig-3-6", "Example 2: parameter estimates over time", partial(lossy.parameters, 2)),
    _done("fig-3-7", "Example 2: relative parameter error", partial(lossy.errors, 2)),
    _done("fig-3-8", "Example 2: estimated and true outputs", partial(lossy.outputs, 2)),
    _done("fig-3-9", "Example 2: average output error", partial(lossy.output_errors, 2)),
    _done("fig-3-10", "Example 3: parameter errors under two loss patterns", partial(lossy.patterns, "parameter")),
    _done("fig-3-11", "Example 3: output errors under two loss patterns", partial(lossy.patterns, "output")),
    _not_yet("fig-4-1", "A loop with randomly missing outputs", DRAWING),
    _not_yet("fig-4-2", "Adaptive control diagram", DRAWING),
    _done("fig-4-3", "Example 1: output response, 85 % arrive", partial(tracking.response, 1)),
    _done("fig-4-4", "Relative parameter errors of Examples 1 and 2", tracking.parameters),
    _done("fig-4-5", "Example 1: estimated and true outputs", partial(tracking.outputs, 1)),
    _done("fig-4-6", "Example 2: output response", partial(tracking.response, 2)),
    _done("fig-4-7", "Example 2: estimated and true outputs, 65 % arrive", partial(tracking.outputs, 2)),
    _done("fig-4-8", "Example 3: output response, parameters rise by half at k = 2500", tracking.changed),
)
