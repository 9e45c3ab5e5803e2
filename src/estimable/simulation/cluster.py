"""The parts of a long computation on the workers of a Dask cluster."""

import inspect
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

from .. import __version__, checks
from ..errors import EstimableError

if TYPE_CHECKING:
    from distributed import Client, Future

PATIENCE = 4.0  # [s] for a scheduler to answer, and again for its first worker
RETURN = 60.0  # [s] for a worker to come back where all were lost
POLL = 0.02  # [s] between two looks for finished parts
REMEDY = "Without `scheduler` this machine is used."


class Unable(NamedTuple):
    """What a worker cannot do, and the reason."""

    what: str
    reason: str


def on_cluster(function: Callable[..., Any], calls: list[tuple], scheduler: str) -> Iterator[tuple[int, Any]]:
    """(number of the call, result) of each call, as they are ready.

    Raises `InputError` where no scheduler or no worker answers, or the workers cannot load an argument, which is named;
    `EstimableError` where the cluster ends before the work is done.
    """
    try:
        from distributed import CancelledError, KilledWorker
    except ImportError:
        checks.refuse("a cluster needs Dask: pip install 'estimable[cluster]'.")
    names = tuple(inspect.signature(function).parameters)
    sent = [_packed(names, call) for call in calls]
    with _client(scheduler) as client:
        futures = {
            client.submit(called, __version__, function, names, one, pure=False): i for i, one in enumerate(sent)
        }
        future = None
        try:
            for future in _finished(client, list(futures)):
                yield futures[future], _result(future, scheduler)
        except (OSError, KilledWorker, CancelledError) as error:
            if future is not None and future.status == "error" and not isinstance(error, KilledWorker):
                raise  # an error of `function`, as it would be raised here
            reason = error if isinstance(error, TimeoutError) else type(error).__name__
            raise EstimableError(
                f"the cluster at {scheduler} ended before the work was done ({reason}). Finished parts are in `folder`, if one "
                "was given: call again to continue."
            ) from error
        finally:
            client.cancel(list(futures))


def called(version: str, function: Callable[..., Any], names: tuple[str, ...], sent: tuple[bytes, ...]) -> Any:
    """What a worker does: `function` of the arguments, or why it cannot begin."""
    from distributed.protocol.pickle import loads

    if version != __version__:
        return Unable(f"load estimable {version}", f"they have version {__version__}")
    arguments = []
    for name, content in zip(names, sent, strict=True):
        try:
            arguments.append(loads(content))
        except Exception as reason:  # any error of the import of a user's module
            return Unable(f"load `{name}`", f"{type(reason).__name__}: {reason}")
    try:
        return function(*arguments)
    except ImportError as reason:
        return Unable("import what a run needs", f"{type(reason).__name__}: {reason}")


def _packed(names: tuple[str, ...], call: tuple) -> tuple[bytes, ...]:
    """Each argument as separate bytes: a worker then knows by name what it cannot load."""
    from distributed.protocol.pickle import dumps

    sent = []
    for name, argument in zip(names, call, strict=True):
        try:
            sent.append(bytes(dumps(argument)))
        except Exception as reason:  # any error of a user's class
            checks.refuse(f"`{name}` cannot be sent to the workers of a cluster: {checks.short(str(reason))}. {REMEDY}")
    return tuple(sent)


def _client(scheduler: str) -> "Client":
    """A client of the scheduler, which has a worker."""
    from distributed import Client

    try:
        client = Client(scheduler, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError) as error:
        checks.refuse(
            f"`scheduler`: no Dask scheduler answers at {scheduler!r} ({type(error).__name__}). Start one (dask scheduler) and "
            f'workers (dask worker), and give its address, such as "tcp://10.0.0.1:8786". {REMEDY}'
        )
    try:
        client.wait_for_workers(1, timeout=PATIENCE)
    except OSError:  # TimeoutError is one
        client.close()
        checks.refuse(
            f"`scheduler`: the Dask scheduler at {scheduler!r} has no workers. Start some (dask worker {scheduler}). {REMEDY}"
        )
    return client


def _finished(client: "Client", futures: list["Future"]) -> Iterator["Future"]:
    """The futures as they finish. Raises `TimeoutError` where the cluster has been without workers for `RETURN` seconds."""
    from distributed import as_completed

    ready, looked, lost = as_completed(futures, loop=client.loop), time.monotonic(), None
    while not ready.is_empty():
        if ready.has_ready():
            yield from ready.next_batch(block=False)
            continue
        time.sleep(POLL)
        if (now := time.monotonic()) > looked + 1:
            looked, lost = now, None if client.nthreads() else lost or now
            if lost is not None and now - lost > RETURN:
                raise TimeoutError(f"no workers for {RETURN:g} s")


def _result(future: "Future", scheduler: str) -> Any:
    """The result of a part; an error in it is raised as it would be here. Raises `InputError` where it could not begin."""
    try:
        result = future.result()
    except (ImportError, RuntimeError) as error:  # the scheduler and its workers load `called` before it can explain
        if not isinstance(error, ImportError) and "deserialization of the task graph" not in str(error):
            raise
        result = Unable(f"load estimable {__version__}", str(error.__cause__ or error))
    if isinstance(result, Unable):
        checks.refuse(
            f"the workers at {scheduler!r} cannot {result.what}: {result.reason}. The scheduler and its workers need this "
            "version of estimable, and the modules of the `summary` and the cases, but for those that your script defines itself."
        )
    return result
