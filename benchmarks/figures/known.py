"""How well covariance analysis is computed: sigma against the textbook filter with 80 digits, and what units may not change.

    python -m benchmarks.figures.known --models 240

prints, for each kind of model, the largest relative error of sigma over all samples (by powers of two, sample by sample, of the
model alone), the number of verdicts and times that turn when the states and the sensors change their units by factors of 1e-6 to
1e6, the number of times to a requirement that are not exact to the sample, and the time of 20 octaves at n = 15, 60 and 200.
"""

import argparse
import time

import mpmath as mp
import numpy as np

import estimable as es

KINDS = ("stable", "growing", "delays", "integrators", "hidden", "marginal")
PRIORS = (0.0, 1.0, 1e6, 1e10, 1e14)
SAMPLES = 26


def drawn(seed):
    """A model of one of the kinds, and its prior."""
    rng = np.random.default_rng(seed)
    n, p = int(rng.integers(1, 7)), int(rng.integers(1, 3))
    A, C, G = rng.normal(size=(n, n)), rng.normal(size=(p, n)), rng.normal(size=(n, int(rng.integers(1, n + 1))))
    A /= np.abs(np.linalg.eigvals(A)).max()
    match KINDS[seed % len(KINDS)]:
        case "stable":
            A *= 0.9
        case "growing":
            A *= rng.uniform(1.1, 2.0)
        case "delays":
            A, G, C = np.eye(n, k=-1), np.eye(n)[:, :1], np.eye(n)[-1:]
            A[0, 0] = 0.5
        case "integrators":
            A, G, C = np.eye(n) + 0.1 * np.eye(n, k=1), 0.01 * np.eye(n)[:, -1:], np.eye(n)[:1]
        case "hidden":
            k = n // 2
            A[:k, k:] = A[k:, :k] = 0
            C[:, k:] = 0
    variance = PRIORS[int(rng.integers(len(PRIORS)))]
    model = es.StateSpace(A, C=C, G=G, Q=np.eye(G.shape[1]), R=0.01 * np.eye(len(C)), dt=1)
    return model, es.Prior(np.zeros(n), variance * np.eye(n))


def exact(model, prior, samples=SAMPLES):
    """Sigma (T, n) with and without the outputs, with 80 digits."""
    number = np.vectorize(lambda x: mp.mpf(float(x)), otypes=[object])
    with mp.workdps(80):
        A, G, C, R, P = (number(M) for M in (model.A, model.G, model.C, model.R, prior.covariance))
        Q, Π, rows = G.dot(G.T), P, []
        for k in range(samples):
            if k:
                P, Π = A.dot(P).dot(A.T) + Q, A.dot(Π).dot(A.T) + Q
            S = mp.matrix((C.dot(P).dot(C.T) + R).tolist()) ** -1
            gain = P.dot(C.T).dot(np.array(S.tolist(), object).reshape(len(C), len(C)))
            P = P - gain.dot(C).dot(P)
            rows.append([[float(mp.sqrt(abs(x))) for x in np.diagonal(M)] for M in (P, Π)])
    rows = np.array(rows)
    return rows[:, 0], rows[:, 1]


def errors(seed):
    """The largest relative errors of sigma: by powers of two, sample by sample, and of the model alone."""
    model, prior = drawn(seed)
    σ, alone = exact(model, prior)
    doubled = es.covariance_analysis(model, prior=prior, horizon=SAMPLES)
    rows = es.StateSpace(np.stack([model.A] * SAMPLES), C=model.C, G=model.G, Q=model.Q, R=model.R, dt=1)
    single = es.covariance_analysis(rows, prior=prior)

    def largest(found, right):
        return float(np.max(np.abs(found - right) / np.where(right > 0, right, 1.0)))

    return largest(doubled.sigma, σ), largest(single.sigma, σ), largest(doubled.prior_sigma, alone)


