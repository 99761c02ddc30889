"""The native executor on expressions: values, short circuits, variables, and how often what is called."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import pytest
from native_host import FakeHost, place

from ss2sql.runtime.native import compile_statement


@pytest.mark.parametrize(
    ("script", "expected"),
    [
        ("1 + 2 * 3", 7),
        ("7 / 2", 3.5),
        ("-7 % 3", 2),
        ("2 ^ 3 ^ 2", 512),
        ("'a' + 'b'", "ab"),
        ("[1] + [2]", [1, 2]),
        ("1 == 1.0", True),
        ("[10, 9] == [10.0, 9.0]", True),
        ("True == 1", True),
        ("[] != [[]]", True),
        ("'1' != 1", True),
        ("None == None", True),
        ("1 < 2", True),
        ("'b' <= 'a'", False),
        ("[1, 2] < [1, 3]", True),
        ("2 IN [1, 2.0]", True),
        ("'bc' IN 'abcd'", True),
        ("3 NOT IN [1, 2]", True),
        ("[] AND 1", False),
        ("'x' AND [0]", True),
        ("0 OR 'x'", True),
        ("None OR []", False),
        ("1 XOR 'x'", False),
        ("0 XOR 'x'", True),
        ("NOT []", True),
        ("[[1, 2], [3]][0][1]", 2),
        ("[1, 2, 3][-1]", 3),
        ("'abc'[1:]", "bc"),
        ("IF(1 == 1; 5; 6)", 5),
        ("IF([]; 5; 6)", 6),
        ("IF(1 == 1; ; 6)", True),
        ("IF(1 == 2; 5)", False),
        ("IF(1 == 1; 1, 2, 3; 4)", 3),
        ("len([1, 2]) + max([4, 9])", 11),
        ("9223372036854775806 + 1", 9223372036854775807),
    ],
)
def test_values(script: str, expected: Any) -> None:
    value = FakeHost().run(script)
    assert value == expected
    assert type(value) is type(expected)


@pytest.mark.parametrize("script", ["1 == 2 AND f(1)", "1 == 1 OR f(1)", "IF(1 == 1; 2; f(1))", "IF(0; f(1); 2)"])
def test_what_is_not_needed_is_not_called(script: str) -> None:
    host = FakeHost({"f": lambda x: x})
    run = host.start()
    host.run(script, run)
    assert run.stats.calls["f"] == 0


@pytest.mark.parametrize("script", ["'x' AND 1 / 0", "0 OR 1 / 0", "IF(1; 1 / 0; 2)"])
def test_what_is_needed_is_evaluated(script: str) -> None:
    assert FakeHost().error(script).code == "X002"


def test_assignment_has_the_value_and_stays() -> None:
    host = FakeHost()
    assert host.run("x = 4; y = [x = x + 1, x]; y") == [5, 5]
    assert host.variables == {"x": 5, "y": [5, 5]}


def test_arguments_of_a_run_come_before_variables() -> None:
    host = FakeHost(x=1)
    run = host.start(arguments={"x": 10})
    assert host.run("x = x + 1; x", run) == 11
    assert run.arguments == {"x": 11}
    assert host.variables["x"] == 1


def test_a_variable_that_an_expression_assigns_is_read_each_time() -> None:
    host = FakeHost(n=0)
    assert host.run("SELECT (n = n + this), n FROM [1, 2, 3] AS rows") == [[1, 1], [3, 3], [6, 6]]


def test_a_variable_without_a_value() -> None:
    host = FakeHost(l=[1, 2])
    error = host.error("IF(1 == 2; late = 1);\nSELECT this FROM l WHERE this == 2 AND late > 1")
    assert (error.code, place(error)) == ("R001", "2:40 late")
    # Nobody reads it, so nothing is wrong.
    assert host.run("IF(1 == 2; late = 1); SELECT this FROM l WHERE this == 3 AND late > 1 AS list") == []


def test_temporal_variables_are_the_hosts() -> None:
    host = FakeHost()
    assert host.run("v{5.0} = 1; v{5.0} = 2; [v, v{}, v{-1}]") == [2, [1, 2], 2]


def test_print_has_its_last_value() -> None:
    host = FakeHost()
    assert host.run("print('n', n = 3)") == 3
    assert host.printed == [("n", 3)]


def test_values_are_shared_and_functions_get_fresh_ones() -> None:
    def spoil(values: list[int]) -> list[int]:
        values.append(0)
        return values

    host = FakeHost({"spoil": spoil}, l=[1])
    assert host.run("x = [l, spoil(l), l, spoil([5]), [5]]; x") == [[1], [1, 0], [1], [5, 0], [5]]


# --- eval ----------------------------------------------------------------------------------------------


def test_eval_sees_what_its_place_sees() -> None:
    host = FakeHost(l=[1, 2], pairs=[{"a": 1, "b": 5}], k=7)
    assert host.run("eval('k + 1')") == 8
    assert host.run("SELECT eval('this * 10;') FROM l AS list") == [10, 20]
    assert host.run("SELECT eval('p.b - n.this') FROM n = l, p = pairs AS list") == [4, 3]
    assert host.run("SELECT eval('(SELECT m.this + n.this FROM m = l AS list)') FROM n = l AS list") == [
        [2, 3],
        [3, 4],
    ]
    assert host.run("eval('k = 3; k + 1')") == 4
    assert host.variables["k"] == 3


def test_eval_sees_rows_of_queries_and_the_state_of_a_search() -> None:
    host = FakeHost(l=[1, 2])
    found = host.run(
        "SELECT eval('q.double') FROM q = (SELECT to(2 * this, double) FROM l) AS list;",
    )
    assert found == [2, 4]
    paths = host.run(
        "SELECT eval('10 * t + a.this') FROM a = l START WITH t = 0 CONNECT BY t = t + 1 STOP WITH t == 1 AS list"
    )
    assert paths == [[1], [2]]


def test_a_text_is_compiled_once_per_run() -> None:
    host = FakeHost(texts=["rows.n", "1", "rows.n"], rows=[{"n": number} for number in range(20)])
    assert host.run("SELECT eval(t.this) FROM rows, t = texts AS list")[:3] == [0, 1, 0]
    assert host.texts == 2
    query = host.query("SELECT eval('n * 2') FROM rows WHERE n < 2 AS list")
    host.texts = 0
    for _ in range(3):
        assert query.value(host.start()) == [0, 2]
    assert host.texts == 3


def test_assignments_in_a_text_are_seen_at_once() -> None:
    host = FakeHost(n=0, l=[1, 2, 3])
    assert host.run("SELECT n, eval('n = n + this'), n FROM l AS rows") == [[0, 1, 1], [1, 3, 3], [3, 6, 6]]


# --- columns and elements ------------------------------------------------------------------------------


@dataclass
class Body:
    name: str
    mass: float


def test_columns_of_dicts_and_dataclasses() -> None:
    host = FakeHost(
        dicts=[{"a": 1}, {"b": 2, "a": 3}],
        columns={"a": [1, 2], "b": [3, 4]},
        bodies=[Body("cup", 2.5), Body("box", 1)],
    )
    assert host.run("SELECT a, b FROM dicts AS rows") == [[1, None], [3, 2]]
    assert host.run("SELECT b, this FROM columns AS rows") == [[3, {"a": 1, "b": 3}], [4, {"a": 2, "b": 4}]]
    assert host.run("SELECT name, mass FROM bodies WHERE mass > 2 AS rows") == [["cup", 2.5]]


def test_a_missing_column_of_unknown_elements() -> None:
    host = FakeHost({"rows": lambda: [{"a": 1}, {"b": 2}], "numbers": lambda: [1]})
    error = host.error("SELECT r.a FROM r = rows()")
    assert (error.code, place(error)) == ("X008", "1:8 r.a")
    error = host.error("SELECT r.a FROM r = numbers()")
    assert (error.code, place(error)) == ("X008", "1:8 r.a")


def test_single_values_and_uneven_columns() -> None:
    host = FakeHost(one={"a": 1}, uneven={"a": [1], "b": []})
    assert host.run("SELECT this FROM None AS list") == [None]
    assert host.run("SELECT this FROM 'abc' AS list") == ["abc"]
    assert host.run("SELECT a FROM one AS list") == [1]
    error = host.error("SELECT 1 FROM [1], uneven")
    assert (error.code, place(error)) == ("X005", "1:20 uneven")


def test_a_list_that_changes_while_it_is_read() -> None:
    host = FakeHost(l=[1, 2])

    def grow() -> int:
        host.variables["l"].append(9)
        return 0

    host.functions["grow"] = grow
    host.volatility["grow"] = "volatile"
    assert host.run("SELECT this + grow() FROM l AS list") == [1, 2]


def test_a_constant_needs_no_run() -> None:
    from ss2sql import plan
    from ss2sql.errors import Source, Span
    from ss2sql.kinds import INT

    constant = plan.Constant(5, INT, span=Span(Source("5"), 0, 1))
    assert compile_statement(constant)(None) == 5  # type: ignore[arg-type]
