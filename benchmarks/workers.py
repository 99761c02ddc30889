"""What `workers` gains: a search with MEMORIZE whose function takes a millisecond, with one worker and with more.

`python benchmarks/workers.py [--workers 2] [--repeat 5]` prints a table. The function either waits or computes; waiting
shows what the messages cost, computing needs as many free cores. Both have to give the same bytes.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from statistics import median

from slow_moves import computing, waiting

import ss2sql

MOVES = [[0, 1], [0, 2], [1, 0], [1, 2], [2, 0], [2, 1]]
PLANS = """SELECT move(this, tower) FROM moves
WHERE goal == move(this, tower)
START WITH tower = start
CONNECT BY MEMORIZE MAXIMUM 20 tower = move(this, tower)
STOP WITH [] == move(this, tower);"""


def seconds(function: Callable[..., object], disks: int, workers: int) -> tuple[float, str, int]:
    """The time of one run in a session of its own, its result as text, and the number of calls."""
    with ss2sql.connect() as ss:
        ss.function("move", function, volatility="immutable")
        tower = list(range(disks, 0, -1))
        query = ss.compile(PLANS)
        values = {"moves": MOVES, "start": [tower, [], []], "goal": [[], [], tower]}
        started = time.perf_counter()
        result = query.run(workers=workers, **values)
        return time.perf_counter() - started, repr(result.value), result.stats.calls["move"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--disks", type=int, default=6)
    options = parser.parse_args()
    print(f"{'function':10} {'calls':>6} {'1 worker':>9} {options.workers:>3} workers {'median':>7} {'best':>6}")
    for function in (waiting, computing):
        pairs = []
        for _ in range(options.repeat):
            one = seconds(function, options.disks, 1)
            more = seconds(function, options.disks, options.workers)
            assert one[1:] == more[1:]
            pairs.append((one[0], more[0]))
        ratios = [one / more for one, more in pairs]
        alone, shared = (median(times) for times in zip(*pairs, strict=True))
        times = f"{alone:8.2f}s {shared:10.2f}s"
        print(f"{function.__name__:10} {one[2]:6} {times} {median(ratios):7.2f} {max(ratios):6.2f}")


if __name__ == "__main__":
    main()
