# pyright: reportMissingTypeStubs=false
"""Stationary gains, with their covariances, costs and poles."""

from typing import Annotated, Any

import numpy as np

from ..frozen import frozen, static


@frozen
class KalmanGain:
    """The stationary Kalman filter of a model: its gains, covariances and poles.

    Below e is the innovation, and x[k|j] is the estimate of x[k] from the samples 0 to j. A continuous model has only one
    gain: there `filter` and `predictor` are equal.

    - `filter` (n, p): the gain of the filter, x[k|k] = x[k|k-1] + filter e.
    - `predictor` (n, p): the gain of the one-step predictor, x[k+1|k] = A x[k|k-1] + predictor e.
    - `covariance` (n, n): the covariance of the error of x[k|k].
    - `predicted_covariance` (n, n): the covariance of the error of x[k|k-1].
    - `innovation_covariance` (p, p): the covariance of e.
    - `poles` (n,): the eigenvalues of A - predictor C.
    """

    filter: Annotated[Any, "n p"]
    predictor: Annotated[Any, "n p"]
    covariance: Annotated[Any, "n n", "symmetric"]
    predicted_covariance: Annotated[Any, "n n", "symmetric"]
    innovation_covariance: Annotated[Any, "p p", "symmetric"]
    poles: Annotated[Any, "n"]


@frozen
class FeedbackGain:
    """The result of `lqr_gain`: the optimal feedback of a model.

    - `feedback` (m, n): the gain of the law u = -feedback x.
    - `cost` (n, n): a matrix; x0' cost x0 is the total cost from the initial state x0.
    - `poles` (n,): the eigenvalues of A - B feedback.
    """

    feedback: Annotated[Any, "m n"]
    cost: Annotated[Any, "n n", "symmetric"]
    poles: Annotated[Any, "n"]


@frozen
class TrackerChoices:
    """The result of `alpha_beta_choices`: k choices of the two gains of a tracker, side by side.

    - `names` (k,): the names of the choices.
    - `alpha` and `beta` (k,): their gains.
    - `covariance` (k, 2, 2): the stationary covariance of the error of (position, velocity).
    - `radius` (k,): the modulus of the larger pole of the error.
    - `price` (k, 2): the variances of position and velocity, divided by those of the Kalman filter.
    """

    alpha: Annotated[Any, "k"]
    beta: Annotated[Any, "k"]
    covariance: Annotated[Any, "k 2 2", "symmetric"]
    radius: Annotated[Any, "k"]
    price: Annotated[Any, "k 2"]
    names: Annotated[tuple[str, ...], "k"] = static()

    def to_pandas(self):
        """A DataFrame with one row for each choice."""
        import pandas as pd

        σ = np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))
        columns = {"alpha": self.alpha, "beta": self.beta, "sigma_position": σ[:, 0], "sigma_velocity": σ[:, 1],
                   "radius": self.radius, "price_position": self.price[:, 0], "price_velocity": self.price[:, 1]}  # fmt: skip
        return pd.DataFrame(columns, index=list(self.names))
