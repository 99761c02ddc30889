"""Scripts of every kind of run, and what presses Ctrl-C while they run: for tests, and for benchmarks/interrupts.py.

Each kind has a session of its own, the true answer of its script, and a look at whether the session is as it was.
"""

from __future__ import annotations

import gc
import json
import mmap
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from random import Random
from tempfile import NamedTemporaryFile
from types import FrameType
from typing import Any

import apsw
import worker_functions

import ss2sql
from ss2sql.vtables import Column, Table, World

PRESS = """
import mmap, os, signal, struct, sys, time
shared = mmap.mmap(os.open(sys.argv[1], os.O_RDWR), 24)
CLOCK = ~os.getppid() << 3 | 2  # of the processor time that another process has had
for line in sys.stdin:
    number, times, delay = map(float, line.split())
    until = time.monotonic() + delay
    while time.monotonic() < until:
        time.sleep(max(0, min(0.001, until - time.monotonic() - 0.0005)))
    shared[8:] = struct.pack("dd", time.monotonic(), time.clock_gettime(CLOCK))
    for _ in range(int(times)):
        os.kill(os.getppid(), signal.SIGINT)
    shared[:8] = struct.pack("d", number)
"""


class Numbers(Table):
    name, key = "numbers", "n"
    columns = (Column("n", int), Column("square", int), Column("cube", int))
    groups = {"powers": "square cube"}

    def keys(self, where: Any) -> range:
        return range(150)

    def powers(self, key: int) -> tuple[int, int]:
        return slow(key) * key // 2, key**3


class NumberWorld(World):
    tables = (Numbers,)

    def __init__(self) -> None:
        super().__init__()


def slow(number: int) -> int:
    """Twice the number, in about 20 us."""
    total = 0
    for _ in range(400):
        total += 2
    return number * 2 + total - 800


def hop(place: int, step: int) -> int:
    return (place * 7 + step * 5 + slow(3) // 2) % 5003


@dataclass
class Kind:
    """A script, what it needs, and what it gives where nobody interrupts it, in a session of its own."""

    script: str
    functions: dict[str, tuple[Callable[..., Any], str]] = field(default_factory=dict)
    arguments: dict[str, Any] = field(default_factory=dict)
    first: list[Any] = field(default_factory=list)  # of the first statement, or found before they are sorted
    name: str = ""
    answer: list[Any] = field(default_factory=list)
    seconds: float = 0.0
    session: Any = None

    @contextmanager
    def opened(self, name: str, file: Path) -> Iterator[Kind]:
        """The same with a session, its true answer and how long that takes."""
        kind = replace(self, name=name)
        if "edges" in self.script:
            connection = apsw.Connection(str(file))
            connection.execute(EDGES)
            connection.close()
        with ss2sql.connect(file) as kind.session:
            for called, (function, volatility) in self.functions.items():
                kind.session.function(called, function, volatility=volatility)
            kind.session.attach("numbers", NumberWorld())
            for _ in range(2):
                started = time.perf_counter()
                kind.answer = kind.run()
                kind.seconds = time.perf_counter() - started
            assert len(kind.answer) > 10, name
            yield kind

    def run(self) -> list[Any]:
        self.session.graphs().drop()  # so every run is as long as the first one
        return _results(self.session.run(self.script, **self.arguments))

    def check(self, partial: ss2sql.Result | None) -> None:
        """Looks at what was found, and at the session."""
        if partial is not None:
            assert partial.status == "cancelled"
            assert isinstance(partial.explain(), str)
            rows = _results(partial)
            assert rows in (self.answer[: len(rows)], self.first[: len(rows)]), self.name
        check_session(self.session)


def _results(result: ss2sql.Result) -> list[Any]:
    return result.paths or list(result)


def check_session(session: ss2sql.Session) -> None:
    """Whether nothing of a run is left in a session, which can answer."""
    host = session.host
    assert (host.runs, host.active_runs, host.database.stack) == ([], [], [])
    assert not host.connection.in_transaction
    assert [memo.plain for memo in host.database.memos.values() if memo.plain] == []
    assert host.connection.status(apsw.SQLITE_DBSTATUS_CACHE_USED)[0] >= 0
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert session.eval("SELECT this + 1 FROM [1, 2] AS list;") == [2, 3]
    assert session.eval("SELECT this FROM [1, 2] WHERE this == 2 START WITH n = 0 CONNECT BY NO CYCLE n = this;")


EDGES = """CREATE TABLE edges(a INTEGER, b INTEGER);
WITH RECURSIVE n(i) AS (VALUES (0) UNION ALL SELECT i + 1 FROM n LIMIT 4000), k(i) AS (VALUES (1), (2), (3))
INSERT INTO edges SELECT n.i, n.i + k.i FROM n, k;"""
WALK = """SELECT hop(n, this) FROM [1, 2, 3, 4, 5] WHERE hop(n, this) % 5 == 0
START WITH n = 1, level = 1
CONNECT BY NO CYCLE MAXIMUM 1000 n = hop(n, this), level = level + 1 STOP WITH level == 7;"""
GRAPH = """SELECT hop(n, this) FROM [1, 2, 3, 4, 5] WHERE hop(n, this) % 5 == 0
START WITH n = 1 CONNECT BY MEMORIZE {} MAXIMUM 1500 n = hop(n, this);"""
HOP, SLOW = {"hop": (hop, "immutable")}, {"slow": (slow, "stable")}
KINDS = {
    "sql": Kind("SELECT a.this, b.this FROM a = range(150), b = range(150) WHERE a.this * b.this % 7 == 3;"),
    "function": Kind("SELECT slow(this) FROM range(1500);", SLOW, {"engine": "database"}),
    "world": Kind("SELECT a.n, b.square FROM a = numbers, b = numbers WHERE a.square % 5 == b.n % 7;"),
    "native": Kind(WALK, HOP, {"engine": "native"}),
    "memorize": Kind(GRAPH.format(5), HOP),
    "parallel": Kind(GRAPH.format(4), {"hop": (worker_functions.laborious, "immutable")}, {"workers": 2}),
    "search": Kind(WALK, HOP, {"engine": "database"}),
    "sorted": Kind("SELECT a.this, b.this FROM a = range(150), b = range(150) WHERE a.this % 3 == b.this % 5 "
                   "ORDER BY -b.this, a.this;",
                   first=[(a, b) for a in range(150) for b in range(150) if a % 3 == b % 5]),
    "statements": Kind("x = SELECT slow(this) FROM range(500) AS list; SELECT slow(this), 1 FROM x;",
                       {"slow": (slow, "stable")}, first=[(2 * n,) for n in range(500)]),
    "table": Kind("SELECT a, b FROM edges ORDER BY -b, a AS dict;"),
}  # fmt: skip


def kinds(folder: Path, *wanted: str) -> Iterator[Kind]:
    """Sessions for runs of all kinds, or of those that are wanted, one after the other."""
    for name in wanted or KINDS:
        with KINDS[name].opened(name, folder / f"{name}.db") as kind:
            yield kind
        gc.collect()  # sessions that have ended are gone before Ctrl-C is pressed again


def _ignore(*_: object) -> None:
    """What Ctrl-C does behind the work."""


class Presser:
    """Another process, which presses Ctrl-C after a delay, once or several times."""

    def __init__(self) -> None:
        self.file = NamedTemporaryFile()  # noqa: SIM115
        self.file.write(bytes(24))
        self.file.flush()
        self.shared = mmap.mmap(self.file.fileno(), 24)  # the last press: its number, the time, the processor's
        self.number = 0
        command = [sys.executable, "-c", PRESS, self.file.name]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, bufsize=0, start_new_session=True)

    def shoot(self, work: Callable[[], object], delay: float, times: int = 1) -> BaseException | None:
        """What the work has ended with, None if it was before Ctrl-C; `late` and `late_busy` say how long after it."""
        assert self.process.stdin is not None
        ended: list[tuple[BaseException | None, float, float]] = []
        self.number += 1
        try:
            self.process.stdin.write(b"%d %d %f\n" % (self.number, times, delay))
            try:
                work()
            except (ss2sql.Cancelled, KeyboardInterrupt) as raised:
                ended.append((raised, time.monotonic(), time.process_time()))
            else:
                ended.append((None, time.monotonic(), time.process_time()))
            signal.signal(signal.SIGINT, _ignore)
        except KeyboardInterrupt as second:
            signal.signal(signal.SIGINT, _ignore)
            if not ended:
                ended.append((second.__context__ or second, time.monotonic(), time.process_time()))
        while struct.unpack("d", self.shared[:8])[0] != self.number:  # it may come late, or once more
            time.sleep(0.0005)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        error, when, busy = ended[0]
        pressed, busy_then = struct.unpack("dd", self.shared[8:])
        self.late, self.late_busy = when - pressed, busy - busy_then
        return error

    def close(self) -> None:
        assert self.process.stdin is not None
        self.process.stdin.close()
        self.process.wait()
        self.shared.close()
        self.file.close()


