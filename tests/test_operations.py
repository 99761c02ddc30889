"""Every row of the table of operations keeps its promises, on every engine: values x types x None x big numbers.

There is nothing in here that knows one operation from another. What the value, a Python function, gives decides.

- The value is of the type that `result` promises, and fails only where `can_fail` says so.
- Each engine gives it, for constants, for a column whose type is as narrow and as wide as values allow, and for columns
  of a table, whose types know nothing. An engine that refuses has no opinion.
- An aggregate gives the same of a group as of the list of its values that are not None, whatever order they stand in.
- A value is no larger than one of its arguments unless the row says that it grows.
"""

from __future__ import annotations

from collections.abc import Iterator
from datetime import date, datetime, timedelta
from itertools import product
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from random_values import Thing

import ss2sql
from ss2sql.errors import ExecutionError
from ss2sql.language.kinds import ANY, Kind, Type, is_supertype, type_of, unite
from ss2sql.language.operations import GROUPS, MODULES
from ss2sql.language.operations import WRITTEN as OPERATIONS

ENGINES = ("database", "native")
INTS = [0, 1, -1, 2, -7, 2**31, 2**53, 2**53 + 1, -(2**62), 2**63 - 1, -(2**63)]
FLOATS = [0.0, -0.0, 0.5, -2.5, 1.0, 1 / 3, 2.0**53, 5e-324, 1e154, 1.7976931348623157e308, -1.7976931348623157e308]
BOOLS = [True, False]
STRINGS = ["", "a", "B", "ab", "ä", "İÄ", "ß", "\u0149", "\U0001f600", "a\0ä", "10", " x" * 20, "\u0149" * 20]
LISTS: list[Any] = [
    [], [1], [1.0, 2], [3, -1], ["a"], [[1, 2]], [1, None], [0.5, 1e308], [True, 2], [1.7e308, -1.7e308],
]  # fmt: skip
DAY, NOON = date(2024, 5, 31), datetime(2024, 5, 31, 12, 30)
OTHERS: list[Any] = [None, {"a": 1}, {}, Thing(), "\ud800"]
# What columns hold: of one kind, of several, with None among them.
COLUMNS: dict[str, list[Any]] = {
    "small": [0, 1, -1, 2, -7, 12], "ints": INTS, "floats": FLOATS, "halves": [0.5, -1.5, 2.0, 0.0, -0.0],
    "bools": BOOLS, "numbers": [1, 1.0, True, 0, -0.0, 2**53 + 1, 2.5], "strings": STRINGS,
    "ints or none": [None, 3, 2**63 - 1, -5], "floats or none": [None, 0.5, -0.0, 1e308],
    "strings or none": [None, "a", "ß"], "bools or none": [None, True], "lists": LISTS,
    "points": [[1, 2], [3, 4.5], [1.7e308, -1.7e308]], "words": [["a", "b"], [""], []],
    "large": [n for n in (42994951600747580, 228339692151821691, 145122621830322339) for _ in range(2)],
    "times": [DAY, NOON, date(1999, 12, 31), timedelta(1), timedelta(days=-2, seconds=5), datetime(2024, 5, 31)],
    "days": [DAY, date(1999, 12, 31)], "spans": [timedelta(1), timedelta(0), None],
    "numerals": ["2024-05-31", "2024-05-31 12:30", "7", "{} {:.2f}"], "units": [0.25, 1, 0.0, 1.5], "two": [2],
    "three": [3], "minus one": [-1], "all": [*OTHERS, *LISTS, 1, 2.5, True, "a"],
}  # fmt: skip
TABLED = ["small", "ints", "floats", "halves", "strings", "ints or none", "floats or none", "strings or none"]
LATER: list[Any] = [2, "a", None]  # arguments behind the second
PARTS = 24  # `make test` takes one of so many parts of the columns, see conftest.py


def exact(value: Any) -> Any:
    """With the type of every part, so that 1, 1.0, True and the signs of zero differ."""
    if type(value) is list:
        return [exact(part) for part in value]
    if type(value) is dict:
        return {key: exact(part) for key, part in value.items()}
    return type(value).__name__, repr(value)


def outcome(function: Any, *arguments: Any) -> Any:
    """The value, exactly, or the code of the error."""
    try:
        return exact(function(*arguments))
    except ExecutionError as error:
        return error.code


