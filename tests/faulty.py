"""Functions that go wrong at their k-th call, the clauses that call them, and what has to hold afterwards."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import apsw
import numpy as np
import pytest

import ss2sql

ENGINES = ("auto", "native")
VOLATILITIES = ("volatile", "stable")
SEARCH = "SELECT n FROM [1, 2, 3] START WITH n = 0, w = 1 CONNECT BY {} MAXIMUM 60 n = n + this, w = 1 STOP WITH {}"
CLAUSES = {
    "SELECT": "SELECT f(this) FROM t AS list;",
    "to": "SELECT to(f(this), first), to(f(-this), second) FROM t AS rows;",
    "WHERE": "SELECT this FROM t WHERE f(this) > 3 AS list;",
    "FROM": "SELECT a.this, b.this FROM a = t, b = [f(a.this), 7] AS rows;",
    "nested": "SELECT (SELECT f(b.this) FROM b = [a.this, 5] AS list) FROM a = t AS list;",
    "START WITH": "SELECT n FROM [1, 2] START WITH n = f(3) CONNECT BY NO CYCLE n = n + this STOP WITH n > 6;",
    "CONNECT BY": "SELECT n FROM [1, 2, 3] START WITH n = 0 CONNECT BY MAXIMUM 60 n = f(n) + this STOP WITH n > 5;",
    "MEMORIZE": "SELECT n FROM [1, 2] START WITH n = 0 CONNECT BY MEMORIZE 20 n = f(n) + this STOP WITH n > 5;",
    "STOP WITH": SEARCH.format("", "f(n) > 5;"),
    "COST": SEARCH.format("COST f(n) + 1", "n > 5;"),
    "HEURISTIC": SEARCH.format("COST 1 HEURISTIC 0 * f(n)", "n > 5;"),
    "PROBABILITY": SEARCH.format("PROBABILITY 1 / (2 + f(n))", "n > 5;"),
    "GROUP BY": "SELECT this FROM t GROUP BY f(this) AS list;",
    "HAVING": "SELECT sum(this) FROM t GROUP BY this % 5 HAVING f(sum(this)) > 3 AS list;",
    "ORDER BY": "SELECT this FROM t ORDER BY -f(this) AS list;",
    "AS": "SELECT this FROM t AS counted(f(3));",
    "expression": "x = f(1) + f(2); [x, f(3)];",
}


class MishapError(Exception):
    """An exception of the user's own."""


class Hostile:
    """Fails at whatever is done with it."""

    def _fail(self, *_: object) -> Any:
        raise MishapError("no")

    __eq__ = __bool__ = __repr__ = __lt__ = __len__ = __iter__ = __str__ = __add__ = __gt__ = _fail
    __hash__ = _fail  # type: ignore[assignment]


class OddList(list[Any]):
    __iter__ = __len__ = Hostile._fail  # type: ignore[assignment]


class OddInt(int):
    __index__ = Hostile._fail


def cyclic(*others: Any, times: int = 1) -> list[Any]:
    found: list[Any] = [*others]
    found.extend([found] * times)
    return found


def breaking() -> Iterator[int]:
    yield 1
    raise MishapError("no")


GARBAGE: dict[str, Callable[[], Any]] = {
    "NaN": lambda: float("nan"),
    "infinity": lambda: [float("-inf")],
    "complex": lambda: 1j,
    "huge": lambda: 10**5000,
    "cyclic": cyclic,
    "cyclic twice": lambda: cyclic(times=2),
    "cyclic among others": lambda: cyclic(1, "a", times=3),
    "cyclic dict": lambda: (made := {}, made.update(a=made, b=[made]))[0],
    "generator": breaking,
    "hostile": Hostile,
    "hostile inside": lambda: [[Hostile()], {"a": Hostile()}],
    "odd list": lambda: OddList([1, 2]),
    "odd int": lambda: OddInt(3),
    "array": lambda: np.array([[1.0, 2.0], [3.0, np.nan]]),
    "objects": lambda: np.array([Hostile(), 1], dtype=object),
    "NumPy number": lambda: [np.float64(3)],
    "surrogate": lambda: ["\ud800"],
    "bytes": lambda: b"\x00\xff",
    "None": lambda: None,
    "empty": list,
    "type": lambda: int,
    "text": lambda: "DROP TABLE t; --\x00",
}
RAISED = (MishapError, KeyError, StopIteration, ZeroDivisionError, MemoryError, RecursionError, OSError)
AGAIN: dict[str, Callable[[ss2sql.Session], Any]] = {
    "run": lambda ss: ss.run("SELECT f(this + 500) FROM [1, 2] AS list;"),
    "run natively": lambda ss: ss.run("SELECT f(this + 500) FROM [1, 2] AS list;", engine="native"),
    "fail inside": lambda ss: attempt(lambda: ss.run("SELECT 1 / this FROM [1, 0];")),
    "set": lambda ss: ss.set("other", [1, 2]),
    "attach": lambda ss: ss.attach("more", [1, 2]),
    "function": lambda ss: ss.function("f", ss.host.functions["f"].function, ss.host.functions["f"].volatility),
    "new function": lambda ss: ss.function("g", lambda x: x),
    "representation": lambda ss: ss.representation("other")(len),
    "tables": lambda ss: (ss.tables(), ss.variables(), ss.describe("t") if "t" in ss.tables() else None),
    "compile": lambda ss: ss.compile("SELECT f(this) FROM t;").run(),
}
ENDINGS: dict[str, Callable[[ss2sql.Session], Any]] = {
    "interrupt": ss2sql.Session.interrupt,
    "close": ss2sql.Session.close,
}
KINDS = (*GARBAGE, *(kind.__name__ for kind in RAISED), *AGAIN, *ENDINGS, "arity", "mutation")


