"""How long Ctrl-C takes: a process presses it at random moments in runs of every kind.

    .venv/bin/python benchmarks/interrupts.py [PRESSES]

For each kind of run it prints the median and the worst time until the run has ended: by the clock, and in seconds of
the processor, in which other programs on the machine do not count.
"""

from __future__ import annotations

import statistics
import sys
import tempfile
import warnings
from pathlib import Path
from random import Random

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

from interrupting import kinds, many, pressing


def main(count: int = 100) -> None:
    warnings.simplefilter("ignore")
    print(f"{'kind':12}{'run':>8}{'presses':>9}{'median':>9}{'worst':>9}{'busy':>9}{'worst':>9}   ms")
    with tempfile.TemporaryDirectory() as folder, pressing() as presser:
        for kind in kinds(Path(folder)):
            measured = [(presser.late * 1e3, presser.late_busy * 1e3) for _ in many(kind, presser, count, Random(1))]
            clock, busy = zip(*measured, strict=True)
            figures = (f"{number:9.1f}" for times in (clock, busy) for number in (statistics.median(times), max(times)))
            print(f"{kind.name:12}{kind.seconds * 1e3:8.0f}{len(measured):9}{''.join(figures)}", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
