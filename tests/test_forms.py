"""Forms of operations in expressions: one check for a whole sum, each operand evaluated once and in its order.

What single operations give is in test_operations.py.
"""

from __future__ import annotations

import re
from collections import Counter
from contextlib import suppress
from fnmatch import fnmatchcase
from typing import Any

import pytest
from agreement import differences
from native_host import FakeHost
from programs import ProgramCase
from sql_calls import python_calls

import ss2sql
from ss2sql.errors import Error
from ss2sql.language import plan
from ss2sql.lowering.sql_builder import Node
from ss2sql.lowering.sqlite_expressions import ExpressionLowering, SqlScope

# Of columns of tables the types know neither the size of numbers nor whether None is compared.
GUARDED = [
    "a + b", "a - b", "a * b", "-a", "a + b - a", "(a + b) * 2 - b", "a * b * a", "-(a - b) - a", "a + 1",
    "a * 0.5 + b", "a / b", "a % b", "sqrt(a)", "abs(a)", "int(a)", "a < b", "a >= b", "NOT a <= b",
    "IF(a > 0; a + b; b - a)",
    "abs(a + b)", "sqrt(a * a + b * b)", "max([a + b, a])", "a + b == b + a", "(a + b) % 7", "int(a / 2)",
    "a ^ 2", "(a - b) ^ 2 + (b + 1) ^ 2", "sqrt((a - b) ^ 2 + b ^ 2)", "a ^ 3 - b", "a ^ 4 * b",
    "(a + b) ^ 1", "a ^ 2 / b",
]  # fmt: skip


@pytest.mark.parametrize("expression", ["this + this", "this * 3 - 1"])
def test_an_integer_among_floats_becomes_too_large(expression: str) -> None:
    """SQLite would go on with a float."""
    case = ProgramCase(f"SELECT {expression} FROM [0.5, 4611686018427387904] AS list;")
    assert differences(case) == []


def test_two_variables_are_compared_before_the_statement_runs() -> None:
    with ss2sql.connect() as ss:
        result = ss.run("SELECT this FROM [1, 2] WHERE a == b OR b == a AS list", engine="database", a="x", b=2)
    assert result.value == []
    assert False in result.sql.parameters.values()
    assert " IS " not in result.sql


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
        ("n", "{} % 3"), ("n", "({} % 3 + 1) / 2"), ("n", "abs(n - {})"), ("n", "sqrt({} ^ 2)"),
        ("n", "(2 % {} < m) % 3"), ("n % 3", "({} AND n) % 3"), ("n % 3", "IF({} > 1; n % 3; m)"),
        ("n", "({} IN [n, 2]) % 4"), ("n", "[n, 2][int(abs({} % 2))]"),
        ("n % 3", "(SELECT {} FROM t WHERE n == 5 AS value) % 4"),
    ],
)  # fmt: skip
def test_a_chain_of_what_may_fail_is_lowered_once(inner: str, around: str, monkeypatch: pytest.MonkeyPatch) -> None:
    lowered = Counter[int]()
    lower = ExpressionLowering._lower_node

    def counted(self: ExpressionLowering, expr: plan.Expr, env: SqlScope) -> Node:
        lowered[depth] += 1
        return lower(self, expr, env)

    monkeypatch.setattr(ExpressionLowering, "_lower_node", counted)
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
        ("1.23456789012345", "1.23456789012345"), ("0.123456789012345", "0.123456789012345"),
        ("1.234567890123456", None), ("123456789012345.0", "123456789012345.0"), ("1e20", "1e+20"), ("1e21", None),
        ("1.5e-20", "1.5e-20"), ("2.5e-21", None),
        (str(2**53 - 1), str(2**53 - 1)), (str(2**53), None),
    ],
)  # fmt: skip
def test_a_number_is_written_where_sqlite_reads_it_back_exactly(number: str, written: str | None) -> None:
    with ss2sql.connect() as ss:
        text = str(ss.compile(f"SELECT this * {number} FROM [1.5] AS list;", engine="database").sql)
        assert ss.eval(f"SELECT this * {number} FROM [1.5] AS list;") == [1.5 * float(number)]
    assert (f"this.this * {written}\n" if written else "this.this * :p") in text


@pytest.mark.parametrize(
    "script",
    [
        "f(3) + f(4)", "f(3) - f(4) * f(5)", "f(3) < f(4)", "min(f(3), f(4))", "max([f(3), f(4)])", "f(8) % f(3)",
        "f(8) / f(3)", "f(8) / f(0)", "f([3, 4])[f(1)]", "f([3, 4])[f(2)]", "int(f(3)) / int(f(4))",
        "float(f(3)) / float(f(4))", "int(f(3)) % int(f(0))", "min(int(f(3)), float(f(4)))", "int(f(3)) + int(f(4))",
        "float(f(3)) * f(4)", "2 + f(4)", "f(1) + 'a'", "f('a') + f('b')", "f([1])[int(f(0))]",
    ],
)  # fmt: skip
def test_operands_are_evaluated_once_and_in_order(script: str) -> None:
    log: list[Any] = []

    def f(value: Any) -> Any:
        log.append(value)
        return value

    with suppress(Error):
        FakeHost({"f": f}, {"f": "volatile"}).run(script)
    assert [repr(value) for value in log] == re.findall(r"f\(([^()]*)\)", script)


@pytest.mark.parametrize(
    ("pattern", "calls"), [("ab", set()), ("a%", set()), ("%b%", set()), ("%b", {"like_of"}), ("_b", {"like_of"})]
)
def test_which_patterns_sqlite_knows_by_itself(pattern: str, calls: set[str]) -> None:
    """The others it leaves to Python where a NUL stands in the text, at which GLOB ends."""
    with ss2sql.connect(engine="database") as ss:
        result = ss.run(f"SELECT this FROM words WHERE this LIKE '{pattern}' AS list", words=["ab", "b", "a\0b", "xb"])
    assert python_calls(str(result.sql)) == calls
    assert result.value == [
        word for word in ("ab", "b", "a\0b", "xb") if fnmatchcase(word, pattern.translate({37: "*", 95: "?"}))
    ]
