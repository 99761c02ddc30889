"""Suggestions for unknown names: functions of SQL and Python, methods, strings without quotes."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

from ss2sql.errors import ResolveError, Span, suggest_names, suggest_similar
from ss2sql.fast_dataclasses import dataclass
from ss2sql.frontend.syntax import ast
from ss2sql.language import plan

if TYPE_CHECKING:
    from ss2sql.frontend.resolve.catalog import Catalog
    from ss2sql.frontend.resolve.scope import Scope

_HIDDEN = frozenset({"item", "slice", "like"})  # functions that are written as operators
_MEAN = "did you mean '{0}'?"

# Functions that other languages have, and what is written here; {0} and {1} are the arguments of the call.
FOREIGN_FUNCTIONS: dict[str, str] = {
    **dict.fromkeys(("ifnull", "nvl", "isnull"), "write coalesce({0}, {1})"),
    "nullif": "write IF({0} == {1}; None; {0})",
    "iif": "write IF({0}; {1}; {2})", "decode": "write CASE WHEN {0} == {1} THEN {2} ELSE {3} END",
    "concat": "write {0} + {1}",
    **dict.fromkeys(("substr", "substring", "mid"), "write {0}[{1} - 1:{1} - 1 + {2}]"),
    "left": "write {0}[:{1}]", "right": "write {0}[-{1}:]", "to_char": "write str({0})",
    "to_number": "write float({0})",
    "connect_by_root": "write root({0})",
    "length": "write len({0})", "size": "write len({0})", "avg": "write average({0})", "mean": "write average({0})",
    "distinct": "write uniq({0})", "unique": "write uniq({0})", "set": "write uniq({0})",
    "power": "write {0} ^ {1}", "exists": "write [] != ({list})",
    "sys_connect_by_path": "write path({0}, {1})", "append": "a list is not changed, a new one is made: {0} + [{1}]",
    "cast": "write int({0}), float({0}) or str({0})",
    "extend": "a list is not changed, a new one is made: {0} + {1}",
    **dict.fromkeys(("ucase", "toupper"), "write upper({0})"),
    **dict.fromkeys(("lcase", "tolower"), "write lower({0})"),
    "trim": "write strip({0})", "startswith": "write starts({0}, {1})", "endswith": "write ends({0}, {1})",
    **dict.fromkeys(("instr", "position", "charindex", "strpos"), "write find({0}, {1})"),
    **dict.fromkeys(("group_concat", "string_agg", "listagg"), "write join(SELECT {0} FROM ... AS list, ', ')"),
    "ceiling": "write ceil({0})", "ln": "write log({0})", "log2": "write log({0}, 2)", "log10": "write log({0}, 10)",
    "atan": "write atan2({0}, 1)", "radians": "write {0} * pi() / 180", "degrees": "write {0} * 180 / pi()",
    "hypot": "write norm([{0}, {1}])", "std": "write stddev({0})", "stdev": "write stddev({0})",
    "var_samp": "write variance({0})", "stddev_samp": "write stddev({0})", "typeof": "write type({0})",
    "strptime": "write datetime('2024-05-31 12:30')", "current_timestamp": "write now()", "today": "write date(now())",
    **dict.fromkeys(("rand", "random"), "session.function('random', random.random) registers Python's"),
    "gcd": "session.function('gcd', math.gcd) registers Python's", "current_date": "write date(now())",
    "enumerate": "write zip(range(len({0})), {0})",
}  # fmt: skip
# Names of Oracle.
_ORACLE = {
    "LEVEL": "level()", "CONNECT_BY_ISLEAF": "leaf()", "CONNECT_BY_ISCYCLE": "cycle({key})",
    "ROWNUM": "LIMIT n after the other clauses",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Place:
    """Where a name stands: inside a query, where there is a `this`; as an operand, where it may be a string.

    `sources` are the visible ones, `key` is what the search compares.
    """

    inside: bool
    operand: bool
    sources: tuple[plan.Source, ...]
    key: str = "key"


def explain_unknown_function(tree: ast.Call, catalog: Catalog, variables: Collection[str]) -> ResolveError:
    """The error for a call of an unknown function."""
    name = tree.function
    every = (*catalog.functions, *catalog.world_functions)
    known = [one for one in every if one not in _HIDDEN and "." not in one]
    if name in variables:
        hints: Sequence[str] = (f"'{name}' is a variable: write it without parentheses",)
    elif same := [one for one in known if one.lower() == name.lower()]:
        hints = (_MEAN.format(same[0]),)
    else:
        hints = _suggest_equivalent(name, tree.arguments) or suggest_names(name, known)
    hints = hints or ("register it with session.function; help() lists the known ones",)
    return ResolveError("R002", f"unknown function '{name}'", read_leading_name(tree.span, name), hints)


def _suggest_equivalent(name: str, arguments: Sequence[ast.Expr]) -> tuple[str, ...]:
    """The equivalent of a function of another language."""
    lowered = name.lower()
    if lowered not in FOREIGN_FUNCTIONS:
        return ()
    whole = [argument.span.text for argument in arguments[:4]]
    texts = [text if len(text) <= 40 else "..." for text in whole]
    bare = bool(arguments) and isinstance(arguments[0], ast.Query) and arguments[0].representation is None
    listed = f"{texts[0]} AS list" if bare else "SELECT ... AS list"
    return (FOREIGN_FUNCTIONS[lowered].format(*texts, *("..." for _ in range(4 - len(texts))), list=listed),)


def explain_method(tree: ast.Call, catalog: Catalog, variables: Collection[str]) -> ResolveError:
    """The error for `owner.function(...)` where the owner is no world or lacks the function."""
    owner, name = tree.owner or "", tree.function
    place = read_leading_name(tree.span, f"{owner}.{name}")
    world = catalog.worlds.get(owner)
    if world is not None:
        if name in world.tables:
            hints: tuple[str, ...] = (f"{owner}.{name} is a table: write FROM {owner}.{name}(...)",)
        else:
            hints = suggest_names(name, world.list_callable_names()) or (f"help({owner}) lists what it has",)
        return ResolveError("R002", f"the world '{owner}' has no function '{name}'", place, hints)
    if owner in variables:
        return ResolveError(
            "R002", f"values have no methods, and '{owner}' is no world", place, _suggest_call(tree, catalog)
        )
    message = f"there is no world '{owner}' with a function '{name}'"
    if suggest_similar(owner, catalog.worlds):
        hints = suggest_names(owner, catalog.worlds)
    elif name in catalog.functions:
        hints = (f"'{name}' is a function by itself: write {name}(...)",)
    else:
        hints = _suggest_equivalent(name, tree.arguments) or ("help() lists the functions there are",)
    return ResolveError("R002", message, place, hints)


def _suggest_call(tree: ast.Call, catalog: Catalog) -> tuple[str, ...]:
    """The call that replaces a method of a value."""
    owner, name = tree.owner or "", tree.function
    subject = ast.Name(owner, span=read_leading_name(tree.span, owner))
    there = _suggest_equivalent(name, (subject, *tree.arguments))
    if name.lower() in FOREIGN_FUNCTIONS:
        return there
    call = f"write {name}({owner}{', ...' if tree.arguments else ''})"
    return (call,) if name in catalog.functions else (f"{call}, with a function that is registered", *there)


def explain_unknown_name(name: str, span: Span, catalog: Catalog, known: Sequence[str], place: Place) -> ResolveError:
    """The error for an unknown bare name."""
    if name in catalog.functions:
        hints: tuple[str, ...] = (f"'{name}' is a function: write {name}({'this' if place.inside else '...'})",)
        hints += (f"its name as a text is '{name}'",) if place.operand and not place.inside else ()
    elif any(source.name == name for source in place.sources):
        hints = (f"'{name}' is a source: write {name}.this",)
    elif name.upper() in _ORACLE:
        hints = (f"write {_ORACLE[name.upper()]}".format(key=place.key),)
    elif name.upper() in ("NULL", "NIL"):
        hints = ("write None",)
    else:
        cure = f"assign it before, or give it from Python: run(script, {name}=...)"
        hints = suggest_names(name, known) or (cure,)
        if place.operand and not suggest_similar(name, known):
            hints += (f"a text stands in quotes: '{name}'",)
    return ResolveError("R001", f"unknown name '{name}'", span, hints)


def read_leading_name(span: Span, name: str) -> Span:
    """The span of `name`, if `span` begins with it."""
    return Span(span.source, span.start, span.start + len(name)) if span.text.startswith(name) else span


def suggest_row_query(tree: ast.Call, scope: Scope | None) -> str:
    """The query that calls a function of one argument for all rows, if short."""
    value, sources = tree.arguments[0].span.text, scope.sources if scope else []
    if len(sources) != 1 or sources[0].name != sources[0].span.text or len(value) > 40:
        return f"{tree.function}(SELECT ... AS list)"
    return f"{tree.function}(SELECT {value} FROM {sources[0].name} AS list)"
