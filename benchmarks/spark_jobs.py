"""How much of a search in Spark passes outside of its jobs, while it plans them: the 8-puzzle with all 181,440 boards.

    python benchmarks/spark_jobs.py [--cores 2] [--runs 3] [--steps 'native;sql;python'] [--set name=value ...]

The first runs warm up Java; the last is told. A job counts from when it is submitted until it is completed, jobs at
the same time once. `native` is the search in Python, with the steps of `python`. Prints a table for Markdown.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

from boards import SLIDES, script
from family import processor
from local_spark import local_spark

import ss2sql


def moved(board: str, low: int, high: int) -> str:
    """The board with two fields swapped, for steps in Python; a loop is no expression."""
    fields = list(board)
    for one, other in ((low, high),):
        fields[one], fields[other] = fields[other], fields[one]
    return "".join(fields)


def jobs(spark: Any) -> list[tuple[float, float]]:
    """When each job began and ended."""
    store = spark.sparkContext._jsc.sc().statusStore().jobsList(None)
    found = [store.apply(number) for number in range(store.size())]
    return [(one.submissionTime().get().getTime() / 1e3, one.completionTime().get().getTime() / 1e3) for one in found]


def measure(spark: Any, engine: Any, text: str) -> tuple[float, float, int, float]:
    """Seconds, those of processors, jobs, and the share of the time outside of them."""
    with ss2sql.connect(engine=engine, session=spark) as ss:
        ss.function(moved, volatility="immutable")
        ss.set("slides", SLIDES)
        before, busy, begin = len(jobs(spark)), processor(), time.time()
        ss.run(text)
        end, busy = time.time(), processor() - busy
    time.sleep(0.5)  # until the last job is noted
    inside, until = 0.0, 0.0
    found = sorted(jobs(spark))[before:]
    for start, stop in found:
        inside += max(0.0, stop - max(start, until))
        until = max(until, stop)
    return end - begin, busy, len(found), 1 - inside / (end - begin)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cores", type=int, default=2)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--steps", default="native;sql;python")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE")
    options = parser.parse_args()
    settings = dict(one.split("=", 1) for one in options.set)
    spark = local_spark(options.cores, **{"spark.ui.retainedJobs": "100000", **settings})
    print("| steps | seconds | of processors | jobs | outside of jobs |\n|---|--:|--:|--:|--:|")
    texts = {"sql": script(), "python": script("moved(board, s.low, s.high)")}
    texts["native"] = texts["python"]
    for steps in options.steps.split(";"):
        for _ in range(options.runs):
            found = measure(spark, "native" if steps == "native" else "spark", texts[steps])
        seconds, busy, number, outside = found
        told = f"{number} | {outside:.0%}" if number else "|"
        print(f"| {steps} | {seconds:.1f} | {busy:.1f} | {told} |", flush=True)
    spark.stop()


if __name__ == "__main__":
    main()
