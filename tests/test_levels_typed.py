"""Steps as SQL in the level engine: the same paths as natively, and what is left to Python."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from hypothesis import given, seed, settings
from hypothesis import strategies as st
from level_searches import BY_LENGTH, agree, by_sheet
from programs.drawn import amount
from sessions import code_of

import ss2sql
from ss2sql.frontend.text import RESERVED
from ss2sql.lowering.portable.names import OWN
from ss2sql.runtime.levels import beginning, typed_search

duckdb = pytest.importorskip("duckdb")

COUNT = amount(1 / 8)
MOVES = [
    {"by": 1, "word": "a", "far": False},
    {"by": -2, "word": "", "far": True},
    {"by": 3, "word": "bü", "far": True},
]
STATES = {"n": "0", "t": "'x'", "b": "False", "l": "[1]"}

INTS = ("n", "m.by", "1", "-3", "7")
TEXTS = ("t", "m.word", "'x'", "''", "'äb'")


@pytest.fixture(autouse=True)
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """The tables do all levels, also small ones."""
    monkeypatch.setattr(beginning, "STATES", 0)


@pytest.fixture
def ss() -> Iterator[ss2sql.Session]:
    with ss2sql.connect(engine="duckdb") as session:
        session.set("moves", MOVES)
        yield session


# Expressions of ints stay within bounds by a remainder.
NUMBERS = (
    *("(({} + {}) % 9)", "(({} - {}) % -7)", "(({} * {}) % 5)", "abs({} % 11)", "(-({} % 6))", "min({} % 8, {} % 8)"),
    "IF({} < {}; {} % 4; 2)",
)
TRUTHS = ("{} < {}", "{} != {}", "{} IN [1, 3, -1]", "(m.far XOR {} > 1)", "({} == 2 OR NOT {} == 3)")


def filled(form: str, inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    return st.builds(form.format, *[inner] * form.count("{}"))


def expressions() -> st.SearchStrategy[dict[str, str]]:
    """Expressions by kind."""
    words = st.sampled_from(TEXTS)
    number = st.recursive(
        st.sampled_from(INTS),
        lambda inner: st.one_of(filled("len({})", words), *(filled(form, inner) for form in NUMBERS)),
        max_leaves=4,
    )
    text = st.one_of(filled("({} + {})[0:3]", words), filled("({} + {})[1:4]", words), words)
    truth = st.one_of(
        *(filled(form, number) for form in TRUTHS),
        *(filled(form, text) for form in ("{} == {}", "{} <= {}", "{} NOT IN {}")),
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
@given(
    expressions(),
    st.sampled_from(BY_LENGTH),
    st.sets(st.sampled_from(list(STATES)), min_size=1),
    st.booleans(),
    st.sampled_from((0, 0, 1, 4, 12)),
)
def test_random_steps(parts: dict[str, str], strategy: str, shown: set[str], grouped: bool, states: int) -> None:
    """Of some searches the first steps are tried in memory."""
    script = script_of(parts, strategy, shown, grouped)
    with ss2sql.connect(engine="duckdb") as ss, pytest.MonkeyPatch.context() as patch:
        patch.setattr(beginning, "STATES", states)
        ss.set("moves", MOVES)
        try:
            found = agree(ss, script)
        except ss2sql.UnsupportedError:
            assert grouped  # by what is constant: an aggregate
            return
        assert "in SQL" in str(found.explain()), script


def test_python_is_left_alone_where_steps_are_sql(ss: ss2sql.Session) -> None:
    result = ss.run(
        "SELECT n + this FROM [1, 2] WHERE n + this == 5 START WITH n = 0"
        " CONNECT BY UNIQUE n = n + this STOP WITH n + this > 5 AS list;"
    )
    assert result.value == [[1, 3, 5]]
    assert result.stats.generated == 2 + 4 + 4 + 2  # from 0; from 1 and 2; from 3 and 4; from 5, as 6 stops
    assert "tries the steps from them, in SQL" in str(result.explain())
    assert "frontier.n + elements.this AS n" in result.sql


def test_steps_in_sql(ss: ss2sql.Session) -> None:
    for row, result in by_sheet(ss, "search/steps-in-sql"):
        assert "in SQL" in str(result.explain()), row


NOT_KNOWN = "the kind of this {} is not known, or may be None"


@pytest.mark.parametrize(
    ("search", "reason"),
    [
        ("f(n) FROM [1] START WITH n = 0 CONNECT BY UNIQUE n = f(n) STOP WITH n > 3", "f is a Python function"),
        (
            "this FROM [f(n)] START WITH n = 0 CONNECT BY UNIQUE n = this STOP WITH n > 3",
            "what stands in FROM depends on the state",
        ),
        (
            "b.this FROM a = [[1], [2]], b = a.this START WITH n = 0 CONNECT BY UNIQUE n = b.this",
            "what stands in FROM depends on another source",
        ),
        (
            "n + this FROM [0.5] START WITH n = 0.0 CONNECT BY UNIQUE n = n + this STOP WITH n > 3",
            "rows with floats are not compared in the same way everywhere",
        ),
        ("n FROM [1] START WITH n = 'a' CONNECT BY UNIQUE n = str(n)", "str is not known to other databases"),
        ("n FROM [1] START WITH n = None CONNECT BY UNIQUE n = None", NOT_KNOWN.format("value")),
        ("this + n FROM [] START WITH n = 0 CONNECT BY UNIQUE n = 1", NOT_KNOWN.format("value")),
        (
            "this FROM [1, 2] START WITH n = None CONNECT BY UNIQUE n = IF(this > 1; None; this)",
            NOT_KNOWN.format("variable"),
        ),
    ],
)
def test_what_is_left_to_python(ss: ss2sql.Session, search: str, reason: str) -> None:
    added = {0: 1, 1: 2, 2: 3, 3: 4, 4: 5}
    ss.function("f", lambda n: added[n], volatility="immutable")
    assert f"tries the steps from them, in Python: {reason}" in str(agree(ss, f"SELECT {search}").explain())


@pytest.mark.parametrize("kinds", ["reserved", pytest.param("%", marks=pytest.mark.slow)])
def test_names_that_are_words_of_sql(ss: ss2sql.Session, kinds: str) -> None:
    """Every word that DuckDB knows can be a START WITH variable and a column of the elements."""
    known = f"SELECT keyword_name FROM duckdb_keywords() WHERE keyword_category LIKE '{kinds}'"
    words = [word for (word,) in duckdb.sql(known).fetchall()]
    for start in range(0, len(words), 40):
        some = dict.fromkeys(word for word in (*words[start : start + 40], *OWN) if word.upper() not in RESERVED)
        first, *_ = some
        ss.set("moves", [dict.fromkeys(some, 1)])
        shown = ", ".join(f"{word} + m.{word}" for word in some)
        begun = ", ".join(f"{word} = {number}" for number, word in enumerate(some))
        assigned = ", ".join(f"{word} = {word} + m.{word}" for word in some)
        search = f"START WITH {begun} CONNECT BY UNIQUE {assigned} STOP WITH {first} > 2"
        assert "in SQL" in str(agree(ss, f"SELECT {shown} FROM m = moves {search} AS list").explain())


def test_a_table_of_the_session_is_read(ss: ss2sql.Session) -> None:
    ss.host.connection.execute("CREATE TABLE roads(a INTEGER NOT NULL, b INTEGER NOT NULL) STRICT")
    ss.host.connection.executemany("INSERT INTO roads VALUES (?, ?)", [(1, 2), (2, 3), (1, 4), (4, 3)])
    script = (
        "SELECT r.b FROM r = roads WHERE r.b == 3 AND r.a == at_node START WITH at_node = 1"
        " CONNECT BY UNIQUE at_node = r.b STOP WITH r.a != at_node AS list;"
    )
    assert agree(ss, script).value == [[2, 3]]


def test_variables_are_bound_when_the_search_runs(ss: ss2sql.Session) -> None:
    script = (
        "SELECT n + m.by FROM m = moves WHERE n + m.by == goal AND word == 'ab' START WITH n = 0"
        " CONNECT BY UNIQUE n = n + m.by STOP WITH n > most[0] OR n < -9 AS list"
    )
    for goal, word, most in [(3, "ab", [5]), (4, "ab", [5]), (4, "b", [5]), (2, "ab", [0])]:
        for name, value in {"goal": goal, "word": word, "most": most}.items():
            ss.set(name, value)
        assert "in SQL" in str(agree(ss, script).explain())
    ss.set("goal", 4.0)  # of another kind: compiled anew
    agree(ss, script)


def test_a_variable_without_a_value_fails_where_it_is_read(ss: ss2sql.Session) -> None:
    script = "SELECT this FROM {} WHERE this == missing START WITH n = 0 CONNECT BY UNIQUE n = this AS list"
    assert ss.compile(script.format("[]")).parameters == ("missing",)
    for engine in ("duckdb", "native"):
        assert code_of(ss.run, script.format("[1]"), engine=engine) == "R001"


def test_more_elements_than_steps_can_be_numbered(ss: ss2sql.Session, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(typed_search, "ELEMENTS", 2)
    script = "SELECT this FROM range({}) START WITH n = 0 CONNECT BY UNIQUE n = this AS list"
    assert len(ss.run(script.format(2)).value) == 2
    with pytest.raises(ss2sql.UnsupportedError, match=r"FROM has more than .* elements"):
        ss.run(script.format(3))
