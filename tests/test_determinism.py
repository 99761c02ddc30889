"""The same bytes on every machine: SQL, explanations, rows, errors, pictures and files, whatever the hashes of texts
are, and in whatever order things were registered. See determinism.py for what is compared.

Twenty scripts are looked at closely each time, and all of them in the slow test.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys

import determinism
import golden
import pytest

EVERY, TWENTY = (20, 10**6), (1, 20)

# What may differ between machines besides the order of things, which is shuffled by the number.
MACHINES: tuple[dict[str, str], ...] = (
    {"PYTHONHASHSEED": "0", "TZ": "UTC", "LC_ALL": "C.UTF-8"},
    {"PYTHONHASHSEED": "1", "TZ": "Asia/Tokyo", "LC_ALL": "C", "PYTHONUTF8": "1"},
    {"PYTHONHASHSEED": "2", "TZ": "America/New_York", "LC_ALL": "POSIX", "PYTHONUTF8": "1"},
)


@pytest.mark.parametrize("chosen", [TWENTY, pytest.param(EVERY, marks=[pytest.mark.slow, pytest.mark.timeout(3600)])])
def test_three_machines_give_the_same_bytes(chosen: tuple[int, int]) -> None:
    first, *others = [finished(process) for process in [started(*machine, chosen) for machine in enumerate(MACHINES)]]
    assert [json.loads(line)[0] for line in first] == sorted(determinism.scripts(*chosen))
    for other in others:
        for one, same in zip(first, other, strict=True):
            assert json.loads(one) == json.loads(same)


def started(order: int, machine: dict[str, str], chosen: tuple[int, int]) -> subprocess.Popen[str]:
    environment = {**os.environ, **machine, "COLUMNS": "100", "PYTHONPATH": os.fspath(golden.FOLDER.parent)}
    given = [determinism.__file__, str(order), *map(str, chosen)]
    return subprocess.Popen(
        [sys.executable, *given], env=environment, stdout=subprocess.PIPE, text=True, encoding="utf-8"
    )


def finished(process: subprocess.Popen[str]) -> list[str]:
    output, _ = process.communicate()
    assert process.returncode == 0
    return output.splitlines()