@contextmanager
def pressing() -> Iterator[Presser]:
    """Somebody who presses Ctrl-C, handled in Python's way for as long as it lasts."""
    with as_usual():
        presser = Presser()
        try:
            yield presser
        finally:
            presser.close()


@contextmanager
def as_usual() -> Iterator[None]:
    """Ctrl-C does what it does in Python; a shell's job in the background ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def at_line(
    line: int, work: Callable[[], object], happens: Callable[[FrameType], object]
) -> tuple[BaseException | None, int]:
    """What some work raises while something happens at a line that Python comes to, and how many lines there were."""
    lines, error = 0, None

    def look(frame: FrameType, event: str, argument: Any) -> Any:
        nonlocal lines
        lines += 1
        if lines == line:
            happens(frame)
        return look

    before = sys.gettrace()
    try:
        sys.settrace(look)
        try:
            work()
        finally:
            sys.settrace(before)
    except (Exception, KeyboardInterrupt) as raised:
        error = raised
    return error, lines


def press(frame: FrameType) -> None:
    handler: Any = signal.getsignal(signal.SIGINT)
    handler(signal.SIGINT, frame)


def press_at(line: int, work: Callable[[], object]) -> tuple[BaseException | None, int]:
    """What the work ends with where Ctrl-C is pressed at a line."""
    error, lines = at_line(line, work, press)
    assert error is None or isinstance(error, (ss2sql.Cancelled, KeyboardInterrupt)), error
    return error, lines


def many(kind: Kind, presser: Presser, count: int, dice: Random) -> Iterator[None]:
    """Presses Ctrl-C in so many runs, once or twice, and looks at what is left; a turn for each."""
    done = 0
    while done < count:
        error = presser.shoot(kind.run, dice.uniform(0, kind.seconds), dice.choice((1, 1, 2)))
        kind.check(error.partial if isinstance(error, ss2sql.Cancelled) else None)
        if isinstance(error, ss2sql.Cancelled):  # else it was pressed before the run or after it
            done += 1
            yield
    assert kind.run() == kind.answer, kind.name


def main(folder: str, count: str, seed: str, *wanted: str) -> None:
    """Prints how many runs of each kind were cancelled."""
    with pressing() as presser:
        for kind in kinds(Path(folder), *wanted):
            print(json.dumps([kind.name, sum(1 for _ in many(kind, presser, int(count), Random(seed)))]), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
