"""The paper's program runs with its import line changed; and what older packages do otherwise makes no difference."""

from __future__ import annotations

import pytest
from listings import HANOI
from sqlglot import exp
from sqlglot.dialects.sqlite import SQLite
from sqlglot.generator import Generator

import ss2sql
import ss2sql.compat
from ss2sql.lowering.sql_builder import SQLITE, _build_dialect_class

# As printed, but for the first line, which was: import SelectScript, SelectScript.Interpreter
STUB = '''
 import ss2sql.compat as SelectScript

 def move(step, towers):
     if not towers or not towers[step[0]]: pass
     elif not towers[step[1]] or towers[step[1]][-1]>towers[step[0]][-1]:
         #append element on top from another tower top
         towers[step[1]].append(towers[step[0]].pop())
         return towers
     return []

 ss = SelectScript.Interpreter()
 ss.addFunction('move', move)

 problem = """ insert SelectScript here """
 
 ir      = SelectScript.compile(problem)
 result  = ss.eval(ir)
'''  # noqa: W293 - as printed
MOVES = "moves = [[0,1], [0,2], [1,0], [1,2], [2,0], [2,1]];\n"
SEVEN = [[0, 2], [0, 1], [2, 1], [0, 2], [1, 0], [1, 2], [0, 2]]


def stub(problem: str) -> object:
    """What the program gives with a script put in its place."""
    names: dict[str, object] = {}
    text = STUB.replace(" insert SelectScript here ", problem)
    exec("\n".join(line.removeprefix(" ") for line in text.splitlines()), names)
    return names["result"]


@pytest.mark.slow
def test_the_program_stub_solves_the_towers_in_nested_loops() -> None:
    assert stub(HANOI["nested"]) == SEVEN


def test_the_program_stub_solves_the_towers() -> None:
    assert stub(MOVES + HANOI["cycle"]) == [[{"this": step} for step in SEVEN]]
    corrected = HANOI["no-cycle"].replace("mov.this", "this")
    (path,) = stub(MOVES + corrected)  # type: ignore[misc]
    assert [row["this"] for row in path] == SEVEN
    (path,) = stub(MOVES + HANOI["memorize"])  # type: ignore[misc]
    assert len(path) == 15
    assert path[0] == {"this": [0, 1], "tower": [[4, 3, 2, 1], [], []]}


def test_scripts_are_compiled_before_the_functions_are_known() -> None:
    script = ss2sql.compat.compile("double(x) + 1;")
    interpreter = ss2sql.compat.Interpreter()
    with pytest.raises(ss2sql.ResolveError):
        interpreter.eval(script)
    interpreter.addFunction("double", lambda x: 2 * x)
    interpreter.addVariable("x", 20)
    assert interpreter.eval(script) == 41
    assert interpreter.eval("double(3);") == 6
    with pytest.raises(ss2sql.ParseError):
        ss2sql.compat.compile("SELECT FROM;")


def test_variables_go_both_ways() -> None:
    interpreter = ss2sql.compat.Interpreter()
    bodies = ["ball"]
    interpreter.addVariable("bodies", bodies)
    assert interpreter.callVariable("bodies") is bodies
    bodies.append("box")
    assert interpreter.eval("found = SELECT this FROM bodies AS list;") == ["ball", "box"]
    assert interpreter.callVariable("found") == ["ball", "box"]
    with pytest.raises(KeyError):
        interpreter.callVariable("nothing")


# --- older packages: `make compat` has them, these say what it found -------------------------------------


class Sqlglot30(SQLite.Generator):
    """How the first releases of sqlglot 30 print for SQLite."""

    SUPPORTS_TABLE_ALIAS_COLUMNS = False
    SUPPORTS_NAMED_CTE_COLUMNS = False
    nullsafeeq_sql = Generator.nullsafeeq_sql
    nullsafeneq_sql = Generator.nullsafeneq_sql


def test_sql_is_the_same_whichever_sqlglot_prints_it(monkeypatch: pytest.MonkeyPatch) -> None:
    _build_dialect_class.cache_clear()
    monkeypatch.setattr(SQLite, "generator_class", Sqlglot30)
    name = exp.to_identifier
    one = exp.select(exp.NullSafeEQ(this=exp.column("a"), expression=exp.NullSafeNEQ(this=exp.null(), expression="b")))
    alias = exp.TableAlias(this=name("t"), columns=[name("a")])
    tree = one.from_("t")
    tree.set("with_", exp.With(expressions=[exp.CTE(this=exp.select("1"), alias=alias)]))
    try:
        assert " ".join(SQLITE.print_tree(tree).split()) == "WITH t(a) AS ( SELECT 1 ) SELECT a IS NULL IS NOT b FROM t"
    finally:
        _build_dialect_class.cache_clear()