def size(value: Any) -> int:
    if type(value) is str:
        return len(value.encode("utf-8", "surrogatepass"))
    return 1 + sum(map(size, value)) if type(value) is list else 1


def written(name: str, arguments: list[str]) -> str:
    """A call as a script has it."""
    if OPERATIONS[name].symbol:
        return f"{arguments[0]} {OPERATIONS[name].symbol} {arguments[1]}"
    return {"item": "{0}[{1}]", "slice": "{0}[{1}:{2}]", "neg": "-{0}"}.get(name, "").format(*arguments) or (
        f"{name}({', '.join(arguments)})"
    )


def arities(name: str) -> Iterator[int]:
    low, high = OPERATIONS[name].arity
    yield from range(low, min(low + 2 if high is None else high, 3) + 1)


VALUES = sorted(
    name for name, row in OPERATIONS.items() if row.value and row.volatility == "immutable" and row.arity[1]
)
EVERY_ROW = pytest.mark.parametrize("name", VALUES)
AGGREGATES = sorted(name for name, row in OPERATIONS.items() if row.group or row.collects)
EVERY_GROUP = pytest.mark.parametrize("name", AGGREGATES)
EVERY_PART = pytest.mark.parametrize("part", range(PARTS))


def parts_of(names: Any, count: int, part: int) -> list[tuple[str, ...]]:
    """One part of the columns of a call with so many arguments."""
    return list(product(names, repeat=min(count, 2)))[part::PARTS]


# --- what a row says -----------------------------------------------------------------------------------


@EVERY_ROW
def test_the_value_is_of_its_type_and_fails_where_it_may(name: str) -> None:
    pool = [(value, type_of(value)) for values in COLUMNS.values() for value in values[::2]]
    later = [(value, type_of(value)) for value in LATER]
    for count in arities(name):
        for row in product(*[pool] * min(count, 2), *[later] * (count - 2)):
            judge(name, [value for value, _ in row], [kind for _, kind in row])


def judge(name: str, arguments: Any, types: list[Type]) -> None:
    row = OPERATIONS[name]
    assert row.value is not None
    found = outcome(row.value, *arguments)
    if isinstance(found, str):
        assert row.can_fail(types), (name, arguments, types, found)
        return
    value = row.value(*arguments)
    assert is_supertype(row.result(types), type_of(value)), (name, arguments, value, row.result(types))
    assert row.grows or size(value) <= sum(map(size, arguments)) + 8, (name, arguments, value)


SOME = st.sampled_from([value for values in COLUMNS.values() for value in values])


@EVERY_ROW
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data())
def test_types_of_several_values_cover_the_value(name: str, data: st.DataObject) -> None:
    count = data.draw(st.sampled_from(list(arities(name))))
    drawn = [data.draw(st.lists(SOME, min_size=1, max_size=3)) for _ in range(count)]
    types = [unite(map(type_of, values)) for values in drawn]
    if data.draw(st.booleans()):
        types = [Type(kind.kinds, element=kind.element, columns=kind.columns) for kind in types]
    for arguments in product(*drawn):
        judge(name, arguments, types)


@EVERY_ROW
def test_of_anything_the_type_covers_every_other(name: str) -> None:
    for count in arities(name):
        widest = OPERATIONS[name].result([ANY] * count)
        for values in COLUMNS.values():
            assert is_supertype(widest, OPERATIONS[name].result([unite(map(type_of, values))] * count)), (
                name,
                values,
            )


# --- what engines give ---------------------------------------------------------------------------------


def given_by(session: ss2sql.Session, script: str, engine: Any) -> Any:
    """The value, exactly, or the code of the error, or None where the engine refuses."""
    try:
        return exact(session.run(script, engine=engine).value)
    except ss2sql.UnsupportedError:
        return None
    except ss2sql.Error as error:
        return error.code


def compare(session: ss2sql.Session, script: str, name: str, rows: list[Any], engines: Any = ENGINES) -> None:
    """Where no row fails, every engine gives the values; where one fails, it fails."""
    expected = [outcome(OPERATIONS[name].value, *row) for row in rows]
    failed = [one for one in expected if isinstance(one, str)]
    for engine in engines:
        found = given_by(session, script, engine)
        # R008: that an argument is no list is said before the run.
        right = [None, *failed, "R008"] if failed else [None, expected]
        assert found in right, (engine, script, rows, found, expected)


