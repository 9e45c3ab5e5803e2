"""A. G. Sillence, Loop gain adaptive control (1999). Its errata are corrected and are mentioned where they matter."""

from collections.abc import Callable
from typing import Any

from ..entries import Reproduction
from . import adapted, expanding, fixed_law, many_draws, published_tables, sampling, window

SOURCE = "Sillence (1999)"
DRAWING = "a drawing, with nothing to compute"
K1 = (0.8, 0.6, 0.4, 0.2, 0.1)


def _done(name: str, title: str, compute: Callable[..., Any]) -> Reproduction:
    return Reproduction(f"sillence-{name}", SOURCE, title, compute)


def _not_yet(name: str, title: str, reason: str) -> Reproduction:
    return Reproduction(f"sillence-{name}", SOURCE, title, None, reason)


ENTRIES = (
    _done("table-1", "Signal-to-noise ratios", published_tables.signal_to_noise),
    _done("table-2", "Poles of the loop under the PI law", published_tables.poles_of_pi_loop),
    _done("table-3", "Poles of the loop under the proportional law", published_tables.poles_of_p_loop),
    _done("table-4", "Final gain and settling time, expanding filter", expanding.table_4),
    _done("table-5", "Time to come within 20 % of the gain, moving window", window.table_5),
    _not_yet("fig-1", "Flight control system", DRAWING),
    _not_yet("fig-2", "Longitudinal parameters of an aircraft", DRAWING),
    *(
        _done(f"fig-{i}", f"Pitch rate with{'' if alpha else 'out'} alpha feedback, {law} law",
              many_draws.fixed_law(integral=law == "PI", alpha=alpha))
        for i, alpha, law in ((3, False, "proportional"), (4, True, "proportional"), (5, False, "PI"), (6, True, "PI"))
    ),
    *(
        _done(f"fig-{i}", f"{what} under a fixed law, K = 0.8, sigma of alpha {sigma} deg",
              many_draws.fixed_law(integral=True, gain=0.8, noise={"sigma_alpha": sigma, "sigma_q": many_draws.SIGMA_Q}))
        for i, what, sigma in (
            (7, "Alpha", 0.03), (8, "Alpha", 0.3), (9, "Pitch rate", 0.03), (10, "Pitch rate", 0.3),
        )
    ),
    _done("fig-11", "Continuous and digital response to a step", sampling.step_response),
    _done("fig-12", "What sampling does to the command", sampling.command),
    _not_yet("fig-13", "Elevator damage", DRAWING),
    *(
        _done(f"fig-{i}", f"Pitch rate and alpha, PI law, K1 = {k}", fixed_law.flight(k, integral=True))
        for i, k in enumerate(K1, start=14)
    ),
    _done("fig-19", "Estimated pitch rate and alpha, K1 = 0.8", expanding.states_over_time(0.8)),
    _done("fig-20", "Estimated pitch rate and alpha, K1 = 0.2", expanding.states_over_time(0.2)),
    _done("fig-21", "Pitch rate and alpha, proportional law, K1 = 0.2", fixed_law.flight(0.2, integral=False)),
    _done("fig-22", "Pitch rate and alpha, proportional law, K1 = 0.1", fixed_law.flight(0.1, integral=False)),
    *(
        _done(f"fig-{i}", f"Estimated gain, expanding filter, K1 = {k}", expanding.gain_over_time(k))
        for i, k in enumerate(K1, start=23)
    ),
    _done("fig-28", "Expanding filter against moving window, K1 = 0.6", window.expanding_or_window),
    _done("fig-29", "Command against the window's gain, K1 = 0.6", window.command_and_gain),
    _done("fig-30", "Smoothing against delay, K1 = 0.6", window.smoothings),
    _done("fig-31", "Smoothed and unsmoothed gain, K1 = 0.6", window.smoothed_or_not),
    _done("fig-32", "Moving window at 53.286 dB, K1 = 0.2", window.at_noise(53.286, bounded=False)),
    _done("fig-33", "Moving window at 23.29 dB, K1 = 0.2", window.at_noise(23.29, bounded=False)),
    _done("fig-34", "Two sigma bounds of the window, K1 = 0.6", window.two_sigma),
    _done("fig-35", "Bounded and smoothed gain at 23.29 dB, K1 = 0.2", window.at_noise(23.29, bounded=True)),
    _done("fig-36", "Moving window at 40 dB, K1 = 0.2", window.at_noise(40.0, bounded=False)),
    _done("fig-37", "Bounded and smoothed gain at 40 dB, K1 = 0.2", window.at_noise(40.0, bounded=True)),
    _done("fig-38", "Moving window at 60 dB, K1 = 0.2", window.at_noise(60.0, bounded=False)),
    _done("fig-39", "Bounded and smoothed gain at 60 dB, K1 = 0.2", window.at_noise(60.0, bounded=True)),
    _done("fig-40", "Pitch rate with adaptation at 23.29 dB, K1 = 0.2", adapted.adapted(23.29, bounded=False)),
    _done("fig-41", "Pitch rate with bounded adaptation at 23.29 dB, K1 = 0.2", adapted.adapted(23.29, bounded=True)),
    _done("fig-42", "Moving window's gain at 37.227 dB, K1 = 0.2", adapted.compared),
    _done("fig-43", "Pitch rate with and without adaptation at 37.227 dB, K1 = 0.2", adapted.compared),
    _done("fig-44", "Gain estimated after adaptation at 37.227 dB, K1 = 0.2", adapted.compared),
    _done("fig-45", "Pitch rate with bounded adaptation at 40 dB, K1 = 0.2", adapted.adapted(40.0, bounded=True)),
    _done("fig-46", "Pitch rate with adaptation at 53.286 dB, K1 = 0.2", adapted.adapted(53.286, bounded=False)),
    _done("fig-47", "Pitch rate with bounded adaptation at 60 dB, K1 = 0.2", adapted.adapted(60.0, bounded=True)),
    _done("section-6-3", "Bands over draws: other failures, gusts", many_draws.bands),
)  # fmt: skip
