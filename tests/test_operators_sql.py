"""Operators that SQLite computes itself give what Python's give, in every bit, on values that are hard to get right."""

from __future__ import annotations

import re
from collections import Counter
from typing import Any

import pytest
from agreement import differences, executor_outcome
from hypothesis import given, settings
from hypothesis import strategies as st
from programs import ProgramCase
from programs.drawn import amount
from random_values import FLOATS as ANY_FLOATS
from random_values import INTEGERS as ANY_INTS
from random_values import NUMBERS, SCALARS
from random_values import TEXTS as ANY_TEXTS

import ss2sql
from ss2sql import plan
from ss2sql.lowering.expressions import Env, Expressions
from ss2sql.lowering.names import SQLITE_FUNCTIONS
from ss2sql.lowering.sql import Node

INTS = [0, 1, -1, 2, -2, 3, 7, 10, -10, 2**31, -(2**31), 2**53 - 1, 2**53, 2**53 + 1, -(2**53) - 1, 2**61 - 1, -(2**61)]
EXTREME_INTS = [*INTS, 2**62, -(2**62), 2**63 - 1, 1 - 2**63]
LEAST_INTS = [*EXTREME_INTS, -(2**63)]
SMALL_INTS = [-9, -3, -2, -1, 0, 1, 2, 3, 5, 8]
FLOATS = [0.0, -0.0, 0.5, -0.5, 1.0, -1.0, 2.5, -2.5, 0.1, 1 / 3, 5e-324, -5e-324, 1e-308, 2.0**53, 1e15 + 0.3, 1e150]
LARGE_FLOATS = [*FLOATS, 1e300, -1e300, 1.7976931348623157e308, -1.7976931348623157e308]
MIXED = [0, -0.0, 0.0, 1, 1.0, -1, -1.0, 2, 2.5, 2**53, 2.0**53, 2**53 + 1, -(2**61), 5e-324]
SIZES = [0, 0.0, -0.0, 1, 1.0, 2, 4.0, 2**53 + 1, 2**63 - 1, 1e300, 5e-324]
BOOLS = [True, False]
TEXTS = ["", "a", "b", "A", "ab", "ä", "z", "ß", "\U0001f600", "\uffff", "a\0", "a\0b", "\0", "1", "10", "9"]

ONE_OPERAND = [
    ("abs(a.this)", EXTREME_INTS), ("abs(a.this)", LARGE_FLOATS), ("abs(a.this)", MIXED), ("abs(a.this)", BOOLS),
    ("-a.this", EXTREME_INTS), ("-a.this", LARGE_FLOATS), ("-a.this", MIXED), ("-a.this", BOOLS),
    ("sqrt(a.this)", SIZES), ("sqrt(a.this)", BOOLS), ("sqrt(a.this)", [x for x in EXTREME_INTS if x >= 0]),
    ("int(a.this)", FLOATS[:-1]), ("int(a.this)", MIXED), ("int(a.this)", LEAST_INTS), ("int(a.this)", BOOLS),
    ("int(a.this)", [9223372036854774784.0, -9223372036854775808.0, 0.9, -0.9]),
    ("float(a.this)", LARGE_FLOATS), ("float(a.this)", MIXED), ("float(a.this)", LEAST_INTS), ("float(a.this)", BOOLS),
    ("str(a.this)", LEAST_INTS), ("str(a.this)", TEXTS),
    ("a.this ^ 1", LEAST_INTS), ("a.this ^ 2", SMALL_INTS), ("a.this ^ 3", SMALL_INTS), ("a.this ^ 1", BOOLS),
    ("a.this ^ 2", [3037000499, -3037000499, 3]), ("a.this ^ 3", [2097151, -2097152, 1]),
    ("(a.this - 3) ^ 2", SMALL_INTS),
    ("max([a.this])", MIXED), ("min([a.this, 1])", [0, 1, 2]), ("a.this % 10", LEAST_INTS), ("a.this % 1", LEAST_INTS),
    ("a.this % -7", LEAST_INTS), ("a.this % -1", LEAST_INTS), ("a.this % 3", BOOLS),
    ("a.this % 9007199254740993", LEAST_INTS), ("a.this % 4611686018427387904", LEAST_INTS),
    ("a.this + 1", INTS), ("1 - a.this", INTS), ("a.this * 2", INTS), ("a.this / 8", [*MIXED[:-3], 5e-324]),
    ("max([abs(a.this), a.this + 1, 3])", SMALL_INTS),
    ("sqrt((a.this - 2) ^ 2 + (a.this + 5) ^ 2)", SMALL_INTS),
    ("IF(a.this > 0; a.this; -a.this)", EXTREME_INTS), ("IF(a.this > 0; a.this > 2; False)", SMALL_INTS),
    ("IF(a.this; 1; 2)", MIXED), ("NOT a.this", MIXED), ("a.this AND True", LARGE_FLOATS),
    ("a.this OR False", SMALL_INTS), ("NOT a.this", [*MIXED, None]), ("NOT a.this", [None, True, False, 0.0, 5e-324]),
    ("NOT a.this", [[], [0], {}, {"a": 0}, None, 0, 1, False, True]),
]  # fmt: skip

