"""`python -m tests.fuzz --minutes 30`: wrong calls until the time is over, and each fault with its seed."""

import argparse
import resource
import sys
import time
from collections import Counter
from collections.abc import Callable

from . import calls, command_line
from .baselines import baselines

MEMORY = 12 << 30  # bytes of address space: a call that needs more is a fault, not the end of this process


def main() -> int:
    """Run, and print the faults."""
    options = argparse.ArgumentParser(description=__doc__, prog="python -m tests.fuzz")
    options.add_argument("--minutes", type=float, default=5.0)
    options.add_argument("--calls", type=int, default=10**9)
    options.add_argument("--seed", type=int, default=0)
    options.add_argument(
        "--only", default="", help="names that hold this text; the commands are called `estimable gain`"
    )
    options.add_argument(
        "--checked", type=int, default=0, help="check the answers of calls in a second way, until there are so many"
    )
    given = options.parse_args()
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, resource.getrlimit(resource.RLIMIT_AS)[1]))
    counts, faults = fuzz(given.only, given.seed, given.calls, given.minutes, given.checked)
    ways = {name: counts.pop(name) for name in sorted(counts) if name.startswith("by ")}
    for words, call in sorted(faults.items()):
        print(f"{call}: {words}")
    for name, count in ways.items():
        print(f"{count:6}  {name}")
    print(f"{sum(counts.values()):,} calls: {dict(counts)}; {len(faults)} different faults")
    return 1 if faults else 0


def fuzz(only: str, seed: int, most: int, minutes: float, checked: int = 0) -> tuple[Counter[str], dict[str, str]]:
    """How often each outcome occurred, and each way to check an answer; {fault: the call}."""
    end, counts, faults = time.monotonic() + 60 * minutes, Counter[str](), dict[str, str]()
    names: list[tuple[str, Callable[[int], calls.Outcome]]] = [
        (one.name, lambda seed, one=one: calls.run(one, seed, check=checked > 0)) for one in baselines()
    ]
    names += [
        (f"estimable {name}", lambda seed, name=name: command_line.run(name, seed, check=checked > 0))
        for name in command_line.commands()
    ]
    names = [(name, run) for name, run in names if only in name]
    print(f"{len(names)} right calls of {len({name for name, _ in names})} names", file=sys.stderr)
    while True:
        for name, run in names:
            done = sum(counts[kind] for kind in counts if not kind.startswith("by "))
            if time.monotonic() > end or done >= most or 0 < checked <= counts["by a second way: answers"]:
                return counts, faults
            outcome = run(seed)
            counts[outcome.kind] += 1
            counts.update(f"by {way}" for way in outcome.ways)
            counts["by a second way: answers"] += bool(outcome.ways)
            if outcome.is_fault:
                faults.setdefault(
                    f"{outcome.kind} {outcome.words[:300]}", f"{name} seed {seed} {str(outcome.changed)[:200]}"
                )
        seed += 1


if __name__ == "__main__":
    sys.exit(main())
