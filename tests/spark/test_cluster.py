"""An executor that is lost in the middle of a search."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="the executor is found by /proc, which Linux has")
def test_an_executor_that_is_killed(tmp_path: Path) -> None:
    """Its task is begun anew by another one. What is counted belongs to the rows, so nothing is counted twice.

    The other task of the level may be begun anew too, by the process that had it, which remembers calls.
    """
    pytest.importorskip("pyspark")
    if shutil.which("java") is None:
        pytest.skip("Spark needs Java, which is not installed")
    done = subprocess.run(
        [sys.executable, str(Path(__file__).parent / "cluster.py"), str(tmp_path)],
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