TWO_OPERANDS = [
    ("a.this + b.this", INTS, INTS), ("a.this - b.this", INTS, MIXED), ("a.this * b.this", FLOATS, MIXED),
    ("a.this * b.this", SMALL_INTS, INTS[:-2]), ("a.this + b.this", FLOATS, MIXED), ("a.this - b.this", BOOLS, FLOATS),
    ("a.this / b.this", SMALL_INTS, [1, 3, 7, 0.5]), ("a.this / b.this", BOOLS, [-2.5, -1]),
    ("a.this % b.this", LEAST_INTS, [1, 2, 3, 10, 2**40]), ("a.this % b.this", LEAST_INTS, [-1, -2, -10]),
    ("a.this % b.this", [0, 3, 9, 2**62], [2, 5]), ("a.this % b.this", BOOLS, [1, 2]),
    ("max([a.this, b.this])", MIXED, MIXED), ("min([a.this, b.this])", MIXED, MIXED),
    ("max([a.this, b.this])", LARGE_FLOATS, FLOATS), ("min([a.this, b.this])", LARGE_FLOATS, FLOATS),
    ("max([a.this, b.this, 0])", LEAST_INTS, MIXED), ("min([a.this, 0, b.this])", LEAST_INTS, MIXED),
    ("max([a.this, b.this])", TEXTS, TEXTS), ("min([a.this, b.this])", TEXTS, TEXTS),
    ("max([a.this, b.this])", BOOLS, BOOLS), ("min([a.this, b.this])", BOOLS, BOOLS),
    ("min([a.this, b.this])", LEAST_INTS, LEAST_INTS),
    ("a.this + b.this", TEXTS, TEXTS),
    *((f"a.this {sign} b.this", [*MIXED, *LARGE_FLOATS], [*LEAST_INTS, *FLOATS])
      for sign in ("==", "!=", "<", "<=", ">", ">=")),
    *((f"a.this {sign} b.this", TEXTS, TEXTS) for sign in ("==", "!=", "<", "<=", ">", ">=")),
    *((f"a.this {sign} b.this", BOOLS, BOOLS) for sign in ("==", "!=", "<", ">=")),
    ("a.this == b.this", [*MIXED, None], [*INTS, None]), ("a.this != b.this", [*TEXTS, None], [*TEXTS, None]),
    ("a.this == None AND b.this != None", [*MIXED, None], [*TEXTS, None]),
]  # fmt: skip

# What the reference does not know: several arguments of min and max, distances of numbers.
OUTSIDE_THE_REFERENCE = [
    ("max(a.this, b.this)", MIXED, MIXED), ("min(a.this, b.this)", MIXED, MIXED),
    ("min(a.this, 1, b.this)", LARGE_FLOATS, MIXED),
    ("distance(a.this, b.this)", INTS[:-2], INTS[:-2]), ("distance(a.this, b.this)", FLOATS, FLOATS),
    ("distance(a.this, b.this)", MIXED, MIXED[:-2]), ("distance(a.this, b.this)", BOOLS, FLOATS),
]  # fmt: skip


def python_calls(text: str) -> set[str]:
    """The functions that a statement calls and SQLite does not have; sources that walk lists apart."""
    without_strings = re.sub(r"'(?:[^']|'')*'", "''", text)
    called = {name.lower() for name in re.findall(r'(\w+)"?\(', without_strings)}
    words = {"from", "in", "as", "when", "then", "else", "and", "or", "not", "where", "over", "select", "by", "cast"}
    return {name for name in called - SQLITE_FUNCTIONS - words if not name.startswith("elements")}


def case_of(expression: str, first: list[Any], second: list[Any] | None = None) -> ProgramCase:
    """The expression over the product of two lists, each row in a list of its own."""
    variables = {"first": first} if second is None else {"first": first, "second": second}
    sources = "a = first" if second is None else "a = first, b = second"
    return ProgramCase(f"SELECT {expression} FROM {sources} AS list;", variables)


def text_of(case: ProgramCase) -> str:
    with ss2sql.connect() as ss:
        for name, value in case.variables.items():
            ss.attach(name, value)
        return str(ss.compile(case.script, engine="database").sql)


def shown(part: object) -> str:
    return part if isinstance(part, str) else ""


