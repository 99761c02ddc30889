"""A search on a cluster of two executors on this machine, of which one is killed in the middle. Prints what came of it.

    python cluster.py FOLDER

A process has one session of Spark, so this is a script of its own.
"""

from __future__ import annotations

import json
import os
import sys
import warnings
from pathlib import Path

SETTINGS = {
    "spark.ui.enabled": "false",
    "spark.ui.showConsoleProgress": "false",
    "spark.sql.shuffle.partitions": "2",
    "spark.log.level": "OFF",
    "spark.driver.memory": "600m",
    "spark.executor.memory": "600m",
}
SCRIPT = "SELECT deadly(n, this) FROM [1, 2] START WITH n = 0 CONNECT BY UNIQUE n = deadly(n, this) AS list;"


def kill_executor(folder: Path) -> None:
    """Kills the process of Java that this process of Python belongs to, if it is an executor."""
    number = os.getpid()
    while number > 1:
        number = int(Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[1])
        if b"CoarseGrainedExecutorBackend" in Path(f"/proc/{number}/cmdline").read_bytes():
            (folder / "killed").touch()
            os.kill(number, 9)
            return


def main() -> None:
    folder = Path(sys.argv[1])
    warnings.simplefilter("ignore", FutureWarning)
    from pyspark.sql import SparkSession

    import ss2sql
    from ss2sql.runtime.levels import beginning

    beginning.STATES = 0
    builder = SparkSession.builder.appName("tests").master("local-cluster[2,1,1024]")
    for name, value in SETTINGS.items():
        builder = builder.config(name, value)
    spark = builder.getOrCreate()
    spark.sparkContext.setCheckpointDir(str(folder / "checkpoints"))

    def deadly(n: int, more: int) -> int:
        """Kills its executor at the first call with 3."""
        with (folder / "calls").open("a") as file:
            file.write(f"{n} {more}\n")
        if n == 3 and not (folder / "killed").exists():
            kill_executor(folder)
        return min(n + more, 6)

    with ss2sql.connect(engine="spark", session=spark) as ss:
        ss.function("deadly", deadly, volatility="immutable")
        found = ss.run(SCRIPT)
        told = {
            "killed": (folder / "killed").exists(),
            "same": found.value == ss.run(SCRIPT, engine="native").value,
            "counted": found.stats.calls["deadly"] + found.stats.remembered["deadly"],
            "levels": [level.rows for level in found.stats.levels],
            "left": [str(path) for path in (folder / "checkpoints").rglob("*part*")],
        }
    print(json.dumps(told))
    spark.stop()


if __name__ == "__main__":
    main()
