"""How much of a search in Spark passes outside of its jobs, while it plans them: the 8-puzzle with all 181,440 boards.

    python benchmarks/spark_jobs.py [--cores 2] [--runs 2] [--steps 'sql;python'] [--set name=value ...]

The first run warms up Java; the last is told. A job counts from when it is submitted until it is completed, jobs at
the same time once. Prints a table for Markdown.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
import warnings
from typing import Any

import ss2sql

SLIDES = [
    {"at": at, "low": min(at, to), "high": max(at, to)}
    for at in range(9)
    for to in (at - 3, at - 1, at + 1, at + 3)
    if 0 <= to < 9 and (abs(at - to) == 3 or at // 3 == to // 3)
]
MOVED = "board[0:s.low] + board[s.high:s.high+1] + board[s.low+1:s.high] + board[s.low:s.low+1] + board[s.high+1:9]"
SCRIPT = """
    SELECT {moved} FROM s = slides WHERE board == "nowhere" START WITH board = "123456780"
    CONNECT BY UNIQUE board = {moved} STOP WITH board[s.at:s.at+1] != "0" AS list;
"""


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


def measure(spark: Any, text: str) -> tuple[float, int, float, int]:
    """Seconds, jobs, the share of the time outside of them, and rows."""
    with ss2sql.connect(engine="spark", session=spark) as ss:
        ss.function(moved, volatility="immutable")
        ss.set("slides", SLIDES)
        before, begin = len(jobs(spark)), time.time()
        result = ss.run(text)
        end = time.time()
    time.sleep(0.5)  # until the last job is noted
    inside, until = 0.0, 0.0
    found = sorted(jobs(spark))[before:]
    for start, stop in found:
        inside += max(0.0, stop - max(start, until))
        until = max(until, stop)
    return end - begin, len(found), 1 - inside / (end - begin), sum(level.rows for level in result.stats.levels)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cores", type=int, default=2)
    parser.add_argument("--runs", type=int, default=2)
    parser.add_argument("--steps", default="sql;python")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE")
    options = parser.parse_args()
    warnings.simplefilter("ignore", FutureWarning)  # pyspark about packages that are newer than itself
    from pyspark.sql import SparkSession

    os.environ["PYSPARK_PYTHON"] = sys.executable
    settings = {
        "spark.ui.enabled": "false",
        "spark.ui.showConsoleProgress": "false",
        "spark.ui.retainedJobs": "100000",
        "spark.sql.shuffle.partitions": str(options.cores),
        "spark.log.level": "OFF",
        **dict(one.split("=", 1) for one in options.set),
    }
    builder = SparkSession.builder.appName("benchmark").master(f"local[{options.cores}]")
    for name, value in settings.items():
        builder = builder.config(name, value)
    spark = builder.getOrCreate()
    print("| steps | seconds | jobs | outside of jobs | rows |\n|---|--:|--:|--:|--:|")
    texts = {"sql": SCRIPT.format(moved=MOVED), "python": SCRIPT.format(moved="moved(board, s.low, s.high)")}
    for steps in options.steps.split(";"):
        for _ in range(options.runs):
            seconds, number, outside, rows = measure(spark, texts[steps])
        print(f"| {steps} | {seconds:.1f} | {number} | {outside:.0%} | {rows:,} |", flush=True)
    spark.stop()


if __name__ == "__main__":
    main()
