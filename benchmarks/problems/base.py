"""What a problem consists of: a script, the same work by other means, and what is compared between them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

BASE = "python"  # the contender that all others are divided by
ENGINES = ("database", "native")
ON_DUCKDB = "on-duckdb"  # the script with engine="duckdb", where that runs it
LIBRARIES = ("numpy", "networkx", "rustworkx", "igraph", "duckdb", "pybullet")
CONTENDERS = (*ENGINES, ON_DUCKDB, BASE, "numpy", "sql", "networkx", "rustworkx", "igraph", "duckdb", "duckdb-key")
COMPILING = "compiling"  # the only contender of problems that are not run


@dataclass(frozen=True)
class Script:
    """What ss2sql runs: text, and what the session holds.

    `functions` are registered, a pair with the volatility that it names, and `array_functions`, which take arrays.
    `file` is a SQLite file whose tables the script reads, `attached` are worlds by name. Where it is not `shaped`, the
    rows of the paths are found, but nobody asks for the value that AS makes of them, a copy of every row of every path.
    """

    text: str
    functions: tuple[Callable[..., Any] | tuple[Callable[..., Any], str], ...] = ()
    variables: Mapping[str, Any] = field(default_factory=dict)
    file: Path | None = None
    attached: Mapping[str, Any] = field(default_factory=dict)
    shaped: bool = True
    array_functions: tuple[Callable[..., Any], ...] = ()


@dataclass(frozen=True)
class Work:
    """What one contender does after its preparations: `run` is measured, `answer` makes what it gives comparable."""

    run: Callable[[], Any]
    answer: Callable[[Any], Any] | None = None  # None: that of the problem, for values of the script's own shape


Prepare = Callable[[int], Work]  # takes the size; what it does itself is not measured


@dataclass(frozen=True)
class Target:
    """At most so many times the seconds of another contender, from the size `since` on.

    `against` may also name another problem, whose seconds for the same contender count; with None, `most` is seconds.
    """

    most: float
    against: str | None = BASE
    contender: str = "database"
    since: int = 0


def bounds(database: float | None, native: float | None, since: int = 0) -> tuple[Target, ...]:
    """The targets of both engines beside Python by hand."""
    both = (("database", database), ("native", native))
    return tuple(Target(most, contender=name, since=since) for name, most in both if most is not None)


@dataclass(frozen=True)
class Problem:
    """One line of the table.

    `script` gives what ss2sql runs for a size; `others` are the remaining contenders, "python" among them: the same
    work by hand, over the same rows, with the same functions. `compared` says in words what `answer` makes of a value;
    all contenders have to give the same. `sizes` are measured by default, `full` with --full, `tiny` in the tests.
    """

    name: str
    about: str
    size_is: str
    sizes: tuple[int, ...]
    tiny: int
    script: Callable[[int], Script] | None
    others: Mapping[str, Prepare]
    compared: str
    answer: Callable[[Any], Any]
    full: tuple[int, ...] = ()
    targets: tuple[Target, ...] = ()

    @property
    def contenders(self) -> tuple[str, ...]:
        engines = (*ENGINES, ON_DUCKDB) if self.script else ()
        return tuple(name for name in (*CONTENDERS, COMPILING) if name in engines or name in self.others)


def same(value: Any) -> Any:
    """The answer of a problem whose values are compared as they are."""
    return value


def lengths(paths: list[list[Any]]) -> list[int]:
    """The answer of a problem whose contenders find paths of the same lengths, if not the same paths."""
    return [len(path) for path in paths]
