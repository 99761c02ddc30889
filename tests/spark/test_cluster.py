"""A search on a cluster of two executors on this machine, of which one is lost in the middle."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import warnings
from collections import Counter
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

SETTINGS = {
    "spark.ui.enabled": "false", "spark.ui.showConsoleProgress": "false", "spark.sql.shuffle.partitions": "2",
    "spark.log.level": "OFF", "spark.driver.memory": "600m", "spark.executor.memory": "600m",
}  # fmt: skip
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


def main(folder: Path) -> None:
    """Searches on a cluster, in a process of its own, as each has one session of Spark; prints what came of it."""
    warnings.simplefilter("ignore", FutureWarning)
    from pyspark.sql import SparkSession

    import ss2sql
    from ss2sql.runtime.external import level_steps

    level_steps.MAX_STATES = 0
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


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="the executor is found by /proc, which Linux has")
def test_an_executor_that_is_killed(tmp_path: Path) -> None:
    """Its task is begun anew by another one. What is counted belongs to the rows, so nothing is counted twice."""
    pytest.importorskip("pyspark")
    if shutil.which("java") is None:
        pytest.skip("Spark needs Java, which is not installed")
    done = subprocess.run(
        [sys.executable, __file__, str(tmp_path)],
        env={**os.environ, "PYSPARK_PYTHON": sys.executable, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        cwd=tmp_path, capture_output=True, text=True, timeout=540, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    told = json.loads(done.stdout.splitlines()[-1])
    # From 0 to 6 by steps of 1 and 2: 1, 2; 3, 4; 5, 6; of 6 the steps lead to itself.
    assert told == {"killed": True, "same": True, "counted": 14, "levels": [2, 2, 2, 0], "left": []}
    edges = Counter((tmp_path / "calls").read_text().splitlines())
    assert set(edges) == {f"{n} {more}" for n in range(7) for more in (1, 2)}
    # The native search, the lost executor, and the next one, whose task may be begun anew as well.
    assert max(edges.values()) <= 4


if __name__ == "__main__":
    main(Path(sys.argv[1]))
