"""The walk of ss2sql/ARCHITECTURE.md: the paper's first search is run, and the functions that it enters are listed.

`FUNCTIONS` names those that a newcomer should see. Their order, what they give and what they do come from the run and
from their docstrings, so the walk is what happens.
"""

from __future__ import annotations

import sys
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from inspect import getdoc
from pathlib import Path
from typing import TYPE_CHECKING, Any

from writing import first, table

import ss2sql
from ss2sql.language.plan_traversal import format_plan

if TYPE_CHECKING:
    from collections.abc import Iterator
    from types import FrameType

PACKAGE = Path(ss2sql.__path__[0])
SCRIPT = """
SELECT this FROM moves WHERE [[],[],[3,2,1]] == move(this, tower)
START WITH tower = [[3,2,1],[],[]],   level = 1
CONNECT BY tower = move(this, tower), level = level+1
STOP WITH  level == 7 OR [] == move(this, tower);
"""
FUNCTIONS = {
    "both": """
        session/session.py Session.run · frontend/syntax/parser.py parse · frontend/syntax/tokenizer.py tokenize ·
        frontend/syntax/parser.py run_automaton · frontend/syntax/tree_builder.py Builder.query ·
        frontend/resolve/resolver.py resolve · frontend/resolve/query_clauses.py resolve_query ·
        frontend/resolve/from_clause.py resolve_sources · frontend/resolve/search_clauses.py resolve_search_options ·
        lowering/rewrites/__init__.py optimise · session/compiled_script.py execute_script · session/compiled_query.py
        CompiledQuery.run_query · runtime/representations/shape.py Representations.represent_rows ·
        runtime/representations/shape.py as_dict
    """,
    "database": """
        lowering/lower.py lower · lowering/unsupported.py check_supported · lowering/search.py
        EagerSearch.build_statement · lowering/recursive_query.py RecursiveQuery.lower_start · lowering/search.py
        EagerSearch.write_steps · lowering/search.py EagerSearch.select_results · lowering/sql_builder.py
        Dialect.print_tree · runtime/sqlite/executor.py Database.execute · runtime/run/search_paths.py
        SearchPaths.choose_paths
    """,
    "native": """
        runtime/python/native_query.py QueryCompiler.compile_query ·
        runtime/python/search_compiler.py compile_search · runtime/search/__init__.py choose_search ·
        runtime/python/step_function.py StepFunction.write_function · runtime/python/codegen_context.py
        CodegenContext.compile_module · runtime/python/native_query.py NativeQuery.compute_rows ·
        runtime/search/depth_first.py depth_first
    """,
}


def walk() -> str:
    """The functions that the search enters, in their order, for both engines."""
    database, native = entered("database"), entered("native")
    own = {name for name in names("native") if name not in database}
    return table(
        "file | function | gives | what it does",
        [_row(name, given) for name, given in database.items()],
    ) + (
        "\n\nThe Python engine takes the same walk up to `optimise`, and from `represent` on. In between it enters:\n\n"
        + table("file | function | gives | what it does", [_row(name, native[name]) for name in native if name in own])
    )


def names(engine: str) -> list[str]:
    """The functions that `FUNCTIONS` has for one engine, those of both included: `file function`."""
    return [" ".join(each.split()) for part in ("both", engine) for each in FUNCTIONS[part].split("·")]


@cache
def entered(engine: str) -> dict[str, str]:
    """The functions of `names(engine)` in the order in which a run enters them, with the type that each gives first."""
    wanted = set(names(engine))
    seen: dict[str, str] = {}

    def note(frame: FrameType, event: str, given: Any) -> None:
        code = frame.f_code
        if event not in ("call", "return") or not code.co_filename.startswith(str(PACKAGE)):
            return
        name = f"{Path(code.co_filename).relative_to(PACKAGE)} {code.co_qualname}"
        if name in wanted and not (event == "return" and seen[name]):
            seen[name] = "" if event == "call" and name not in seen else seen.get(name) or _type(given)

    with _session() as ss:
        before = sys.getprofile()
        sys.setprofile(note)
        try:
            value = ss.run(SCRIPT, engine=engine).value
        finally:
            sys.setprofile(before)
    assert len(value) == 1, value
    assert wanted == set(seen), f"not entered by {engine}: {sorted(wanted - set(seen))}"
    return seen


def _type(value: Any) -> str:
    return "" if value is None else type(value).__name__


def _row(name: str, given: str) -> tuple[str, str, str, str]:
    file, function = name.split()
    module = import_module("ss2sql." + file.removesuffix(".py").removesuffix("/__init__").replace("/", "."))
    found: Any = module
    for part in function.split("."):
        found = getattr(found, part)
    return f"`{file}`", f"`{function}`", given and f"`{given}`", first(getdoc(found) or "")


@contextmanager
def _session() -> Iterator[ss2sql.Session]:
    def move(step: list[int], towers: list[list[int]]) -> list[list[int]]:
        if towers and towers[step[0]] and (not towers[step[1]] or towers[step[1]][-1] > towers[step[0]][-1]):
            towers[step[1]].append(towers[step[0]].pop())
            return towers
        return []

    with ss2sql.connect() as ss:
        ss.set("moves", [[0, 1], [0, 2], [1, 0], [1, 2], [2, 0], [2, 1]])
        ss.function("move", move, volatility="immutable")
        yield ss


def forms() -> str:
    """The search as text, as plan and as SQL."""
    with _session() as ss:
        plan = format_plan(ss.compile(SCRIPT, engine="native").plan)
        sql = str(ss.compile(SCRIPT, engine="database").sql)
    parts = (("The script", "selectscript", SCRIPT), ("The plan", "text", plan), ("The SQL", "sql", sql))
    return "\n\n".join(f"{name}:\n\n```{kind}\n{text.strip()}\n```" for name, kind, text in parts)
