"""Uncertain A, B and C against Schmidt's filter written out, an extended filter, and differences."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimable import (
    ChangeDetection,
    ExtendedKalman,
    Kalman,
    ModelUncertainty,
    NonlinearModel,
    Prior,
    Record,
    StateSpace,
    UnknownGain,
    estimate,
    read_model,
    smooth,
    write_model,
)
from estimable.frozen import replace
from estimable.models.files import GainSection
from estimable.models.sampled import Clock

A, B, C = np.array([[0.8, 0.2], [0.0, 0.7]]), np.array([[0.5], [1.0]]), np.array([[1.0, 0.3], [0.0, 1.0]])
SD = {"A": np.array([[0.1, 0.05], [0.0, 0.2]]), "B": np.array([[0.0], [0.3]]), "C": np.array([[0.0, 0.2], [0.0, 0.0]])}
MODEL = StateSpace(A, B, C, Q=0.02 * np.eye(2), R=np.array([[0.1, 0.03], [0.03, 0.2]]), dt=1)
PRIOR, GAIN = Prior([0.3, -0.2], np.diag([0.5, 1.0])), Prior([0.9], [[0.2]])
rng = np.random.default_rng(0)
Y, U = rng.normal(size=(25, 2)), rng.normal(size=(25, 1))
Y[rng.random(Y.shape) < 0.2] = np.nan
RECORD = Record(Y, U, dt=1)
ENTRIES = [(name, *at) for name, sd in SD.items() for at in np.argwhere(sd)]
SIGMA = np.array([SD[name][i, j] for name, i, j in ENTRIES])


def column_by_column(x, u, names):
    """The effect of each entry of the named matrices on a row of the model."""
    columns = np.zeros((2, len(ENTRIES)))
    for k, (name, i, j) in enumerate(ENTRIES):
        columns[i, k] = (u if name == "B" else x)[j] if name in names else 0.0
    return columns


def schmidt(gain):
    """Means, covariances and log-likelihood of (x, θ, φ) by Joseph's form with zero gain rows of φ; `gain`: θ is unknown."""
    n, p, q = 2, 1 if gain else 0, len(ENTRIES)
    m = np.concatenate([PRIOR.mean, GAIN.mean[:p], np.zeros(q)])
    P = np.diag(np.concatenate([np.diag(PRIOR.covariance), np.diag(GAIN.covariance)[:p], SIGMA**2]))
    means, covariances, total = [], [], 0.0
    for y, u in zip(Y, U, strict=True):
        x = m[:n]
        H = np.hstack([C, np.zeros((2, p)), column_by_column(x, 0 * u, "C")])
        seen = ~np.isnan(y)
        H, R, e = H[seen], MODEL.R[np.ix_(seen, seen)], y[seen] - C[seen] @ x
        if seen.any():
            S = H @ P @ H.T + R
            K = np.linalg.solve(S, H @ P).T
            total -= (e @ np.linalg.solve(S, e) + np.linalg.slogdet(2 * np.pi * S)[1]) / 2
            K[n + p :] = 0
            J = np.eye(len(m)) - K @ H
            m, P = m + K @ e, J @ P @ J.T + K @ R @ K.T
        means.append(m)
        covariances.append(P)
        x, θ = m[:n], m[n] if gain else 1.0
        F = np.eye(len(m))
        F[:n, :n] = A
        if gain:
            F[:n, n] = B @ u
        F[:n, n + p :] = column_by_column(x, θ * u, "AB")
        moved = m.copy()
        moved[:n] = A @ x + B @ u * θ
        P = F @ P @ F.T
        P[:n, :n] += MODEL.Q
        m = moved
    return np.array(means), np.array(covariances), total


@pytest.mark.parametrize("engine", ["native", "xla"])
@pytest.mark.parametrize("gain", [False, True])
def test_considered_entries_are_those_of_schmidts_filter(gain, engine):
    uncertainty = ModelUncertainty(**SD)
    algorithm = UnknownGain(MODEL, GAIN, uncertainty=uncertainty) if gain else Kalman(MODEL, uncertainty=uncertainty)
    found = estimate(algorithm, RECORD, prior=PRIOR, engine=engine)
    means, covariances, total = schmidt(gain)
    assert_allclose(found.mean, means[:, :2], rtol=1e-10, atol=1e-12)
    assert_allclose(found.covariance, covariances[:, :2, :2], rtol=1e-10, atol=1e-12)
    assert_allclose(found.log_likelihood, total, rtol=1e-11)
    if gain:
        assert_allclose(found.gain, means[:, 2:3], rtol=1e-10)
        assert_allclose(found.gain_covariance, covariances[:, 2:3, 2:3], rtol=1e-10)


