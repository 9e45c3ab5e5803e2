"""Whether the standard deviations of output-error fits hold in noise of any colour: rms z, from the spectrum of the residuals
and by the usual formula for white residuals.
"""

import argparse
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

import estimable as es

A, B = [1.0, -1.5, 0.7], [0.0, 1.0, 0.5]
TRUE = np.array([-1.5, 0.7, 1.0, 0.5])


class Case(NamedTuple):
    """The pole of the noise, rows, rows over which the input is held, and the share of outputs that are missing."""

    pole: float
    rows: int
    held: int
    missing: float


CASES = {
    "white": Case(0.0, 400, 1, 0.0),
    "AR(.8)": Case(0.8, 400, 1, 0.0),
    "AR(.95), u held 10": Case(0.95, 2000, 10, 0.0),
    "AR(.95), half missing": Case(0.95, 2000, 10, 0.5),
    "AR(-.8), 30 % missing": Case(-0.8, 1000, 1, 0.3),
}


def drawn(case, seed):
    """Noise of standard deviation .5 on the output of OE(2, 1, delay 1)."""
    g = np.random.default_rng(seed)
    u = np.repeat(g.normal(size=-(-case.rows // case.held)), case.held)[: case.rows]
    v = lfilter([0.5 * np.sqrt(1 - case.pole**2)], [1, -case.pole], g.normal(size=case.rows + 200))[200:]
    y = lfilter(B, A, u) + v
    y[g.random(case.rows) < case.missing] = np.nan
    return es.Record(y, u, dt=1)


def scores(case, draws):
    """Errors over standard deviations of each draw, and over those for white residuals: (draws, 4) each."""
    fits = [es.OutputErrorML(2, 1, delay=1).fit([drawn(case, seed)]) for seed in range(draws)]
    errors = np.array([fit.parameters for fit in fits]) - TRUE
    sigmas = [
        np.sqrt([np.diag(S) for S in which])
        for which in zip(*((f.covariance, f.covariance_white) for f in fits), strict=True)
    ]
    return errors / sigmas[0], errors / sigmas[1]


def main():
    """Print the rms of both."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--draws", type=int, default=120)
    draws = options.parse_args().draws
    for name, case in CASES.items():
        z, white = (np.sqrt(np.mean(one**2, axis=0)).round(2) for one in scores(case, draws))
        print(f"{name:24} rms z {z}   for white residuals {white}")


if __name__ == "__main__":
    main()