def good_rows(name: str, columns: list[list[Any]]) -> tuple[list[Any], list[Any]]:
    """The rows of a product for which the value does not fail, and of the others one for each kind of arguments."""
    good: list[Any] = []
    failing: dict[Any, Any] = {}
    for row in map(list, product(*columns)):
        if isinstance(outcome(OPERATIONS[name].value, *row), str):
            failing.setdefault(tuple(map(type, row)), row)
        else:
            good.append(row)
    return good, list(failing.values())


@EVERY_PART
@EVERY_ROW
def test_engines_give_the_value(name: str, part: int) -> None:
    with ss2sql.connect() as session:
        for count in arities(name):
            call = written(name, [f"this[{index}]" for index in range(count)])
            for columns in parts_of(COLUMNS, count, part):
                good, failing = good_rows(name, [COLUMNS[one][:11] for one in columns] + [LATER] * (count - 2))
                for rows in (good, *([*good[:3], row] for row in failing)):
                    if rows:
                        session.attach("r", rows)
                        compare(session, f"SELECT {call} FROM r AS list;", name, rows)
                if good and failing:  # rows that are left out make the types wider
                    session.attach("r", [*([*row, True] for row in good), *([*row, False] for row in failing)])
                    compare(session, f"SELECT {call} FROM r WHERE this[{count}] AS list;", name, good)


@EVERY_PART
@EVERY_ROW
def test_engines_give_the_value_of_columns_of_tables(name: str, part: int) -> None:
    for count in arities(name):
        for columns in parts_of(TABLED, count, part):
            good, failing = good_rows(name, [COLUMNS[one] for one in columns] + [LATER[:2]] * (count - 2))
            for rows in (good, *([*good[:3], row] for row in failing)):
                if rows:
                    with ss2sql.connect() as session:
                        compare_columns(session, session.host.connection, name, [""] * count, rows, ENGINES)


def compare_columns(session: ss2sql.Session, own: Any, name: str, kinds: list[str], rows: Any, engines: Any) -> None:
    """The same for a table of these rows in a database."""
    names, marks = "abcd"[: len(kinds)], ", ".join("?" * len(kinds))
    own.execute(f"CREATE TABLE t({', '.join(map(' '.join, zip(names, kinds, strict=True)))})")
    own.executemany(f"INSERT INTO t VALUES ({marks})", rows)
    if "duckdb" in engines:
        session.attach("t", own.table("t"))
    compare(session, f"SELECT {written(name, list(names))} FROM t AS list;", name, rows, engines)


