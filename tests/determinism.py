"""All that scripts give, as one line of JSON each: `python tests/determinism.py ORDER RARE MOST`.

The scripts are those of tests/cases, and some of the command line: all of them, or MOST, which are spread over them.
One in RARE is looked at more closely: it runs on the native engine too, among names like its own, and of one in ten of
them a picture is drawn.

ORDER is a number that should not matter. By it are shuffled: the order in which functions, values, tables and
representations are registered, the order in which the scripts run in this process, and where objects lie in memory.
The lines are sorted, so that they can be compared.
"""

from __future__ import annotations

import io
import json
import os
import random
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from zlib import crc32

import apsw
import golden
from cases import needs
from click.testing import CliRunner

import ss2sql
from ss2sql.cli import main

Register = Callable[[ss2sql.Session], object]
Told = dict[str, Any]

SETS = """
    names = SELECT this FROM ["d", "a", "b", "c"] AS set;
    SELECT names, this FROM [["b", 1], ["a", 2], [None, 3], "e", 2.5] AS set;
"""
COMMANDS = (
    *(("list", what) for what in ("functions", "representations", "strategies", "worlds", "errors")),
    *(("run", "-e", SETS, "--format", form) for form in ("table", "json", "csv")),
    ("explain", "-e", SETS),
    ("bench", "--help"),
)
MORE_TABLES = ("codes", "sizes")
TIMES = ("created", "used")  # columns of tables of remembered graphs

# Scripts that mention all that is registered, or nearly what is, or sets of what has no common order.
MORE_SCRIPTS = {
    "help": "help();",
    "typos": "lenn([1]); neighbourx(1); SELECT this FROM peoplez; SELECT move FROM edgey;",
    "sets": "SELECT bag_of(this), len(bag_of(this)) FROM [1, 2];",
    "set-of-sets": "SELECT bag_of(this) FROM [1, 2] AS set;",
    "graph-of-sets": """SELECT this FROM bag_of(1) WHERE n == 2 START WITH n = 0, seen = bag_of(0)
        CONNECT BY MEMORIZE 2 n = n + 1, seen = bag_of(n) AS list;""",
}
# Names as near to those in scripts as others here are, so that hints have to choose.
MORE_FUNCTIONS = ("mover", "moved_", "neighbour", "neighbourz", "masses", "masse", "leng", "lent", "sums", "lenz")
MORE_VALUES = ("peoples", "peopled", "edgez", "edgex", "numbers", "numberz", "moves_", "moves2", "xs_", "xs2")


def like(x: Any) -> Any:
    return x


def bag_of(x: Any) -> Any:
    return {"b", "a", ("x", 1), ("x", "y"), None, 2.5, 3, frozenset({"d", "c"}), frozenset({"e"}), "long" * 9, b"a", x}


