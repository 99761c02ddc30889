"""What goes wrong at its k-th call, functions here and worlds in faulty_worlds, and what has to hold afterwards.

By default some faults are tried, drawn with a seed, and more of them by slow tests; `SS2SQL_FAULTS=all` tries all, and
`SS2SQL_FAULTS=3` those of another seed.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from random import Random
from typing import Any

import apsw
import numpy as np
import pytest

import ss2sql

WANTED = os.environ.get("SS2SQL_FAULTS", "1")
ALL = WANTED == "all"


def amounts(few: int, many: int) -> Any:
    """How many faults a test tries: few, or many where it may be slow, or all (None)."""
    return pytest.mark.parametrize("amount", [None] if ALL else [few, pytest.param(many, marks=pytest.mark.slow)])


# --- faults --------------------------------------------------------------------------------------------


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
    "NaN": lambda: float("nan"), "infinity": lambda: [float("-inf")], "complex": lambda: 1j, "huge": lambda: 10**5000,
    "cyclic": cyclic, "cyclic twice": lambda: cyclic(times=2), "cyclic among others": lambda: cyclic(1, "a", times=3),
    "cyclic dict": lambda: (made := {}, made.update(a=made, b=[made]))[0], "generator": breaking,
    "hostile": Hostile, "hostile inside": lambda: [[Hostile()], {"a": Hostile()}],
    "odd list": lambda: OddList([1, 2]), "odd int": lambda: OddInt(3),
    "array": lambda: np.array([[1.0, 2.0], [3.0, np.nan]]), "objects": lambda: np.array([Hostile(), 1], dtype=object),
    "NumPy number": lambda: [np.float64(3)], "surrogate": lambda: ["\ud800"], "bytes": lambda: b"\x00\xff",
    "None": lambda: None, "empty": list, "type": lambda: int, "text": lambda: "DROP TABLE t; --\x00",
}  # fmt: skip
RAISED = {found.__name__: found for found in (MishapError, KeyError, StopIteration, ZeroDivisionError, MemoryError,
                                              RecursionError, OSError)}  # fmt: skip
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
ENDINGS = {"interrupt": ss2sql.Session.interrupt, "close": ss2sql.Session.close}
EXITS = {found.__name__: found for found in (KeyboardInterrupt, SystemExit, GeneratorExit)}


def raising(kind: type[BaseException]) -> Callable[..., Any]:
    def fail(*_: Any) -> Any:
        raise kind("no")

    return fail


def doing(act: Callable[[Any], object]) -> Callable[[Patient, Any], Any]:
    """A fault that does something to the session and gives what the call would give."""
    return lambda patient, value: (act(patient.session), value)[1]


def making(make: Callable[[], Any]) -> Callable[[Patient, Any], Any]:
    return lambda patient, value: make()


COMMON: dict[str, Callable[[Any, Any], Any]] = {
    **{name: making(make) for name, make in GARBAGE.items()},
    **{name: raising(kind) for name, kind in RAISED.items()},
    **{name: doing(act) for name, act in ENDINGS.items()},
}


def attempt(work: Callable[[], object]) -> Exception | None:
    try:
        work()
    except Exception as error:
        return error
    return None


# --- patients ------------------------------------------------------------------------------------------


class Source:
    """Passes values on, but for one call."""

    def __init__(self) -> None:
        self.calls = self.left = 0
        self.wrong: Callable[[Any], Any] = lambda value: value

    def meet(self, value: Any) -> Any:
        self.calls += 1
        self.left -= 1
        return value if self.left else self.wrong(value)


class Patient:
    """A session in which one call goes wrong.

    Its class says what FAULTS there are, and how to `prepare` what the script needs.
    """

    FAULTS: dict[str, Callable[[Any, Any], Any]]
    AGAIN: dict[str, Callable[[ss2sql.Session], Any]]  # those that use the session again
    prepare: Callable[[], None]
    codes: tuple[str, ...] = ()  # of errors that garbage may make, where they are few
    own = True  # whether it is a function of the user that goes wrong, whose exceptions stay as they are

    def __init__(self, script: str, engine: Any, *arguments: Any, source: Source) -> None:
        self.script, self.engine, self.arguments, self.source = script, engine, arguments, source
        self.session = ss2sql.connect()
        self.session.set("kept", {"a": [1]})
        self.prepare()
        self.answer = self.run()
        self.calls = self.source.calls
        assert self.calls, "the script does not come there"

    def run(self) -> Any:
        value = self.session.run(self.script, engine=self.engine).value
        return value if isinstance(value, list) else list(value)

    @property
    def reached(self) -> bool:
        return self.source.left <= 0

    def endure(self, amount: int | None, places: Callable[[Random], list[int]]) -> None:
        """Has faults of so many kinds happen, or of all kinds, one in each run."""
        patient = self
        dice = Random(f"{WANTED} {self.script} {self.engine} {self.arguments}")
        for kind in self.FAULTS if amount is None else dice.sample(list(self.FAULTS), amount):
            for k in places(dice):
                try:
                    patient = patient.suffer(kind, k)
                except Exception as failure:
                    failure.add_note(f"{kind} in call {k} of {self.script}, {self.engine}, {self.arguments}")
                    raise
        patient.session.close()

    def suffer(self, kind: str, k: int) -> Patient:
        """Has the k-th call of a run go wrong, and gives the patient for the next run."""
        self.source.wrong, self.source.left = (lambda value: self.FAULTS[kind](self, value)), k
        value: list[Any] = [None]
        try:
            error: BaseException | None = attempt(lambda: value.append(self.run()))
        except (SystemExit, GeneratorExit, KeyboardInterrupt) as ending:
            error = ending
        self.judge(kind, value[-1], error)
        if kind == "close" and self.reached:
            with pytest.raises(ss2sql.SessionError, match="closed"):
                self.session.run("1;")
            return type(self)(*self.arguments)
        self.source.left = 0
        self.prepare()
        assert self.session.get("kept") == {"a": [1]}
        assert self.run() == self.answer
        check_idle(self.session)
        return self

    def judge(self, kind: str, value: Any, error: BaseException | None) -> None:
        """Whether a run ended as it may: with the answer, an error of ours, or that of the user with its note."""
        if not self.reached:
            assert (error, value) == (None, self.answer)
        elif kind in ("interrupt", "close", "KeyboardInterrupt"):
            assert isinstance(error, ss2sql.Cancelled)
        elif kind in EXITS:
            assert type(error) is EXITS[kind]
        elif error is None:
            raised = kind in RAISED or kind == "Gone"
            assert not raised or self.arguments[0] == "size"  # whose elements are asked for again
            assert not (raised or kind in self.AGAIN) or value == self.answer
        elif kind in self.AGAIN:
            assert kind in ("detach", "attach anew"), error
            assert isinstance(error, ss2sql.Error)
            assert error.code in ("X011", "X008", "S004"), error
        elif self.own and (kind in RAISED or type(error) is MishapError):
            assert type(error) is RAISED.get(kind, MishapError), repr(error)
            (note,) = error.__notes__
            assert "by the function" in note
        else:
            assert isinstance(error, ss2sql.Error), repr(error)
            assert not isinstance(error.__cause__, apsw.Error)
            assert error.code in str(error)
            assert error.span is not None or error.code == "T002"
            assert error.code in self.codes or not self.codes, error
            if kind in RAISED or kind == "Gone":
                assert (error.code, type(error.__cause__).__name__) == ("X011", kind)


def check_idle(session: ss2sql.Session) -> None:
    """Asserts that nothing is under way in a session, and that it works."""
    host = session.host
    assert (host.runs, host.active_runs, host.database.stack) == ([], [], [])
    assert not host.connection.in_transaction
    assert session.run("SELECT this + 1 FROM [1, 2] AS list;").value == [2, 3]
    host.connection.execute("CREATE TABLE probe(a)")  # fails where a statement is still open on the schema
    host.connection.execute("DROP TABLE probe")


# --- functions -----------------------------------------------------------------------------------------

SEARCH = "SELECT n FROM [1, 2, 3] START WITH n = 0, w = 1 CONNECT BY {} MAXIMUM 60 n = n + this, w = 1 STOP WITH {}"
CLAUSES = {
    "SELECT": "SELECT f(this) FROM t AS list;", "to": "SELECT to(f(this), first), to(f(-this), second) FROM t AS rows;",
    "WHERE": "SELECT this FROM t WHERE f(this) > 3 AS list;",
    "FROM": "SELECT a.this, b.this FROM a = t, b = [f(a.this), 7] AS rows;",
    "nested": "SELECT (SELECT f(b.this) FROM b = [a.this, 5] AS list) FROM a = t AS list;",
    "START WITH": "SELECT n FROM [1, 2] START WITH n = f(3) CONNECT BY NO CYCLE n = n + this STOP WITH n > 6;",
    "CONNECT BY": "SELECT n FROM [1, 2, 3] START WITH n = 0 CONNECT BY MAXIMUM 60 n = f(n) + this STOP WITH n > 5;",
    "MEMORIZE": "SELECT n FROM [1, 2] START WITH n = 0 CONNECT BY MEMORIZE 20 n = f(n) + this STOP WITH n > 5;",
    "STOP WITH": SEARCH.format("", "f(n) > 5;"), "COST": SEARCH.format("COST f(n) + 1", "n > 5;"),
    "HEURISTIC": SEARCH.format("COST 1 HEURISTIC 0 * f(n)", "n > 5;"),
    "PROBABILITY": SEARCH.format("PROBABILITY 1 / (2 + f(n))", "n > 5;"),
    "GROUP BY": "SELECT this FROM t GROUP BY f(this) AS list;",
    "HAVING": "SELECT sum(this) FROM t GROUP BY this % 5 HAVING f(sum(this)) > 3 AS list;",
    "ORDER BY": "SELECT this FROM t ORDER BY -f(this) AS list;", "AS": "SELECT this FROM t AS counted(f(3));",
    "expression": "x = f(1) + f(2); [x, f(3)];",
}  # fmt: skip


class Caller(Patient):
    """Its function `f` gives its argument back, but goes wrong in one call."""

    AGAIN = AGAIN
    FAULTS = {
        **COMMON,
        **{name: doing(act) for name, act in AGAIN.items()},
        "arity": doing(lambda session: session.function("f", lambda: 1)),
        "mutation": lambda patient, value: (patient.data.clear(), value)[1],
    }

    def __init__(self, clause: str, engine: Any, volatility: Any) -> None:
        self.data: list[int] = []
        self.called = self._called  # one object, by which it is known
        super().__init__(CLAUSES[clause], engine, clause, engine, volatility, source=Source())

    def _called(self, x: Any) -> Any:
        return self.source.meet(x)

    def prepare(self) -> None:
        session, self.data[:] = self.session, range(45)
        functions, memos = session.host.functions, session.host.database.memos.values()
        assert not any(memo.plain or memo.exact for memo in memos)
        if "f" not in functions:
            session.attach("t", self.data)
            session.representation("counted")(lambda table, n: [n, len(table.rows)])
        if "f" not in functions or functions["f"].function != self.called:
            session.function("f", self.called, self.arguments[-1])
        assert session.get("t") is self.data
