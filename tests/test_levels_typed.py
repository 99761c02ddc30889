"""Steps as SQL in the level engine: the same paths as natively, and what is left to Python."""

from __future__ import annotations

from typing import Any

import pytest
from agreement import exact
from hypothesis import given, seed, settings
from hypothesis import strategies as st
from programs.drawn import amount
from sessions import code_of

import ss2sql
from ss2sql.lowering.portable.names import OWN
from ss2sql.runtime.levels import beginning, typed_search

duckdb = pytest.importorskip("duckdb")

COUNT = amount(1 / 8)
MOVES = [
    {"by": 1, "word": "a", "far": False},
    {"by": -2, "word": "", "far": True},
    {"by": 3, "word": "bü", "far": True},
]
ADDED = {0: 1, 1: 2, 2: 3, 3: 4, 4: 5}
STRATEGIES = ("UNIQUE", "BREADTH FIRST NO CYCLE", "BREADTH FIRST")
STATES = {"n": "0", "t": "'x'", "b": "False", "l": "[1]"}

INTS = ("n", "m.by", "1", "-3", "7")
TEXTS = ("t", "m.word", "'x'", "''", "'äb'")


@pytest.fixture(autouse=True)
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """The tables do all levels, also small ones."""
    monkeypatch.setattr(beginning, "STATES", 0)


def expressions() -> st.SearchStrategy[dict[str, str]]:
    """Expressions by kind; those of ints stay within bounds by a remainder."""
    leaves_int, leaves_text = st.sampled_from(INTS), st.sampled_from(TEXTS)
    number = st.recursive(
        leaves_int,
        lambda inner: st.one_of(
            st.builds("(({} + {}) % 9)".format, inner, inner),
            st.builds("(({} - {}) % -7)".format, inner, inner),
            st.builds("(({} * {}) % 5)".format, inner, inner),
            st.builds("abs({} % 11)".format, inner),
            st.builds("(-({} % 6))".format, inner),
            st.builds("min({} % 8, {} % 8)".format, inner, inner),
            st.builds("len({})".format, leaves_text),
            st.builds("IF({} < {}; {} % 4; 2)".format, inner, inner, inner),
        ),
        max_leaves=4,
    )
    text = st.one_of(
        st.builds("({} + {})[0:3]".format, leaves_text, leaves_text),
        st.builds("({} + {})[1:4]".format, leaves_text, leaves_text),
        leaves_text,
    )
    truth = st.one_of(
        st.builds("{} < {}".format, number, number),
        st.builds("{} == {}".format, text, text),
        st.builds("{} != {}".format, number, number),
        st.builds("{} <= {}".format, text, text),
        st.builds("{} IN [1, 3, -1]".format, number),
        st.builds("{} NOT IN {}".format, leaves_text, text),
        st.builds("(m.far XOR {} > 1)".format, number),
        st.builds("({} == 2 OR NOT {} == 3)".format, number, number),
        st.sampled_from(["m.far", "b", "n", "t", "l == [1]", "NOT (b AND m.far)"]),
    )
    return st.fixed_dictionaries({"int": number, "text": text, "truth": truth, "where": truth, "stop": truth})


def script_of(parts: dict[str, str], strategy: str, shown: set[str], grouped: bool, ends: int = 2) -> str:
    """A search with these expressions, whose paths stop after so many steps and one."""
    outputs = {
        "n": f"({parts['int']}) % 13",
        "t": parts["text"],
        "b": f"({parts['truth']}) AND True",
        "l": "[m.by % 3]",
    }
    return (
        f"SELECT {', '.join(outputs[name] for name in sorted(shown))} FROM m = moves WHERE {parts['where']} START WITH "
        + ", ".join(f"{name} = {value}" for name, value in STATES.items())
        + ", depth = 0"
        + f" CONNECT BY {strategy} MAXIMUM 40 "
        + ", ".join(f"{name} = {value}" for name, value in outputs.items())
        + f", depth = IF(depth < 9; depth + 1; 9) STOP WITH depth > {ends} OR {parts['stop']}"
        + (" GROUP BY m.by % 2" if grouped else "")
        + " AS list"
    )


@seed(88)
@settings(max_examples=COUNT, deadline=None, database=None)
@given(expressions(), st.sampled_from(STRATEGIES), st.sets(st.sampled_from(list(STATES)), min_size=1), st.booleans())
def test_random_steps(parts: dict[str, str], strategy: str, shown: set[str], grouped: bool) -> None:
    script = script_of(parts, strategy, shown, grouped)
    with ss2sql.connect() as ss:
        ss.set("moves", MOVES)
        wanted = ss.run(script, engine="native")
        try:
            found = ss.run(script, engine="duckdb")
        except ss2sql.UnsupportedError:
            assert grouped  # by what is constant: an aggregate
            return
        assert exact(found.value) == exact(wanted.value)
        assert "in SQL" in str(found.explain()), script