def scripts(rare: int, most: int) -> dict[str, Callable[[random.Random], Told]]:
    """What there is to run, by name; each is given what shuffles."""
    cases = {case.name: partial(of_case, case, crc32(case.name.encode()) % rare == 0) for case in golden.cases()}
    for name, text in MORE_SCRIPTS.items():
        case = golden.Case(golden.FOLDER / "more" / name, name, ("people", "csv"), text)
        cases[case.name] = partial(of_case, case, True)
    commands = {f"ss2sql {' '.join(given)}": partial(of_command, given) for given in COMMANDS}
    found = {**cases, **commands}
    return {name: found[name] for name in list(found)[:: max(1, len(found) // most)]}


# --- sessions that are furnished in any order ------------------------------------------------------------


def of_case(case: golden.Case, closely: bool, shuffle: random.Random) -> Told:
    """A golden case."""
    own = [partial(needs.furnish, needs=[name]) for name in case.needs]
    wanted = [name for name in case.needs if name in needs.TABLES]
    tables = [*dict.fromkeys((*wanted, *MORE_TABLES))] if wanted else []
    crowd = OTHERS if closely or "error" in case.expected else ()
    picture = closely and case.name.encode()[-1] % 10 == 0
    told = {}
    for engine in ("auto", "native") if closely else ("auto",):
        shuffle.shuffle(tables)
        with file_for(case.script, tables) as path:
            with furnished(path, [*own, *crowd], shuffle) as session:
                told[engine] = all_of(session, case.script, engine, picture)
            told[engine]["file"] = contents(path)
    return told


def of_command(given: Sequence[str], shuffle: random.Random) -> Told:
    """What the command line prints."""
    return {"printed": CliRunner().invoke(main, given).output}


@contextmanager
def file_for(script: str, tables: Sequence[str]) -> Iterator[Path | None]:
    """A file with the tables, or for graphs, of the same name every time; None where the script needs none."""
    with TemporaryDirectory() as folder:
        before = Path.cwd()
        os.chdir(folder)
        try:
            path = needs.database(Path(), tables)
            yield path or (Path("graphs.db") if "MEMORIZE" in script else None)
        finally:
            os.chdir(before)


@contextmanager
def furnished(path: Path | None, things: list[Register], shuffle: random.Random) -> Iterator[ss2sql.Session]:
    """A session with these things."""
    shuffle.shuffle(things)
    garbage = [object() for _ in range(shuffle.randrange(500))]  # a value's place in memory is another then
    with ss2sql.connect(path) as session:
        for register in things:
            register(session)
        del garbage[:: shuffle.randrange(2, 9)]
        yield session


def registered(session: ss2sql.Session, name: str, function: Any) -> None:
    session.function(name, function)


def attached(session: ss2sql.Session, name: str, value: Any) -> None:
    session.attach(name, value)


# --- what is told of a script ----------------------------------------------------------------------------


def all_of(session: ss2sql.Session, script: str, engine: str, picture: bool) -> Told:
    """What the session says of a script before it runs, and what comes of the run; times are left out."""
    told: Told = {"before": attempt(lambda: explained(session.compile(script, engine).explain()))}
    printed = io.StringIO()
    with redirect_stdout(printed):
        told["run"] = attempt(lambda: of_run(session.run(script, engine=engine), picture))
    return {**told, "printed": printed.getvalue()}


def of_run(result: ss2sql.Result, picture: bool) -> Told:
    told: dict[str, Callable[[], Any]] = {
        "sql": lambda: golden.sql_text(result.sql), "value": lambda: written(result.value),
        "rows": lambda: repr(list(result)), "counted": lambda: repr(result.stats),
        "explain": lambda: explained(result.explain()), "shown": lambda: repr(result),
        "html": result._repr_html_, "csv": result.csv, "json": result.json,
        "graph": lambda: written([list(result.graph().nodes(data=True)), list(result.graph().edges(data=True))]),
    }  # fmt: skip
    if picture:
        told["picture"] = lambda: drawn(result)
    answers = {}
    for name, tell in told.items():
        result.stats.seconds.clear()
        answers[name] = attempt(tell)
    return answers


def attempt(tell: Callable[[], Any]) -> Any:
    """What is told, or the error as users see it."""
    try:
        return tell()
    except Exception as error:
        return golden.error_text(error)


def written(value: Any) -> str:
    """A value as Python writes it, but for its sets, which Python writes in any order."""
    match value:
        case set() | frozenset():
            return f"{{{', '.join(sorted(map(written, value)))}}}"
        case dict():
            return f"{{{', '.join(f'{written(key)}: {written(item)}' for key, item in value.items())}}}"
        case list() | tuple():
            return f"{type(value).__name__}({', '.join(map(written, value))})"
    return repr(value)


def explained(given: Any) -> list[str]:
    """The text and the data of an explanation; the plan's SQL is one of the data."""
    return [str(given), repr(given.as_dict())]


def drawn(result: ss2sql.Result) -> str:
    """The picture as SVG."""
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot

    with matplotlib.rc_context({"svg.hashsalt": "ss2sql"}):
        pyplot.close("all")
        file = io.StringIO()
        result.plot().figure.savefig(file, format="svg", metadata={"Date": None})
        return file.getvalue()


def contents(path: Path | None) -> list[str]:
    """The tables of a file in the order of their names, with their rows in order: graphs are written now and then."""
    if path is None:
        return []
    found = []
    connection = apsw.Connection(str(path))
    for name, sql in connection.execute("SELECT name, sql FROM sqlite_schema WHERE type = 'table' ORDER BY name"):
        columns = [row[1] for row in connection.execute(f'PRAGMA table_info("{name}")') if row[1] not in TIMES]
        shown = ", ".join(f'typeof("{column}"), CAST("{column}" AS BLOB)' for column in columns)  # some are not UTF-8
        found += [sql, *sorted(map(repr, connection.execute(f'SELECT {shown} FROM "{name}"')))]
    connection.close()
    return found


OTHERS: tuple[Register, ...] = (
    *(partial(registered, name=name, function=like) for name in MORE_FUNCTIONS),
    *(partial(attached, name=name, value=[1, 2]) for name in MORE_VALUES),
    partial(registered, name="bag_of", function=bag_of),
)


def report(order: int, rare: int, most: int) -> Iterator[str]:
    shuffle = random.Random(order)
    wanted = list(scripts(rare, most).items())
    shuffle.shuffle(wanted)
    yield from sorted(json.dumps([name, tell(shuffle)]) for name, tell in wanted)


if __name__ == "__main__":
    sys.stdout.writelines(line + "\n" for line in report(*map(int, sys.argv[1:])))