def attempt(work: Callable[[], object]) -> Exception | None:
    try:
        work()
    except Exception as error:
        return error
    return None


class Patient:
    """A session whose function `f` gives its argument back, but goes wrong in one call."""

    def __init__(self, clause: str, engine: Any, volatility: Any) -> None:
        self.script, self.engine = CLAUSES[clause], engine
        self.session = ss2sql.connect()
        self.data = list(range(45))
        self.calls = self.left = 0
        self.fault: Callable[[Any], Any] = lambda x: x
        self.session.attach("t", self.data)
        self.session.set("kept", {"a": [1]})
        self.session.representation("counted")(lambda table, n: [n, len(table.rows)])
        self.session.function("f", self._called, volatility)
        self.answer = self.run()
        assert self.calls

    def _called(self, x: Any) -> Any:
        self.calls += 1
        self.left -= 1
        return x if self.left else self.fault(x)

    def run(self) -> Any:
        return self.session.run(self.script, engine=self.engine).value

    def suffer(self, kind: str, k: int) -> tuple[Any, Exception | None]:
        """The value of a run in which the k-th call goes wrong, or what it raised."""
        self.fault, self.left = self._fault(kind), k
        value: list[Any] = []
        with limited(20):
            error = attempt(lambda: value.append(self.run()))
        return (value or [None])[0], error

    @property
    def reached(self) -> bool:
        return self.left <= 0

    def _fault(self, kind: str) -> Callable[[Any], Any]:
        if kind in GARBAGE:
            return lambda x: GARBAGE[kind]()
        if kind in AGAIN or kind in ENDINGS:
            return lambda x: ((AGAIN.get(kind) or ENDINGS[kind])(self.session), x)[1]
        if kind == "arity":
            return lambda x: (self.session.function("f", lambda: 1), x)[1]
        if kind == "mutation":
            return lambda x: (self.data.clear(), x)[1]

        def fail(x: Any) -> Any:
            raise next(found for found in RAISED if found.__name__ == kind)("no")

        return fail

    def check(self) -> None:
        """Whether the session is as it was."""
        session, self.left = self.session, 0
        self.data[:] = range(45)
        host = session.host
        assert not any(memo.plain or memo.exact or memo.failures for memo in host.database.memos.values())
        if host.functions["f"].function != self._called:
            session.function("f", self._called, host.functions["f"].volatility)
        assert session.get("kept") == {"a": [1]}
        assert session.get("t") is self.data
        assert self.run() == self.answer
        check_idle(session)

    def close(self) -> None:
        self.session.close()


def check_idle(session: ss2sql.Session) -> None:
    """Asserts that nothing is under way in a session, and that it works."""
    host = session.host
    assert (host.runs, host.begun, host.database.stack) == ([], [], [])
    assert not host.connection.in_transaction
    assert session.run("SELECT this + 1 FROM [1, 2] AS list;").value == [2, 3]
    host.connection.execute("CREATE TABLE probe(a)")  # fails where a statement is still open on the schema
    host.connection.execute("DROP TABLE probe")


def endured(patient: Any, renewed: Callable[[], Any], judge: Callable[..., None], kind: str, k: int, at: str) -> Any:
    """Has one fault happen at the k-th call, and gives the patient for the next one."""
    value, error = patient.suffer(kind, k)
    try:
        judge(patient, kind, value, error)
        if kind != "close" or not patient.reached:
            patient.check()
            return patient
        with pytest.raises(ss2sql.SessionError, match="closed"):
            patient.session.run("1;")
        return renewed()
    except Exception as failure:
        failure.add_note(f"{kind} in call {k} of {at}: {error!r}")
        raise


@contextmanager
def limited(seconds: float) -> Iterator[None]:
    """What takes longer is a fault as well."""

    def late(*_: object) -> None:
        raise TimeoutError("it hangs")

    before = signal.signal(signal.SIGALRM, late)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def judge(patient: Patient, kind: str, value: Any, error: Exception | None) -> None:
    """Whether a run ended as it may: with an error of ours, or that of the user with its note."""
    if not patient.reached:
        assert error is None
        assert value == patient.answer
    elif kind in ENDINGS:
        assert isinstance(error, ss2sql.Cancelled)
    elif kind in AGAIN:
        assert error is None, error
        assert value == patient.answer
    elif kind in {found.__name__ for found in RAISED}:
        assert type(error).__name__ == kind
        assert len(error.__notes__) == 1  # type: ignore[union-attr]
        assert "by the function 'f'" in error.__notes__[0]  # type: ignore[union-attr]
    elif isinstance(error, ss2sql.Error):
        assert not isinstance(error.__cause__, apsw.Error)
        assert error.code in str(error)
    elif error is not None:
        assert type(error) is MishapError, repr(error)
        assert error.__notes__
