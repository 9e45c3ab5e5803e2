"""The information in a record, or in an input before any data."""

from typing import Annotated, Any, NamedTuple

import numpy as np

from .. import checks
from ..annotations import Numbers
from ..errors import AssumptionError
from ..frozen import frozen, saved, static
from ..kernels import gain_error_bound as kernel
from ..models.prior import Prior
from .fits import Check
from .sentences import words


@saved
class Excitation(NamedTuple):
    """The result of `excitation`: the information in a record about each direction of the parameters θ.

    - `information` (d, d): the Fisher information about θ, with one diagonal block for each output.
    - `samples` (K,) and `eigenvalues` (K,): the smallest eigenvalue of the information gathered up to each of these samples.
      The information is scaled so that its diagonal is 1 at the end of the record.
    - `directions` (d, r): an orthonormal basis of the directions about which the record carries no information.
    - `check`: the verdict, with a sentence.
    """

    information: Annotated[Any, "d d", "symmetric"]
    samples: Annotated[Any, "K"]
    eigenvalues: Annotated[Any, "K"]
    directions: Annotated[Any, "d r"]
    check: Check

    def plot(self):
        """A plotly figure: the smallest eigenvalue over time, which must stay away from zero."""
        from ..figures.identification_plots import plot_excitation

        return plot_excitation(self)


@frozen
class Score:
    """The result of `score`: the derivatives of a log-likelihood with respect to d named numbers.

    - `log_likelihood`: the log-likelihood of the record with the numbers as given.
    - `names` (d,): the names of the numbers; the entries of the other fields follow their order.
    - `score` (d,): the derivative of `log_likelihood` with respect to each number, in 1 / (unit of the number).
    - `information` (d, d): Fisher's information of the innovations and of their covariances about the numbers. The inverse of
      the matrix is a lower bound on the covariance of unbiased estimates.
    - `engine`: the name of the engine that ran.
    """

    log_likelihood: float
    score: Annotated[Any, "d"]
    information: Annotated[Any, "d d", "symmetric"]
    names: Annotated[tuple[str, ...], "d"] = static()
    engine: str = static(default="")

    def __repr__(self) -> str:
        values = zip(self.names, np.asarray(self.score, float).tolist(), strict=True)
        return f"Score({', '.join(f'd/d {name} = {x:.4g}' for name, x in values)})"


@frozen
class GainInformation:
    """The result of `gain_information`: how accurately an input determines p unknown gains θ.

    - `covariance` (p, p) and `sigma` (p,): the Cramér-Rao bound of the gains with the given priors, as a covariance and as
      standard deviations. No unbiased estimate has smaller errors, and `UnknownGain` reaches the bound. An infinite sigma
      means that the gain is undetermined; its covariances with other gains are then set to 0.
    - `directions` (r, p): the combinations of gains about which the input carries no information.
    - `sentences`: the result as sentences.
    - `information` (n + p, n + p): the information about (x[0], θ) in the outputs, without the priors.
    - `amplitude`: the amplitude of the dither to which these numbers refer, 0 for none.
    - `gains`: the names of the gains.
    - `factor`, `state`, `gain`: a square root of the information, and the priors, from which `at` computes other amplitudes.
    """

    information: Annotated[Any, "N N", "symmetric"]
    covariance: Annotated[Any, "p p", "symmetric"]
    sigma: Annotated[Any, "p"]
    directions: Annotated[Any, "r p"]
    amplitude: float
    gains: Annotated[tuple[str, ...], "p"] = static()
    sentences: tuple[str, ...] = static()
    factor: Any
    state: Prior | None
    gain: Prior | None

    @staticmethod
    def of_factor(
        factor: np.ndarray, gains: tuple[str, ...], state: Prior | None, gain: Prior | None, *, n: int, amplitude: float
    ) -> "GainInformation":
        """The result from a factor of the information about n states and the gains, with the dither if there is one."""
        p = len(gains)
        F = kernel.with_dither(factor, n, p, amplitude)
        covariance, hidden = kernel.bound(F, _belief(state, n), _belief(gain, p))
        sigma = np.sqrt(np.diagonal(covariance))
        sentences = _sentences(sigma, hidden, gains, amplitude)
        return GainInformation(F.T @ F, covariance, sigma, hidden, amplitude, gains, sentences, factor, state, gain)

    def at(self, amplitude: float) -> "GainInformation":
        """The result with a dither of another `amplitude`. Its cost does not depend on the length of the record.

        Raises `InputError` where no dither was given.
        """
        faults = checks.Faults()
        amplitude = faults.number("amplitude", amplitude)
        self._need_dither(faults)
        faults.finish()
        n = len(self.information) - len(self.gains)
        return GainInformation.of_factor(
            self.factor, self.gains, self.state, self.gain, n=n, amplitude=float(amplitude)
        )

    def amplitude_for(self, sigma: Numbers) -> float:
        """The smallest amplitude of the dither with which every gain is known to within `sigma`, one number or (p,).

        Raises `InputError` where no dither was given; `AssumptionError` where no amplitude is enough.
        """
        faults = checks.Faults()
        faults.learn("p", len(self.gains), f"there {'are' if len(self.gains) > 1 else 'is'} "
                     f"{checks.counted(len(self.gains), 'gain')}")  # fmt: skip
        wanted = faults.array("sigma", np.full(len(self.gains), sigma) if checks.depth(sigma) == 0 else sigma, "p")
        if wanted is not None and np.any(np.asarray(wanted) <= 0):
            faults.add(f"`sigma` must be greater than 0. Got {checks.short(sigma)}.")
        self._need_dither(faults)
        faults.finish()
        start = kernel.first_amplitude(self.factor, len(self.gains), np.asarray(wanted))
        amplitude = kernel.smallest_amplitude(lambda a: float(np.max(self.at(a).sigma / wanted)), start)
        if amplitude is None:
            hidden = self.at(start).directions
            what = f": it carries no information about {words(hidden[0], self.gains)}" if len(hidden) else ""
            raise AssumptionError(f"no amplitude of this dither is enough{what}.")
        return amplitude

    def _need_dither(self, faults: checks.Faults) -> None:
        if self.factor.shape[1] == len(self.information):
            faults.add("no dither was given: gain_information(model, u, dither=...) with the shape of one, (T, m).")

    def __repr__(self) -> str:
        return f"GainInformation({' '.join(self.sentences)})"


def _belief(prior: Prior | None, size: int) -> kernel.Belief:
    if prior is None:
        return kernel.no_belief(size)
    diffuse = None if prior.diffuse is None else np.asarray(prior.diffuse, float)
    return kernel.belief(np.asarray(prior.covariance, float), diffuse)


def _sentences(sigma: np.ndarray, hidden: np.ndarray, gains: tuple[str, ...], amplitude: float) -> tuple[str, ...]:
    when = f"With {amplitude:g} times the dither, " if amplitude else ""
    known = [
        f"{when}{name} can be known to ±{s:.3g} (1 sigma)."
        for name, s in zip(gains, sigma, strict=True)
        if np.isfinite(s)
    ]
    nothing = [f"The input carries no information about {words(g, gains)}." for g in hidden]
    return (*known, *nothing)
