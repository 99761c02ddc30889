"""The same program in another order, where the language leaves the order open.

That is the order of statements that set variables to constants, of functions, variables and tables when they are made
known, of the options of CONNECT BY, of GROUP BY, ORDER BY and LIMIT, and of the parts of a WHERE that neither fail nor
call anything. The order of FROM is promised: it decides the order of the rows, so another one sorts them anew.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from random import Random
from typing import Any

from ss2sql.errors import Source
from ss2sql.frontend import ast
from ss2sql.frontend.parser import parse
from ss2sql.frontend.text import CLOSING, OPENING, Token, cut

from .case import ProgramCase
from .choices import Choices

BEFORE_BY = ("GROUP", "ORDER")


def shuffled(case: ProgramCase, dice: Random) -> ProgramCase:
    """The program with everything in another order that may be."""
    script = with_statements_shuffled(case.script, dice)
    script = with_clauses_shuffled(with_options_shuffled(script, dice), dice)
    return ProgramCase(
        script,
        dict(dice.sample(list(case.variables.items()), len(case.variables))),
        tuple(dice.sample(case.uses, len(case.uses))),
        dict(dice.sample(list(case.tables.items()), len(case.tables))),
    )


def with_statements_shuffled(script: str, dice: Random) -> str:
    """The assignments of constants that a script begins with, in another order."""
    first: list[str] = []
    names: set[str] = set()
    statements = parse(Source(script)).statements
    for statement in statements[:-1]:
        if not isinstance(statement, ast.Assign) or not _constant(statement.value) or statement.name in names:
            break
        names.add(statement.name)
        first.append(statement.span.text)
    if not first:
        return script
    rest = script[script.index(";", statements[len(first) - 1].span.end) + 1 :]
    return "; ".join([*dice.sample(first, len(first)), rest])


def _constant(tree: ast.Expr) -> bool:
    match tree:
        case ast.Literal():
            return True
        case ast.Operator(function="neg", operands=operands):
            return all(map(_constant, operands))
        case ast.ListLiteral(items=items):
            return all(map(_constant, items))
        case _:
            return False


def with_options_shuffled(script: str, dice: Random) -> str:
    """The options of the last statement's search in another order."""
    last = parse(Source(script)).statements[-1]
    if not isinstance(last, ast.Query) or len(last.options) < 2:
        return script
    texts = [option.span.text for option in last.options]
    start, end = last.options[0].span.start, last.options[-1].span.end
    return f"{script[:start]}{' '.join(dice.sample(texts, len(texts)))}{script[end:]}"


def with_clauses_shuffled(script: str, dice: Random) -> str:
    """GROUP BY, ORDER BY and LIMIT of the last statement in another order, where they stand outside of brackets."""
    last = parse(Source(script)).statements[-1]
    if not isinstance(last, ast.Query):
        return script
    starts, depth, end = [], 0, last.span.end
    tokens = [token for token in cut(script) if last.span.start <= token.start < end]
    for token, following in zip(tokens, [*tokens[1:], None], strict=True):
        depth += (token.kind in OPENING) - (token.kind in CLOSING)
        if depth == 0 and token.kind == "AS":
            end = token.start
        elif depth == 0 and (token.keyword == "LIMIT" or (token.keyword in BEFORE_BY and _is_by(following))):
            starts.append(token.start)
    if len(starts) < 2:
        return script
    ends = [*starts[1:], end]
    clauses = [script[start:stop].strip() for start, stop in zip(starts, ends, strict=True)]
    return f"{script[: starts[0]]}{' '.join(dice.sample(clauses, len(clauses)))} {script[end:]}"


def _is_by(token: Token | None) -> bool:
    return token is not None and token.keyword == "BY"


# --- WHERE and FROM ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Product:
    """A product of sources that do not mention each other, and parts of a condition that cannot fail."""

    sources: tuple[tuple[str, str], ...]  # name and text
    parts: tuple[str, ...]
    variables: dict[str, Any]
    tables: dict[str, list[dict[str, Any]]]
    order: str

    def case(self, names: Sequence[str], parts: Sequence[str]) -> ProgramCase:
        """The query with its sources and the parts of its condition in this order; each row shows its place."""
        texts = dict(self.sources)
        shown = ", ".join(f"{name}.at, {name}.v" for name in sorted(texts))
        where = f" WHERE {' AND '.join(parts)}" if parts else ""
        text = f"SELECT {shown} FROM {', '.join(f'{name} = {texts[name]}' for name in names)}{where}{self.order}"
        return ProgramCase(f"{text} AS rows", self.variables, (), self.tables)

    def places(self, row: Sequence[Any], names: Sequence[str]) -> list[Any]:
        """Where the elements of a row stand in their sources, the slowest one first."""
        columns = sorted(name for name, _ in self.sources)
        return [row[2 * columns.index(name)] for name in names]


VALUES: tuple[Any, ...] = (1, 2, 1.0, 0, True, "a", "b", "1", [1], [1.0], [], -1, 2.5)


def product(data: bytes) -> Product:
    """The product that the bytes stand for."""
    c = Choices(data)
    names = "abc"[: c.pick((2, 3))]
    variables: dict[str, Any] = {}
    tables: dict[str, list[dict[str, Any]]] = {}
    sources = []
    for name in names:
        form = c.pick(("variable", "query", "columns", "table"))
        values = [1, 2, 3, 0] if form == "table" else [*VALUES, None]
        rows = [{"at": at, "v": c.pick(values)} for at in range(1 + c.below(4))]
        text = f"the_{name}"
        match form:
            case "table":
                tables[text] = rows
            case "columns":
                variables[text] = {key: [row[key] for row in rows] for key in ("at", "v")}
            case _:
                variables[text] = rows
        sources.append((name, f"(SELECT at, v FROM {text} WHERE v != 2)" if form == "query" else text))
    parts = tuple(_quiet(c, names, 1) for _ in range(c.pick((2, 3, 1, 4, 0))))
    order = c.pick(("", f" ORDER BY {names[-1]}.at DESC", f" ORDER BY {names[0]}.v == 1, {names[-1]}.v != 'a'"))
    return Product(tuple(sources), parts, variables, tables, order)


def _quiet(c: Choices, names: str, depth: int) -> str:
    """A condition that cannot fail, whatever the values are."""
    one, other = f"{c.pick(names)}.v", c.pick((f"{c.pick(names)}.v", repr(c.pick(VALUES)), "None"))
    form = c.weighted(
        (10, "{a} == {b}"), (10, "{a} != {b}"), (3, "{a} IN [1, 'a', [1.0], {b}]"), (3, "{a} NOT IN [2, {b}]"),
        (4, "({c} OR {d})"), (3, "NOT ({c})"), (3, "({c} XOR {d})"), (3, "{a}"), (3, "({c} AND {d})"),
        (3, "[] == (SELECT this FROM [{a}, {b}, 2] WHERE this == {a} AND {c} AS list)"), (2, "IF({c}; {d}; {a} == 1)"),
        (2, "[{a}, {b}] == [{b}, {a}]"), (1, "True"),
    )  # fmt: skip
    if depth == 0 and "{c}" in form:
        form = "{a} == {b}"
    inner = [_quiet(c, names, depth - 1) if depth else "" for _ in range(2)]
    return form.format(a=one, b=other, c=inner[0], d=inner[1])
