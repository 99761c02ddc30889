"""Running command lines: in this process, and as processes of their own."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from ss2sql.cli import main

FUNCTIONS = '''
import math
from dataclasses import dataclass
from math import sqrt as root

__secret = 7

def double(x):
    """Twice the value."""
    return 2 * x

def broken(x):
    helper = x + "a"
    return helper

def lone():
    return "\\ud800"

def _hidden(x):
    return x

@dataclass
class Body:
    mass: float

print("loading")
'''

ENDLESS = "SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY n = n + 1"


def moved_into(folder: Path, monkeypatch: pytest.MonkeyPatch, files: Mapping[str, str]) -> Path:
    """The folder, with files by their names, as the current one; what is imported there is forgotten afterwards."""
    monkeypatch.chdir(folder)
    monkeypatch.setattr(sys, "path", list(sys.path))
    for name, text in files.items():
        (folder / name).write_text(text)
    return folder


def call(*arguments: str, stdin: str | bytes | None = None) -> Result:
    answer = CliRunner().invoke(main, arguments, input=stdin, env={"COLUMNS": "100"})
    if answer.exception is not None and not isinstance(answer.exception, SystemExit):
        raise answer.exception
    return answer


def good(*arguments: str, stdin: str | bytes | None = None) -> str:
    answer = call(*arguments, stdin=stdin)
    assert (answer.exit_code, answer.stderr) == (0, "")
    return answer.stdout


def bad(code: int, *arguments: str, stdin: str | bytes | None = None) -> str:
    answer = call(*arguments, stdin=stdin)
    assert (answer.exit_code, answer.stdout) == (code, "")
    return answer.stderr


def value(*arguments: str, stdin: str | bytes | None = None) -> Any:
    return json.loads(good("run", *arguments, "--format", "json", stdin=stdin))


def process(*arguments: str, **environment: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "ss2sql", *arguments]
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    return subprocess.Popen(command, text=True, encoding="utf-8", env={**os.environ, **environment}, **pipes)


def press_ctrl_c_after(begun: Path, answer: subprocess.Popen[str]) -> None:
    """Presses Ctrl-C a little after the process has made the file `begun`, or after 30 s."""
    for _ in range(600):
        if begun.exists():
            break
        time.sleep(0.05)
    time.sleep(0.2)
    answer.send_signal(signal.SIGINT)