@EVERY_PART
@EVERY_ROW
def test_engines_give_the_value_of_constants(name: str, part: int) -> None:
    """Arguments that are written out, beside a column and beside others: forms for powers, remainders, indexes."""
    with ss2sql.connect() as session:
        for count in arities(name):
            for columns in parts_of(["small", "halves", "strings", "numbers", "lists", "words"], count, part):
                good, _ = good_rows(name, [COLUMNS[one][:6] for one in columns] + [LATER] * (count - 2))
                for row in good[:: 1 + len(good) // 12]:
                    texts = [repr(value) if type(value) is str else f"({value!r})" for value in row]
                    if not all(type(value) is not str or value.isprintable() for value in row):
                        continue
                    compare(session, f"[{written(name, texts)}];", name, [row])
                    session.attach("r", [row])
                    call = written(name, ["this[0]", *texts[1:]])
                    compare(session, f"SELECT {call} FROM r AS list;", name, [row])


TYPES_OF_DUCKDB = {"small": "BIGINT", "ints": "BIGINT", "floats": "DOUBLE", "halves": "DOUBLE", "strings": "VARCHAR"}


@EVERY_PART
@EVERY_ROW
def test_duckdb_gives_the_value(name: str, part: int) -> None:
    duckdb = pytest.importorskip("duckdb")
    for count in arities(name):
        for columns in parts_of(TYPES_OF_DUCKDB, count, part):
            given = [[one for one in COLUMNS[column] if "\0" not in str(one)][:9] for column in columns]
            good, _ = good_rows(name, [*given, *[LATER[:1]] * (count - 2)])
            kinds = [*map(TYPES_OF_DUCKDB.__getitem__, columns), "BIGINT", "BIGINT"][:count]
            if good:
                with ss2sql.connect() as session:
                    compare_columns(session, duckdb.connect(), name, kinds, good, ("duckdb", "native"))


# --- aggregates ----------------------------------------------------------------------------------------


def of_group(name: str, values: list[Any], *beside: Any) -> Any:
    if name in GROUPS:
        return outcome(GROUPS[name].aggregate_group, values)
    return outcome(OPERATIONS[name].value, [value for value in values if value is not None], *beside)


def beside(name: str) -> list[Any]:
    """What stands beside the values of an aggregate."""
    return [0.25] * (OPERATIONS[name].arity[0] - 1)


@EVERY_GROUP
@pytest.mark.parametrize("column", COLUMNS)
def test_engines_aggregate_alike(name: str, column: str) -> None:
    """Three groups: all values, the values backwards, and each value alone."""
    row, values, others = GROUPS.get(name, GROUPS["collect"]), COLUMNS[column], beside(name)
    call = f"{name}({', '.join(['this[1]', *map(repr, others)])})"
    with ss2sql.connect() as session:
        for chosen in (values, values[::-1], values[:3], values[-2:], *([value] for value in values)):
            groups = {0: chosen, 1: chosen[::-1], 2: chosen[:1]}
            kind = unite(map(type_of, chosen))
            expected = {key: of_group(name, group, *others) for key, group in groups.items()}
            failed = [one for one in expected.values() if isinstance(one, str)]
            if failed:
                assert name not in GROUPS or row.can_fail(kind), (name, chosen, kind)
            else:
                for group in groups.values():
                    one = type_of(row.aggregate_group(group))
                    assert is_supertype(row.type_of_group(kind), one), (name, group, kind)
            session.attach("r", [[key, value] for key, group in groups.items() for value in group])
            for engine in ENGINES:
                found = given_by(session, f"SELECT {call} FROM r GROUP BY this[0] AS list;", engine)
                right = [None, *failed] if failed else [None, list(expected.values())]
                assert found in right, (engine, name, groups, found, expected)
            if row.in_sql(kind) and not failed:
                one, other = (repr(value).replace("-0.0", "0.0") for value in (expected[0], expected[1]))
                assert one == other, (name, chosen, "the order of the values matters")


@EVERY_GROUP
@pytest.mark.parametrize("column", [*TABLED, "large"])
@pytest.mark.parametrize("engines", [ENGINES, ("duckdb", "native")], ids=["sqlite", "duckdb"])
def test_engines_aggregate_columns_of_tables_alike(name: str, column: str, engines: Any) -> None:
    in_duckdb = "duckdb" in engines
    values, others = [one for one in COLUMNS[column] if not (in_duckdb and "\0" in str(one))], beside(name)
    expected = [of_group(name, values[n::2], *others) for n in range(2)]
    failed = [one for one in expected if isinstance(one, str)]
    integers = ("small", "ints", "ints or none", "large")
    kind = "BIGINT" if column in integers else "VARCHAR" if column.startswith("strings") else "DOUBLE"
    with ss2sql.connect() as session:
        own = pytest.importorskip("duckdb").connect() if in_duckdb else session.host.connection
        own.execute(f"CREATE TABLE t(k BIGINT, x {kind if in_duckdb else ''})")
        own.executemany("INSERT INTO t VALUES (?, ?)", [[n % 2, value] for n, value in enumerate(values)])
        if in_duckdb:
            session.attach("t", own.table("t"))
        for engine in engines:
            call = f"{name}({', '.join(['x', *map(repr, others)])})"
            found = given_by(session, f"SELECT {call} FROM t GROUP BY k AS list;", engine)
            assert found in ([None, *failed] if failed else [None, expected]), (engine, name, column, found, expected)


def test_rows_have_names_of_their_own_and_name_their_opposites() -> None:
    rows = {row.name: row for page in MODULES for row in page.OPERATIONS}
    assert len(rows) == sum(len(page.OPERATIONS) for page in MODULES)
    assert all(rows[row.negated].negated == name for name, row in rows.items() if row.negated)


def test_what_is_shown_of_a_row_is_there() -> None:
    assert all(row.about and row.call.startswith((name, "a", "neg")) for name, row in OPERATIONS.items())
    assert all(row.example or row.volatility != "immutable" for row in OPERATIONS.values())
    assert all(is_supertype(row.type_of_group(Type(Kind.NONE)), type_of(row.nothing)) for row in GROUPS.values())
