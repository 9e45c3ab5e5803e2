"""Calls in processes that are forked or spawned after the package was used: `python processes.py`, one line each."""

import multiprocessing
import os
import signal
import sys
import warnings

import numpy as np

import estimable as es

SECONDS = 20  # in which a call in a child must end
RECORD = es.Record(np.sin(np.arange(200.0)), dt=1)


def kalman(n):
    model = es.StateSpace(0.9 * np.eye(n) + 0.05, C=np.ones((1, n)), Q=0.1 * np.eye(n), R=[[0.2]], dt=1)
    return es.Kalman(model), es.Prior(np.zeros(n), np.eye(n))


def estimate(n, engine="auto"):
    algorithm, prior = kalman(n)
    return es.estimate(algorithm, RECORD, prior=prior, engine=engine).mean.tobytes()


def bank(n):
    algorithm, prior = kalman(n)
    records = [es.Record(np.sin(i + np.arange(50.0)), dt=1) for i in range(64)]
    return es.estimate_bank(algorithm, records, prior=prior).mean.tobytes()


def online(n):
    algorithm, prior = kalman(n)
    return steps(es.online(algorithm, prior=prior))


def steps(running):
    for y in np.sin(np.arange(9.0)):
        running.correct([float(y)])
        running.predict()
    return running.info.mean.tobytes()


def smooth(n):
    algorithm, prior = kalman(n)
    return es.smooth(algorithm, RECORD, prior=prior).mean.tobytes()


def simulate(n):
    return es.simulate(kalman(n)[0].model, seed=1, steps=20).record.y.tobytes()


def loop(n):
    algorithm, prior = kalman(n)
    model = es.StateSpace(algorithm.model.A, np.ones((n, 1)), algorithm.model.C, Q=algorithm.model.Q, R=[[0.2]], dt=1)
    law = es.StateFeedback(0.1 * np.ones((1, n)))
    reference = np.ones((20, 0))
    return es.close_loop(model, law, es.Kalman(model), reference=reference, seed=0, prior=prior).state.tobytes()


def identify(n):
    u = np.random.default_rng(0).normal(size=200)
    record = es.Record(np.convolve(u, [0, 1, 0.5])[:200], u, dt=1)
    return es.identify(es.LeastSquares(n, 1), record).parameters.tobytes()


def instruments(n):
    u = np.random.default_rng(0).normal(size=200)
    record = es.Record(np.convolve(u, [0, 1, 0.5])[:200], u, dt=1)
    return es.identify(es.InstrumentalVariables(n, 1), record).parameters.tobytes()


def fit_noise(n):
    algorithm, prior = kalman(n)
    return es.fit_noise(algorithm, RECORD, prior=prior, free=("R",)).parameters.tobytes()


def xla(n):
    return estimate(n, "xla")


CALLS = estimate, bank, smooth, identify, instruments, xla, online, simulate, loop, fit_noise


def forked(call):
    """How a call ends in a forked process: its bytes, its sentence, or "hang"."""
    read, write = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # JAX's own, that forks are dangerous
        child = os.fork()
    if child == 0:
        signal.alarm(SECONDS)
        try:
            answer = call()
        except es.EstimableError as error:
            answer = str(error).encode()
        os.write(write, answer[:4000])
        os._exit(0)
    os.close(write)
    with os.fdopen(read, "rb") as stream:
        answer = stream.read()
    os.waitpid(child, 0)
    return answer or b"hang"


def saved():
    """An online run in a file."""
    algorithm, prior = kalman(1)
    es.online(algorithm, prior=prior).save("run.npz")


def main():
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        spawned = pool.map_async(estimate, [1, 3, 3]).get(60)
    running = [es.online(*kalman(1)[:1], prior=kalman(1)[1]) for _ in range(2)]
    saved()
    before = {call: call(1) for call in CALLS}
    ends = {f"spawn pool 1: {_compared(spawned[0], before[estimate])}"}
    for call in CALLS:
        for n in (1, 2):  # used before the fork, and new
            answer = forked(lambda call=call, n=n: call(n))
            ends.add(f"fork {call.__name__} {n}: {_compared(answer, before[call] if n == 1 else call(n))}")
    answer = forked(lambda: estimate(3))  # in the cache on the disk
    ends.add(f"fork cached: {_compared(answer, estimate(3))}")
    loaded = forked(lambda: steps(es.load("run.npz")))
    inherited, expected = forked(lambda: steps(running[0])), steps(running[1])
    ends |= {f"fork inherited: {_compared(inherited, expected)}", f"fork loaded: {_compared(loaded, expected)}"}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with multiprocessing.get_context("fork").Pool(2) as pool:
            found = pool.map_async(estimate, [1, 1, 1]).get(60)
    ends.add(f"fork pool: {_compared(b''.join(found), 3 * before[estimate])}")
    print(*sorted(ends), sep="\n")


def _compared(answer, expected):
    return "the same" if answer[:4000] == expected[:4000] else answer.decode(errors="replace")


if __name__ == "__main__":
    sys.exit(main())