def turned(seed):
    """How many verdicts and times of a model change with the units of its states and sensors; and how many there are."""
    model, prior = drawn(seed)
    rng = np.random.default_rng(seed + 10_000)
    units, gains = 10.0 ** rng.uniform(-6, 6, model.n), 10.0 ** rng.uniform(-6, 6, model.p)
    other = es.StateSpace(
        units[:, None] * model.A / units, C=gains[:, None] * model.C / units, G=units[:, None] * model.G, Q=model.Q,
        R=gains[:, None] * model.R * gains, dt=1,
    )  # fmt: skip
    first = es.covariance_analysis(model, prior=prior, horizon=60)
    end = np.where(np.isfinite(first.sigma[-1]) & (first.sigma[-1] > 0), first.sigma[-1], 1.0)
    required = {name: float(1.5 * one) for name, one in zip(model.states, end, strict=True)}
    found = es.covariance_analysis(model, prior=prior, horizon=60, requirement=required)
    scaled = {name: value * unit for (name, value), unit in zip(required.items(), units, strict=True)}
    again = es.covariance_analysis(other, prior=prior.in_basis(np.diag(units)), horizon=60, requirement=scaled)
    flips = sum(a != b for a, b in zip(found.verdicts, again.verdicts, strict=True))
    moved = int(np.sum(~np.isclose(found.time_to_requirement, again.time_to_requirement, equal_nan=True)))
    return flips, moved, len(found.verdicts)


def inexact(seed):
    """How many times to a requirement are not those of every sample with 80 digits; and how many there are."""
    model, prior = drawn(seed)
    σ, _ = exact(model, prior, 60)
    required = 1.3 * σ[-1]
    given = {name: float(r) for name, r in zip(model.states, required, strict=True) if r > 0}
    found = es.covariance_analysis(model, prior=prior, horizon=60, requirement=given)
    wrong = count = 0
    for i, name in enumerate(model.states):
        if name in given:
            unmet = np.flatnonzero(σ[:, i] > required[i])
            right = 0.0 if len(unmet) == 0 else unmet[-1] + 1.0
            wrong += found.time_to_requirement[i] != right
            count += 1
    return int(wrong), count


def seconds(n, octaves=20):
    """The time of so many octaves of sigma, and of today's `estimability` in steady state, at n states."""
    rng = np.random.default_rng(n)
    A = rng.normal(size=(n, n))
    A *= 0.999 / np.abs(np.linalg.eigvals(A)).max()
    model = es.StateSpace(A, C=rng.normal(size=(3, n)), Q=np.eye(n), R=np.eye(3), dt=1)
    prior, taken = es.Prior(np.zeros(n), np.eye(n)), []
    for question in (
        lambda: es.covariance_analysis(model, prior=prior, horizon=2**octaves), lambda: es.estimability(model)
    ):  # fmt: skip
        begin = time.process_time()
        question()
        taken.append(time.process_time() - begin)
    return taken


def main():
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--models", type=int, default=60)
    models = parser.parse_args().models
    for kind in range(len(KINDS)):
        worst = np.max([errors(seed) for seed in range(kind, models, len(KINDS))], axis=0)
        print(f"{KINDS[kind]:12s} doubling {worst[0]:.1e}  sequential {worst[1]:.1e}  alone {worst[2]:.1e}", flush=True)
    flips = np.sum([turned(seed) for seed in range(models)], axis=0)
    print(f"units: {flips[0]} of {flips[2]} verdicts and {flips[1]} times turned", flush=True)
    wrong = np.sum([inexact(seed) for seed in range(models)], axis=0)
    print(f"times to a requirement: {wrong[0]} of {wrong[1]} not exact to the sample", flush=True)
    for n in (15, 60, 200):
        ours, theirs = seconds(n)
        print(f"n = {n}: 20 octaves {ours:.2f} s of processor time, estimability {theirs:.2f} s")


if __name__ == "__main__":
    main()
