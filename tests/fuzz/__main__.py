"""`python -m tests.fuzz --minutes 30`: wrong calls until the time is over, and every fault with what makes it again."""

import argparse
import sys
import time
from collections import Counter

from .baselines import baselines
from .calls import run


def main() -> int:
    """Run, and print the faults."""
    options = argparse.ArgumentParser(description=__doc__, prog="python -m tests.fuzz")
    options.add_argument("--minutes", type=float, default=5.0)
    options.add_argument("--calls", type=int, default=10**9)
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--only", default="", help="names that hold this text")
    given = options.parse_args()
    end, counts, faults = time.monotonic() + 60 * given.minutes, Counter[str](), dict[str, str]()
    all_of_them = [one for one in baselines() if given.only in one.name]
    print(f"{len(all_of_them)} right calls of {len({one.name for one in all_of_them})} names", file=sys.stderr)
    seed = given.seed
    while time.monotonic() < end and sum(counts.values()) < given.calls:
        for baseline in all_of_them:
            outcome = run(baseline, seed)
            counts[outcome.kind] += 1
            if outcome.kind not in ("answer", "refused"):
                faults.setdefault(f"{outcome.kind} {outcome.words}", f"{baseline.name} seed {seed} {outcome.changed}")
            if time.monotonic() > end or sum(counts.values()) >= given.calls:
                break
        seed += 1
    for words, call in sorted(faults.items()):
        print(f"{call}: {words}")
    print(f"{sum(counts.values()):,} calls: {dict(counts)}; {len(faults)} different faults")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
