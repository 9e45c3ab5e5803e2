"""Strict arithmetic for every test: no silent promotion; no engine fails unseen; and nothing is compiled twice in a run."""

import gc
import logging
import os
from pathlib import Path

import jax
import pytest

import estimable  # noqa: F401  enables float64 before any array is made
from slow import SLOW, SLOW_FOLDERS

MAPS = 30_000  # of memory, above which a worker forgets what it has compiled

# XLA's programs are compiled without most optimisations, here and in the processes that tests start: it takes half the time.
# JAX_DISABLE_MOST_OPTIMIZATIONS=0 runs the tests with all of them.
os.environ.setdefault("JAX_DISABLE_MOST_OPTIMIZATIONS", "1")
jax.config.update("jax_disable_most_optimizations", os.environ["JAX_DISABLE_MOST_OPTIMIZATIONS"] != "0")
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")


def pytest_configure(config):
    """What one process has compiled the others read: workers, commands and examples inherit where it lies."""
    gc.set_threshold(50_000, 20, 50)  # what JAX traced is millions of objects: the collector looks at them less often
    os.environ.setdefault(
        "OPENBLAS_NUM_THREADS", "1"
    )  # workers beside each other: more threads than processors only wait
    os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(config.cache.mkdir("compiled")))
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.1")
    jax.config.update("jax_compilation_cache_dir", os.environ["JAX_COMPILATION_CACHE_DIR"])
    jax.config.update(
        "jax_persistent_cache_min_compile_time_secs", float(os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"])
    )


def pytest_collection_modifyitems(items):
    """`-m "not slow"` leaves out what takes seconds each."""
    tests = Path(__file__).parent
    for item in items:
        place = item.path.relative_to(tests) if item.path.is_relative_to(tests) else None
        if place and (place.parts[0] in SLOW_FOLDERS or item.name.partition("[")[0] in SLOW.get(place.as_posix(), ())):
            item.add_marker(pytest.mark.slow)


@pytest.fixture(autouse=True, scope="module")
def few_compiled_functions():
    """Each compiled function takes maps of memory, of which a process has 65,530: beyond them JAX crashes."""
    yield
    maps = Path("/proc/self/maps")
    if maps.exists() and maps.read_bytes().count(b"\n") > MAPS:
        jax.clear_caches()
        gc.collect()


@pytest.fixture(autouse=True)
def no_engine_fails(request, caplog):
    """An engine that `auto` passes over because it failed is a fault, although the answer is right."""
    yield
    if request.node.get_closest_marker("engine_fails") is None:
        records = [record for record in caplog.get_records("call") if record.name == "estimable.engines"]
        failed = [record.getMessage() for record in records if record.levelno >= logging.WARNING]
        assert not failed
