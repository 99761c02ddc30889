"""Runs one program on the reference and on both executors and says where they differ."""

from __future__ import annotations

import contextlib
import io
from dataclasses import dataclass
from typing import Any

from programs import ProgramCase
from reference import Failure, Reference

import ss2sql

# A list function on what is certainly no list is refused before the run; the reference notices it later, or never.
EARLY = "R008 before the run"
# What functions of programs raise, and what Python itself does of a function that was called in a wrong way.
OF_USERS = {"ValueError", "TypeError", "ZeroDivisionError", "KeyError", "IndexError", "RuntimeError", "AttributeError"}


@dataclass(frozen=True)
class Outcome:
    """What a program came to: a value, our error code or the type of a user's exception, and what it printed."""

    value: Any = None
    error: str | None = None
    printed: str = ""


def code_of(error: ss2sql.Error) -> str:
    """The code of an error, or EARLY."""
    return EARLY if error.code == "R008" and "needs a list" in error.message else error.code


def exact(value: Any) -> Any:
    """The value with the type of every part, so that 1, 1.0 and True differ, and objects count by identity."""
    match value:
        case list() | tuple():
            return (type(value).__name__, *map(exact, value))
        case dict():
            return ("dict", *((exact(key), exact(item)) for key, item in value.items()))
        case set():
            return ("set", frozenset(map(exact, value)))
        case None | bool() | int() | str():
            return (type(value).__name__, value)
        case float():
            return ("float", repr(value))
        case _:
            return ("object", type(value).__name__)


def reference_outcome(case: ProgramCase) -> Outcome:
    return judged(Reference(case.functions, case.variables, case.tables, case.volatility), case.script)


def judged(judge: Reference, script: str) -> Outcome:
    """What a script comes to on a reference evaluator."""

    def printed() -> str:
        return "\n".join(judge.printed).rstrip("\n")

    try:
        value = judge.run(script)
    except Failure as failure:
        return Outcome(error=failure.code, printed=printed())
    except Exception as error:
        return Outcome(error=type(error).__name__, printed=printed())
    return Outcome(exact(value), printed=printed())


def session_for(case: ProgramCase, indexed: bool = False, **options: Any) -> ss2sql.Session:
    """A session with the functions, variables and tables of a program; `indexed` tables have one for each column."""
    ss = ss2sql.connect(**options)
    for name, function in case.functions.items():
        ss.function(name, function, volatility=case.volatility.get(name))
    for name, value in case.variables.items():
        if type(value) is int:  # attached it would be a client of PyBullet, where that has one of this number
            ss.set(name, value)
        else:
            ss.attach(name, value)
    for name, rows in case.tables.items():
        columns = list(rows[0])
        quoted = ", ".join(f'"{column}"' for column in columns)
        ss.host.connection.execute(f'CREATE TABLE "{name}"({quoted})')
        marks = ", ".join("?" * len(columns))
        ss.host.connection.executemany(f'INSERT INTO "{name}" VALUES ({marks})', [tuple(r.values()) for r in rows])
        for column in columns if indexed else ():
            ss.host.connection.execute(f'CREATE INDEX "{name} {column}" ON "{name}"("{column}")')
    return ss


def outcome(ss: ss2sql.Session, script: str, **options: Any) -> tuple[Outcome | None, str]:
    """What a script comes to, None where the engine refuses it; and the engine of the last query of a result."""
    output = io.StringIO()

    def ended(**parts: Any) -> Outcome:
        return Outcome(**parts, printed=output.getvalue().rstrip("\n"))

    with contextlib.redirect_stdout(output):
        try:
            result = ss.run(script, **options)
        except ss2sql.UnsupportedError:
            return None, ""
        except ss2sql.Error as error:
            return ended(error=code_of(error)), ""
        except Exception as error:
            return ended(error=type(error).__name__), ""
        return ended(value=exact(result.value)), result.engine


def executor_outcome(case: ProgramCase, engine: str, **options: Any) -> Outcome | None:
    """None where the engine refuses the program."""
    with session_for(case, **options) as ss:
        return outcome(ss, case.script, engine=engine)[0]


def is_allowed(found: Outcome | None, expected: Outcome, engine: str) -> bool:
    """Whether an engine may come to this where the reference evaluator comes to what is expected.

    The law about failures: SQL may answer or give up, Python decides. A value is the same on every engine; SQL may fail
    where it is demanded, in what the answer does not need. Where the reference fails, an engine may not have needed it,
    and which of several errors shows is nobody's business.
    """
    if found is None or found.error == EARLY:
        return True
    if expected.error is not None:
        return found.error is None or found.error[0] in "PRXUTV" or found.error in OF_USERS
    return engine not in ("auto", "native") if found.error is not None else found == expected


@dataclass(frozen=True)
class Trial:
    """What the reference and each executor made of a program."""

    case: ProgramCase
    expected: Outcome
    outcomes: dict[str, Outcome | None]

    @property
    def differences(self) -> list[str]:
        """One line per executor that disagrees with the reference."""
        return [
            f"{engine}: {outcome}\nreference: {self.expected}"
            for engine, outcome in self.outcomes.items()
            if not is_allowed(outcome, self.expected, engine)
        ]


def trial(case: ProgramCase) -> Trial:
    """Runs the program on all three; the database has an index on each column of its tables in every other program.

    Where SQL gives up, the engine `auto` has to find the value.
    """
    indexed = len(case.script) % 2 == 0
    expected = reference_outcome(case)
    found = {
        "native": executor_outcome(case, "native"),
        "database": executor_outcome(case, "database", indexed=indexed),
    }
    if expected.error is None and found["database"] is not None and found["database"].error is not None:
        found["auto"] = executor_outcome(case, "auto", indexed=indexed)
    return Trial(case, expected, found)


def differences(case: ProgramCase) -> list[str]:
    """One line per executor that disagrees with the reference."""
    return trial(case).differences