@pytest.mark.parametrize(("expression", "values"), ONE_OPERAND, ids=shown)
def test_of_one_operand(expression: str, values: list[Any]) -> None:
    case = case_of(expression, values)
    assert python_calls(text_of(case)) == set()
    assert differences(case) == []
    assert executor_outcome(case, "database") is not None


@pytest.mark.parametrize(("expression", "first", "second"), TWO_OPERANDS, ids=shown)
def test_of_two_operands(expression: str, first: list[Any], second: list[Any]) -> None:
    case = case_of(expression, first, second)
    assert python_calls(text_of(case)) == set()
    assert differences(case) == []


@pytest.mark.parametrize(("expression", "first", "second"), OUTSIDE_THE_REFERENCE, ids=shown)
def test_of_two_operands_against_the_native_executor(expression: str, first: list[Any], second: list[Any]) -> None:
    case = case_of(expression, first, second)
    assert python_calls(text_of(case)) == set()
    found, expected = (executor_outcome(case, engine) for engine in ("database", "native"))
    assert found == expected
    assert found is not None
    assert found.error is None


OPERATORS = [
    "a.this + b.this", "a.this - b.this", "a.this * b.this", "a.this / b.this", "a.this % b.this", "-a.this",
    "abs(a.this)", "sqrt(a.this)", "int(a.this)", "float(a.this)", "str(a.this)", "len(a.this)",
    "a.this ^ 2", "a.this ^ 3", "max([a.this, b.this])", "min([a.this, b.this])", "min([a.this, b.this, 0.0])",
    "a.this == b.this", "a.this != b.this", "a.this < b.this", "a.this >= b.this", "NOT a.this",
    "IF(a.this; a.this; b.this)", "a.this AND b.this", "[a.this, b.this][1]", "a.this == None",
]  # fmt: skip
KINDS = st.sampled_from(
    [st.integers(-20, 20), ANY_INTS, ANY_FLOATS, st.integers(-9, 9).map(lambda n: n / 2), st.booleans(), NUMBERS]
)
OTHER_KINDS = st.sampled_from([ANY_TEXTS, SCALARS, st.one_of(st.none(), ANY_INTS), st.one_of(st.none(), st.booleans())])


@pytest.mark.drawn
@settings(max_examples=amount(2 / 5), deadline=None)
@given(st.data())
def test_whatever_the_types_say_all_agree(data: st.DataObject) -> None:
    kinds = st.one_of(KINDS, KINDS, OTHER_KINDS)
    lists = [data.draw(st.lists(data.draw(kinds), min_size=1, max_size=4)) for _ in range(2)]
    assert differences(case_of(data.draw(st.sampled_from(OPERATORS)), *lists)) == []


@pytest.mark.parametrize("expression", ["this + this", "this * 3 - 1"])
def test_an_integer_among_floats_becomes_too_large(expression: str) -> None:
    """SQLite would go on with a float."""
    case = ProgramCase(f"SELECT {expression} FROM [0.5, 4611686018427387904] AS list;")
    assert executor_outcome(case, "database").error == "X004"
    assert differences(case) == []


def test_two_variables_are_compared_before_the_statement_runs() -> None:
    with ss2sql.connect() as ss:
        result = ss.run("SELECT this FROM [1, 2] WHERE a == b OR b == a AS list", engine="database", a="x", b=2)
    assert result.value == []
    assert False in result.sql.parameters.values()
    assert " IS " not in result.sql


# Of columns of tables the types know neither the size of numbers nor whether None is compared.
GUARDED = [
    "a + b", "a - b", "a * b", "-a", "a + b - a", "(a + b) * 2 - b", "a * b * a", "-(a - b) - a", "a + 1",
    "a * 0.5 + b", "a / b", "a % b", "sqrt(a)", "abs(a)", "int(a)", "a < b", "a >= b", "NOT a <= b",
    "IF(a > 0; a + b; b - a)",
    "abs(a + b)", "sqrt(a * a + b * b)", "max([a + b, a])", "a + b == b + a", "(a + b) % 7", "int(a / 2)",
    "a ^ 2", "(a - b) ^ 2 + (b + 1) ^ 2", "sqrt((a - b) ^ 2 + b ^ 2)", "a ^ 3 - b", "a ^ 4 * b",
    "(a + b) ^ 1", "a ^ 2 / b",
]  # fmt: skip
HARD_INTS = st.one_of(st.integers(-3, 3), st.sampled_from(LEAST_INTS), st.integers(-(2**63), 2**63 - 1))
HARD_FLOATS = st.one_of(st.sampled_from(LARGE_FLOATS), ANY_FLOATS, st.sampled_from([1e154, -1e154, 9.3e18, 4.7e18]))
COLUMNS = st.sampled_from(
    [HARD_INTS, HARD_FLOATS, st.integers(-9, 9), st.one_of(HARD_INTS, HARD_FLOATS), st.one_of(st.none(), HARD_INTS),
     st.one_of(st.none(), HARD_FLOATS), st.one_of(st.none(), st.sampled_from(["a", "b", "ä"]))]
)  # fmt: skip