def test_estimated_entries_are_those_of_an_extended_filter_with_parameters():
    def matrices(φ):
        moved = {"A": A + 0 * φ[0], "B": B + 0 * φ[0], "C": C + 0 * φ[0]}
        for value, (name, i, j) in zip(φ, ENTRIES, strict=True):
            moved[name] = moved[name].at[i, j].add(value)
        return moved["A"], moved["B"], moved["C"]

    nonlinear = NonlinearModel(
        lambda x, u, φ: matrices(φ)[0] @ x + matrices(φ)[1] @ u, lambda x, u, φ: matrices(φ)[2] @ x, Q=MODEL.Q, R=MODEL.R, dt=1,
        inputs=["u1"], parameters={f"φ{k}": 0.0 for k in range(len(ENTRIES))},
    )  # fmt: skip
    theirs = estimate(
        ExtendedKalman(nonlinear, parameters=Prior(np.zeros(len(ENTRIES)), np.diag(SIGMA**2))), RECORD, prior=PRIOR
    )
    ours = estimate(Kalman(MODEL, uncertainty=ModelUncertainty(**SD, treat="estimated")), RECORD, prior=PRIOR)
    assert_allclose(ours.mean, theirs.mean, rtol=1e-9, atol=1e-11)
    assert_allclose(ours.covariance, theirs.covariance, rtol=1e-9, atol=1e-11)
    assert_allclose(ours.log_likelihood, theirs.log_likelihood, rtol=1e-10)


@pytest.mark.parametrize("hold", ["zero_order", "first_order"])
def test_tangents_are_those_of_the_sampled_matrices_at_every_step(hold):
    continuous = StateSpace([[-1.0, 0.5], [2.0, -3.0]], [[0.0], [2.0]], Q=0.1 * np.eye(2), R=np.eye(2), dt=0)
    clock = Clock(np.array([0.1, 0.3]), np.array([0, 1, 0]), hold)
    filter = UnknownGain(continuous, GAIN, uncertainty=ModelUncertainty(relative=0.1))
    ready = filter.sampled(clock).ready
    found = ready.tangents
    assert found.count == 4  # not the entry -1 of A, nor the zero of B
    h, k = 1e-6, 1
    for j, (name, i, c) in enumerate([("A", 0, 1), ("A", 1, 0), ("A", 1, 1), ("B", 1, 0)]):
        moved = []
        for step in (h, -h):
            M = np.array(getattr(continuous, name))
            M[i, c] += step
            moved.append(UnknownGain(replace(continuous, **{name: M}), GAIN).sampled(clock).ready.at(k))
        for which in ("A", "B", *(["B_end"] if hold == "first_order" else [])):
            difference = (np.asarray(getattr(moved[0], which)) - getattr(moved[1], which)) / (2 * h)
            assert_allclose(getattr(found.at(k), which)[j], difference, atol=1e-8)


def test_unequal_steps_and_a_detector_use_it_too():
    continuous = StateSpace([[-1.0]], [[2.0]], Q=[[0.1]], R=[[0.01]], dt=0)
    t = np.cumsum(np.random.default_rng(1).choice([0.1, 0.14], size=60))
    u = np.sign(np.sin(2 * t))
    x = np.zeros(60)
    for k in range(59):
        x[k + 1] = x[k] * np.exp(t[k] - t[k + 1]) + 2.2 * (1 - np.exp(t[k] - t[k + 1])) * u[k]
    record, prior = Record(x, u, t=t), Prior([0.0], [[0.0]])
    plain, unsure = (
        ChangeDetection(
            UnknownGain(continuous, GAIN, uncertainty=one), slots=3, levels=2, seconds_between_false_alarms=1e9
        )
        for one in (None, ModelUncertainty(relative=0.1))
    )
    a, b = (estimate(one, record, prior=prior) for one in (plain, unsure))
    assert b.gain_standing[1][-1, 0] > 1.3 * a.gain_standing[1][-1, 0]
    low, _, middle, _, high = b.gain_quantiles[-1, 0]
    assert_allclose(np.log(high / middle), high_of(b) / middle - 1, rtol=1e-3)
    assert low < 1.1 < high


def high_of(result):
    """The upper end of the interval, if it were not skew."""
    middle, quantiles = result.gain_quantiles[-1, 0, 2], result.gain_quantiles[-1, 0]
    return middle * (1 + np.log(quantiles[4] / middle))


