"""One run of a benchmark in a process of its own, whose memory is that of this run alone."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from typing import Any

Told = dict[str, Any]


def tell(**figures: Any) -> None:
    """Prints what a run took, for `run_apart`: `cpu` in seconds, `peak` in MB, and whatever else."""
    print(json.dumps(figures))


def run_apart(file: str, arguments: Sequence[str], seconds: int) -> tuple[str, Told | None]:
    """Runs a Python file.

    Returns:
        A cell of a table, and what the run has told; nothing where it failed or took longer than so many seconds.
    """
    command = [sys.executable, file, *arguments]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=seconds, check=True)
    except subprocess.TimeoutExpired:
        return f"more than {seconds} s", None
    except subprocess.CalledProcessError as error:
        return (error.stderr.strip().splitlines() or ["failed"])[-1][:40], None
    told: Told = json.loads(done.stdout.strip().splitlines()[-1])
    return f"{told['cpu']:.2f} s, {told['peak']:,.0f} MB", told