@pytest.mark.drawn
@settings(max_examples=amount(1 / 2), deadline=None)
@given(st.data())
def test_columns_of_tables(data: st.DataObject) -> None:
    kinds = [data.draw(COLUMNS) for _ in "ab"]
    rows = [dict(zip("ab", map(data.draw, kinds), strict=True)) for _ in range(data.draw(st.integers(1, 3)))]
    expression = data.draw(st.sampled_from(GUARDED))
    assert differences(ProgramCase(f"SELECT {expression} FROM t AS list;", tables={"t": rows})) == []


@pytest.mark.parametrize("expression", GUARDED)
@pytest.mark.parametrize(
    "values", [[3, 5, -2], [0.5, 2.25, -4.0], [None, 3, 4], [2**62, 2**62, 1], [1e308, 1e308, 1.0]]
)
def test_columns_of_tables_are_left_to_python_where_it_matters(expression: str, values: list[Any]) -> None:
    rows = [{"a": values[i], "b": values[j]} for i in range(3) for j in range(3)]
    for row in rows:
        case = ProgramCase(f"SELECT {expression} FROM t AS list;", tables={"t": [row]})
        assert differences(case) == []


@pytest.mark.parametrize(
    "expression", ["a + b", "a * b - a", "a / b", "a % b", "sqrt(a)", "abs(a)", "a < b", "-a", "a ^ 2 - b"]
)
def test_columns_of_tables_cost_no_call_as_a_rule(expression: str) -> None:
    with ss2sql.connect() as ss:
        ss.host.connection.execute("CREATE TABLE t(a, b); INSERT INTO t VALUES (5, 3), (7, 2)")
        calls: list[str] = []
        for name in ("add", "mul", "sub", "div", "mod_of", "sqrt_of", "abs_of", "lt", "neg", "pow_of"):
            ss.host.connection.create_scalar_function(name, lambda *arguments, name=name: calls.append(name))
        ss.run(f"SELECT {expression} FROM t;", engine="database")
        assert calls == []


@pytest.mark.parametrize(
    ("inner", "around"),
    [
        ("n", "{} % 3"),
        ("n", "({} % 3 + 1) / 2"),
        ("n", "abs(n - {})"),
        ("n", "sqrt({} ^ 2)"),
        ("n", "(2 % {} < m) % 3"),
        ("n % 3", "({} AND n) % 3"),
        ("n % 3", "IF({} > 1; n % 3; m)"),
        ("n", "({} IN [n, 2]) % 4"),
        ("n", "[n, 2][int(abs({} % 2))]"),
        ("n % 3", "(SELECT {} FROM t WHERE n == 5 AS value) % 4"),
    ],
)
def test_a_chain_of_what_may_fail_is_lowered_once(inner: str, around: str, monkeypatch: pytest.MonkeyPatch) -> None:
    lowered = Counter[int]()
    lower = Expressions._lower

    def counted(self: Expressions, expr: plan.Expr, env: Env) -> Node:
        lowered[depth] += 1
        return lower(self, expr, env)

    monkeypatch.setattr(Expressions, "_lower", counted)
    for depth in (4, 8, 16):
        expression = inner
        for _ in range(depth):
            expression = around.format(expression)
        case = ProgramCase(f"SELECT {expression} FROM t AS list;", tables={"t": [{"n": 5, "m": None}]})
        assert differences(case) == []
    assert lowered[16] - lowered[8] <= 2.5 * (lowered[8] - lowered[4])


@pytest.mark.parametrize(
    ("number", "written"),
    [
        ("1.23456789012345", "1.23456789012345"),
        ("0.123456789012345", "0.123456789012345"),
        ("1.234567890123456", None),
        ("123456789012345.0", "123456789012345.0"),
        ("1e20", "1e+20"),
        ("1e21", None),
        ("1.5e-20", "1.5e-20"),
        ("2.5e-21", None),
    ],
)
def test_a_float_is_written_where_sqlite_reads_it_back_exactly(number: str, written: str | None) -> None:
    with ss2sql.connect() as ss:
        text = str(ss.compile(f"SELECT this * {number} FROM [1.5] AS list;", engine="database").sql)
        assert ss.eval(f"SELECT this * {number} FROM [1.5] AS list;") == [1.5 * float(number)]
    assert (f"this.this * {written}\n" if written else "this.this * :p") in text