def test_a_gain_of_an_uncertain_b_has_the_skew_of_a_quotient_where_it_is_known_to_a_third():
    z = np.array([-1.959964, -0.994458, 0.0, 0.994458, 1.959964])
    quiet = replace(RECORD, u=0.02 * U)
    for variance, sharp in ((0.05, True), (0.2, False)):
        of_b, of_a = (
            estimate(UnknownGain(MODEL, Prior([0.9], [[variance]]), uncertainty=one), quiet, prior=PRIOR)
            for one in (ModelUncertainty(B=SD["B"] / 4), ModelUncertainty(A=SD["A"]))
        )
        gain, sigma = of_b.gain[:, 0], np.sqrt(of_b.gain_covariance[:, 0, 0])
        assert ((sigma < gain / 3) == sharp).all()
        skew = of_b.gain * np.exp(z * (sigma / gain)[:, None])
        assert_allclose(of_b.gain_quantiles[:, 0], skew if sharp else of_b.gain + z * sigma[:, None], rtol=1e-5)
        assert_allclose(
            of_a.gain_quantiles[:, 0] - of_a.gain, z * np.sqrt(of_a.gain_covariance[:, 0]), rtol=1e-5, atol=1e-12
        )


def test_a_diffuse_state_and_gain_begin_with_it():
    free = Prior([0.0, 0.0], np.zeros((2, 2)), diffuse=np.eye(2))
    small = ModelUncertainty(**{name: 1e-9 * sd for name, sd in SD.items()})
    wide = Prior([0.0], [[0.0]], diffuse=[[1.0]])
    plain, unsure = (estimate(UnknownGain(MODEL, wide, uncertainty=one), RECORD, prior=free) for one in (None, small))
    assert_allclose(unsure.gain[5:], plain.gain[5:], rtol=1e-6)
    assert_allclose(unsure.covariance[5:], plain.covariance[5:], rtol=1e-6)
    assert np.isnan(unsure.gain_quantiles[0]).all()


def test_it_is_a_section_of_model_files(tmp_path):
    given = ModelUncertainty(A=SD["A"], B=SD["B"])
    write_model(tmp_path / "a.toml", MODEL, PRIOR, gain=GainSection(GAIN, {}), uncertainty=given)
    assert "[uncertainty]" in (tmp_path / "a.toml").read_text()
    found = read_model(tmp_path / "a.toml").uncertainty
    assert_allclose(found.A, SD["A"])
    assert found.C is None
    write_model(tmp_path / "b.toml", MODEL, PRIOR, uncertainty=ModelUncertainty(relative=0.2, treat="estimated"))
    back = read_model(tmp_path / "b.toml").uncertainty
    assert (back.relative, back.treat) == (0.2, "estimated")


def test_each_fault_of_an_uncertainty_has_a_sentence(refused):
    def of(**settings):
        return refused(lambda: ModelUncertainty(**settings))[0]

    assert "nothing is uncertain" in of()
    assert "`A` must be standard deviations, at least 0" in of(A=[[-1.0]])
    assert "`treat` must be" in of(A=[[1.0]], treat="known")
    assert "`relative` must be" in of(relative=0.0)

    def with_(uncertainty, model=MODEL, gain=GAIN, **settings):
        return refused(lambda: UnknownGain(model, gain, uncertainty=uncertainty, **settings))[0]

    assert with_(ModelUncertainty(A=[[1.0]])) == "`uncertainty.A` must have the shape of A, (2, 2). Got (1, 1)."
    kinematic = StateSpace([[1.0]], [[1.0]], Q=[[1.0]], R=[[1.0]], dt=1)
    assert "names no entry" in with_(ModelUncertainty(relative=0.1), kinematic)
    assert "cannot distinguish a gain from the scale of B" in with_(ModelUncertainty(B=SD["B"], treat="estimated"))
    UnknownGain(MODEL, Prior([1.0], [[0.0]]), uncertainty=ModelUncertainty(B=SD["B"], treat="estimated"))
    UnknownGain(MODEL, GAIN, uncertainty=ModelUncertainty(A=SD["A"], treat="estimated"))
    assert "`directions` replace the B" in with_(ModelUncertainty(B=SD["B"]), directions=[[[1.0], [0.0]]])
    assert "must be ModelUncertainty" in with_(0.1) or "ModelUncertainty" in with_(0.1)
    unsure = Kalman(MODEL, uncertainty=ModelUncertainty(**SD))
    assert "does not support `uncertainty`" in refused(lambda: smooth(unsure, RECORD, prior=PRIOR))[0]
