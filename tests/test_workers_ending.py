"""How runs with `workers` end before their time, and that no process outlives its session or its program."""

from __future__ import annotations

import gc
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
import worker_functions
from worker_runs import declare, graph, processes_of, same

import ss2sql


@pytest.fixture
def ss(eager: None, ss: ss2sql.Session) -> ss2sql.Session:
    return ss


def test_a_timeout_ends_the_processes(ss: ss2sql.Session) -> None:
    declare(ss, "onward")
    same(ss, graph())
    before = processes_of(ss)
    declare(ss, onward=worker_functions.endless)
    started = time.monotonic()
    with pytest.raises(ss2sql.Timeout) as caught:
        ss.run(graph(), workers=2, timeout=0.3)
    assert time.monotonic() - started < 5  # a call takes a minute
    assert caught.value.partial.status == "timeout"
    assert None not in [process.returncode for process in before]
    declare(ss, "onward")
    same(ss, graph())


@pytest.mark.usefixtures("usual")
@pytest.mark.parametrize("way", ["interrupt", "Ctrl-C"])
def test_an_interrupt_ends_the_processes(ss: ss2sql.Session, way: str) -> None:
    declare(ss, onward=worker_functions.endless)
    press = ss.interrupt if way == "interrupt" else lambda: os.kill(os.getpid(), signal.SIGINT)
    timer = threading.Timer(0.5, press)
    timer.start()
    started = time.monotonic()
    with pytest.raises(ss2sql.Cancelled):
        ss.run(graph(), workers=2)
    timer.join()
    assert time.monotonic() - started < 5
    assert processes_of(ss) == []


def test_closed_and_forgotten_sessions_leave_no_process(eager: None) -> None:
    left = []
    for forget in (False, True):
        session = ss2sql.connect()
        declare(session, "onward")
        same(session, graph())
        left += processes_of(session)
        if forget:
            del session
            gc.collect()
        else:
            session.close()
    assert len(left) == 4
    assert None not in [process.returncode for process in left]


KILLED = """
import os, signal, sys
sys.path.insert(0, {folder!r})
import ss2sql, worker_functions
from ss2sql.runtime.workers import foretelling, timing
timing.SAMPLES, timing.CHEAP, foretelling.LEAST, foretelling.START = 0, 0.0, 0.0, 0.0
foretelling.Foreteller._own_answer = lambda _: None
ss = ss2sql.connect()
ss.function("onward", worker_functions.onward, volatility="immutable")
ss.run({script!r}, workers=2)
print(*(process.pid for process in ss.host.processes._crew.processes), flush=True)
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_processes_end_with_a_program_that_is_killed() -> None:
    program = KILLED.format(folder=str(Path(__file__).parent), script=graph())
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
    assert done.returncode == -signal.SIGKILL, done.stderr
    left = [int(pid) for pid in done.stdout.split()]
    assert len(left) == 2
    for _ in range(500):
        left = [pid for pid in left if _is_alive(pid)]
        if not left:
            break
        time.sleep(0.01)
    assert left == []


def _is_alive(pid: int) -> bool:
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return False
    return stat.rpartition(")")[2].split()[0] != "Z"
