# pyright: reportMissingTypeStubs=false
"""Stationary gains, with their covariances, costs and poles."""

from typing import Annotated, Any

import numpy as np

from ..frozen import frozen, static


@frozen
class KalmanGain:
    """The stationary Kalman filter of a model; continuous models have one gain, hence `filter` is `predictor`.

    `filter` (n, p): x[k|k] = x[k|k-1] + filter e; `predictor` (n, p): x[k+1|k] = A x[k|k-1] + predictor e.
    `covariance` (n, n) of x[k|k], `predicted_covariance` of x[k|k-1], `innovation_covariance` (p, p) of e; `poles` (n,)
    of A - predictor C.
    """

    filter: Annotated[Any, "n p"]
    predictor: Annotated[Any, "n p"]
    covariance: Annotated[Any, "n n", "symmetric"]
    predicted_covariance: Annotated[Any, "n n", "symmetric"]
    innovation_covariance: Annotated[Any, "p p", "symmetric"]
    poles: Annotated[Any, "n"]


@frozen
class FeedbackGain:
    """The optimal feedback u = -`feedback` x, (m, n); its cost from x0 is x0' `cost` x0; `poles` (n,) of A - B feedback."""

    feedback: Annotated[Any, "m n"]
    cost: Annotated[Any, "n n", "symmetric"]
    poles: Annotated[Any, "n"]


@frozen
class TrackerChoices:
    """The result of `alpha_beta_choices`, a row for each choice of gains: `names`, `alpha`, `beta` (k,), `covariance` (k, 2, 2)
    of (position, velocity); `radius` (k,): modulus of the larger pole of the error; `price` (k, 2): variances relative to those
    of the Kalman filter."""

    alpha: Annotated[Any, "k"]
    beta: Annotated[Any, "k"]
    covariance: Annotated[Any, "k 2 2", "symmetric"]
    radius: Annotated[Any, "k"]
    price: Annotated[Any, "k 2"]
    names: Annotated[tuple[str, ...], "k"] = static()

    def to_pandas(self):
        """A DataFrame, one row per choice."""
        import pandas as pd

        σ = np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))
        columns = {"alpha": self.alpha, "beta": self.beta, "sigma_position": σ[:, 0], "sigma_velocity": σ[:, 1],
                   "radius": self.radius, "price_position": self.price[:, 0], "price_velocity": self.price[:, 1]}  # fmt: skip
        return pd.DataFrame(columns, index=list(self.names))