@seed(89)
@settings(max_examples=COUNT // 2, deadline=None, database=None)
@given(
    expressions(), st.sampled_from(STRATEGIES), st.sets(st.sampled_from(list(STATES)), min_size=1), st.integers(1, 12)
)
def test_random_steps_of_which_the_first_are_tried_in_memory(
    parts: dict[str, str], strategy: str, shown: set[str], states: int
) -> None:
    script = script_of(parts, strategy, shown, grouped=False)
    with ss2sql.connect() as ss, pytest.MonkeyPatch.context() as patch:
        patch.setattr(beginning, "STATES", states)
        ss.set("moves", MOVES)
        assert exact(ss.run(script, engine="duckdb").value) == exact(ss.run(script, engine="native").value)


def test_python_is_left_alone_where_steps_are_sql() -> None:
    with ss2sql.connect(engine="duckdb") as ss:
        result = ss.run(
            "SELECT n + this FROM [1, 2] WHERE n + this == 5 START WITH n = 0"
            " CONNECT BY UNIQUE n = n + this STOP WITH n + this > 5 AS list;"
        )
        assert result.value == [[1, 3, 5]]
        assert result.stats.generated == 2 + 4 + 4 + 2  # from 0; from 1 and 2; from 3 and 4; from 5, as 6 stops
        text = str(result.explain())
    assert "tries the steps from them, in SQL" in text
    assert "frontier.n + elements.this AS n" in result.sql


@pytest.mark.parametrize(
    ("script", "reason"),
    [
        ("SELECT f(n) FROM [1] START WITH n = 0 CONNECT BY UNIQUE n = f(n) STOP WITH n > 3", "f is a Python function"),
        (
            "SELECT this FROM f(n) START WITH n = 0 CONNECT BY UNIQUE n = this STOP WITH n > 3",
            "what stands in FROM depends on the state",
        ),
        (
            "SELECT b.this FROM a = [[1], [2]], b = a.this START WITH n = 0 CONNECT BY UNIQUE n = b.this",
            "what stands in FROM depends on another source",
        ),
        (
            "SELECT n + this FROM [0.5] START WITH n = 0.0 CONNECT BY UNIQUE n = n + this STOP WITH n > 3",
            "rows with floats are not compared in the same way everywhere",
        ),
        (
            "SELECT n FROM [1] START WITH n = 'a' CONNECT BY UNIQUE n = str(n)",
            "str is not known to other databases",
        ),
        (
            "SELECT n FROM [1] START WITH n = None CONNECT BY UNIQUE n = None",
            "the kind of this value is not known, or may be None",
        ),
    ],
)
def test_what_is_left_to_python(script: str, reason: str) -> None:
    with ss2sql.connect() as ss:
        ss.function("f", lambda n: [ADDED[n]] if "FROM f" in script else ADDED[n], volatility="immutable")
        found, wanted = ss.run(script, engine="duckdb"), ss.run(script, engine="native")
        assert exact(found.value) == exact(wanted.value)
        assert f"tries the steps from them, in Python: {reason}" in str(found.explain())


def test_names_that_are_words_of_sql() -> None:
    """Every word that DuckDB knows can be a START WITH variable and a column of the elements."""
    words = [word for (word,) in duckdb.sql("SELECT keyword_name FROM duckdb_keywords()").fetchall()]
    with ss2sql.connect() as ss:
        for start in range(0, len(words), 40):
            some = [word for word in dict.fromkeys([*words[start : start + 40], *OWN]) if _is_free(word)]
            ss.set("moves", [dict.fromkeys(some, 1)])
            assigned = ", ".join(f"{word} = {word} + m.{word}" for word in some)
            script = (
                f"SELECT {', '.join(f'{word} + m.{word}' for word in some)} FROM m = moves START WITH "
                + ", ".join(f"{word} = {number}" for number, word in enumerate(some))
                + f" CONNECT BY UNIQUE {assigned} STOP WITH {some[0]} > 2 AS list"
            )
            found = ss.run(script, engine="duckdb")
            assert "in SQL" in str(found.explain())
            assert exact(found.value) == exact(ss.run(script, engine="native").value)


def _is_free(word: str) -> bool:
    """Whether SelectScript has no other meaning for the word."""
    from ss2sql.frontend.text import RESERVED

    return word.upper() not in RESERVED


def test_a_table_of_the_session_is_read_once() -> None:
    with ss2sql.connect() as ss:
        ss.host.connection.execute("CREATE TABLE roads(a INTEGER NOT NULL, b INTEGER NOT NULL) STRICT")
        ss.host.connection.executemany("INSERT INTO roads VALUES (?, ?)", [(1, 2), (2, 3), (1, 4), (4, 3)])
        script = (
            "SELECT r.b FROM r = roads WHERE r.b == 3 AND r.a == at_node START WITH at_node = 1"
            " CONNECT BY UNIQUE at_node = r.b STOP WITH r.a != at_node AS list;"
        )
        found = ss.run(script, engine="duckdb")
        assert found.value == ss.run(script, engine="native").value == [[2, 3]]


def test_variables_are_bound_when_the_search_runs() -> None:
    script = (
        "SELECT n + m.by FROM m = moves WHERE n + m.by == goal AND word == 'ab' START WITH n = 0"
        " CONNECT BY UNIQUE n = n + m.by STOP WITH n > most[0] OR n < -9 AS list"
    )
    with ss2sql.connect() as ss:
        for goal, word, most in [(3, "ab", [5]), (4, "ab", [5]), (4, "b", [5]), (2, "ab", [0])]:
            ss.set("goal", goal)
            ss.set("word", word)
            ss.set("most", most)
            ss.set("moves", MOVES)
            found = ss.run(script, engine="duckdb")
            assert found.value == ss.run(script, engine="native").value
            assert "in SQL" in str(found.explain())
        ss.set("goal", 4.0)  # of another kind: compiled anew
        assert ss.run(script, engine="duckdb").value == ss.run(script, engine="native").value


def test_a_variable_without_a_value_fails_where_it_is_read() -> None:
    script = "SELECT this FROM {} WHERE this == missing START WITH n = 0 CONNECT BY UNIQUE n = this AS list"
    with ss2sql.connect() as ss:
        assert ss.compile(script.format("[]"), engine="duckdb").parameters == ("missing",)
        for engine in ("duckdb", "native"):
            assert code_of(ss.run, script.format("[1]"), engine=engine) == "R001"


def test_what_is_equal_after_each_step_may_differ_at_the_start() -> None:
    script = (
        "SELECT this FROM [1, 2, 3] WHERE this == a + b START WITH a = 1, b = 2"
        " CONNECT BY UNIQUE a = this, b = this AS list"
    )
    with ss2sql.connect() as ss:
        assert ss.run(script, engine="duckdb").value == ss.run(script, engine="native").value == [[3]]


def test_a_state_that_no_step_changes() -> None:
    script = (
        "SELECT n + this FROM [1, 2] WHERE n + this == goal START WITH n = 0, goal = 5"
        " CONNECT BY UNIQUE n = n + this STOP WITH n > goal AS list"
    )
    with ss2sql.connect() as ss:
        found = ss.run(script, engine="duckdb")
        assert found.value == [[1, 3, 5]]
        assert "in SQL" in str(found.explain())


def test_no_elements() -> None:
    script = "SELECT this + n FROM [] START WITH n = 0 CONNECT BY UNIQUE n = 1 AS list"
    with ss2sql.connect() as ss:
        assert ss.run(script, engine="duckdb").value == []


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_the_start_is_no_row_that_was_met(strategy: str) -> None:
    script = (
        f"SELECT (n + this) % 3 FROM [1] START WITH n = 0 CONNECT BY {strategy} MAXIMUM 9 n = (n + this) % 3 AS list"
    )
    with ss2sql.connect() as ss:
        found: Any = ss.run(script, engine="duckdb").value
        assert found[:3] == [[1], [1, 2], [1, 2, 0]]
        assert found == ss.run(script, engine="native").value


@pytest.mark.parametrize("stop", ["n > 4 AND this > 0 OR this == 7", "NOT (n < 5 OR this == 7)", "NOT n < 5"])
def test_conditions_that_stop(stop: str) -> None:
    script = f"SELECT n + this FROM [1, 2, 3] START WITH n = 0 CONNECT BY UNIQUE n = n + this STOP WITH {stop} AS list"
    with ss2sql.connect() as ss:
        found = ss.run(script, engine="duckdb")
        assert "in SQL" in str(found.explain())
        assert found.value == ss.run(script, engine="native").value


def test_the_opposite_of_a_negation_is_what_was_negated() -> None:
    search = "START WITH n = 1 CONNECT BY UNIQUE n = (n + this) % 3 STOP WITH NOT n"
    script = f"SELECT (n + this) % 3 FROM [1] {search} AS list"
    with ss2sql.connect() as ss:
        found = ss.run(script, engine="duckdb")
        assert found.value == ss.run(script, engine="native").value == [[2], [2, 0]]
    assert "AND frontier.goes_on AND frontier.n <> 0\n" in found.sql


def test_a_state_that_may_be_none_is_tried_in_python() -> None:
    script = "SELECT this FROM [1, 2] START WITH n = None CONNECT BY UNIQUE n = IF(this > 1; None; this) AS list"
    with ss2sql.connect() as ss:
        found = ss.run(script, engine="duckdb")
        assert "in SQL" not in str(found.explain())
        assert found.value == ss.run(script, engine="native").value


def test_more_elements_than_steps_can_be_numbered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(typed_search, "ELEMENTS", 2)
    script = "SELECT this FROM range({}) START WITH n = 0 CONNECT BY UNIQUE n = this AS list"
    with ss2sql.connect() as ss:
        assert len(ss.run(script.format(2), engine="duckdb").value) == 2
        with pytest.raises(ss2sql.UnsupportedError, match=r"FROM has more than .* elements"):
            ss.run(script.format(3), engine="duckdb")
