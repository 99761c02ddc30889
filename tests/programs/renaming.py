"""Programs under other names: what a program means does not depend on what its names are.

Functions, variables, START WITH variables, sources, columns, tables get new names, the same wherever the old one
stands: words of SQL, of the language and of Python, names that differ in case alone, other alphabets. What comes of
the renamed program is compared after `back` has given every name in it, as in the keys of a row, its old form.
"""

from __future__ import annotations

import keyword
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from random import Random
from typing import Any

from ss2sql.frontend.text import CONTEXTUAL, cut

from .case import ProgramCase
from .library import LIBRARY

# Names of columns and tables in a database, which differ in more than case there, and of functions.
PLAIN = [
    "table", "index", "join", "union", "values", "null", "case", "when", "rowid", "_rowid_", "oid", "key", "json",
    "ς", "naïve", "x1", "_", "__", "größe", "column", "distinct", "between", "like", "exists", "recursive", "main",
    "temp", "class_", "lambda_", "quëry", "日本", "n0", "e1", "pool", "run", "host", "rows_", "state",
    "hidden", "parent", "queue",
]  # fmt: skip
# Names for everything else as well: contextual keywords, built-in functions and representations, Python's own words.
WORDS = [
    *sorted(word.lower() for word in CONTEXTUAL), *sorted(word.title() for word in CONTEXTUAL),
    *(word for word in keyword.kwlist if word.upper() not in {"AND", "AS", "FROM", "IF", "IN", "NOT", "OR", "TRUE",
                                                              "FALSE", "NONE"}),
    "zip", "average", "norm", "clear", "void", "Rows", "Dict", "List", "SET", "plane", "self", "level", "elements",
]  # fmt: skip
CASES = ["qq", "QQ", "Qq", "qQ", "straße", "STRASSE", "Straße", "ärger", "ÄRGER", "Ärger", "ı", "İ", "Table", "TABLE"]
FIXED = frozenset({"add"})  # the operator that a program replaces


@dataclass(frozen=True)
class RenamedCase:
    """A program with everything that it needs, as ProgramCase has it, and the way back to the old names."""

    script: str
    variables: dict[str, Any]
    tables: dict[str, list[dict[str, Any]]]
    uses: dict[str, str] = field(default_factory=dict)  # functions of the library: new names to old ones
    names: dict[str, str] = field(default_factory=dict)  # old names to new ones

    @property
    def functions(self) -> dict[str, Callable[..., Any]]:
        return {new: LIBRARY[old][0]() for new, old in self.uses.items()}

    @property
    def volatility(self) -> dict[str, str]:
        return {new: declared for new, old in self.uses.items() if (declared := LIBRARY[old][1]) is not None}

    def back(self, text: str) -> str:
        """A text with the old names in place of the new ones; `name_2` is the second column of its name."""
        old = {new: old for old, new in self.names.items()}
        words = "|".join(sorted(map(re.escape, old), key=len, reverse=True))
        return re.sub(rf"(?<!\w)({words})(?=_\d+(?!\w)|(?!\w))", lambda found: old[found[0]], text) if words else text


def renamed(case: ProgramCase, dice: Random) -> RenamedCase:
    """The program under names that the dice choose."""
    names = _new_names(case, dice)
    return RenamedCase(
        script_with(case.script, names),
        {names.get(name, name): value_with(value, names) for name, value in case.variables.items()},
        {names.get(name, name): value_with(rows, names) for name, rows in case.tables.items()},
        {names.get(name, name): name for name in case.uses},
        names,
    )


def _new_names(case: ProgramCase, dice: Random) -> dict[str, str]:
    """A new name for each that the program may choose."""
    stored = {*case.tables, *(name for rows in case.tables.values() for name in rows[0])}
    plain = sorted(_names(case) & (stored | set(case.uses)))
    others = sorted(_names(case) - stored - set(case.uses))
    pool = dice.sample(PLAIN, len(PLAIN))
    names = {name: pool.pop() for name in plain}
    taken = {new.lower() for new in names.values()}
    rest = list(dict.fromkeys([*CASES, *WORDS, *pool]))
    rest = [name for name in dice.sample(rest, len(rest)) if name.lower() not in taken]
    if dice.random() < 0.5:  # half of the programs get names that differ in case alone
        rest = rest + dice.sample(CASES, len(CASES))
        rest = list(dict.fromkeys(reversed(rest)))[::-1]
    return names | {name: rest.pop() for name in others}


def _names(case: ProgramCase) -> set[str]:
    """What the program itself has named."""
    columns = {key for value in (*case.variables.values(), *case.tables.values()) for key in keys_of(value)}
    own = {*case.variables, *case.tables, *case.uses, *columns} | _introduced(case.script)
    kept = set(FIXED)
    if "eval(this[" in case.script:  # names that are made of data
        kept |= {"a", "b", "c"}
    if "near(x =" in case.script:  # the parameter of a Python function
        kept.add("x")
    return own - kept


def _introduced(script: str) -> set[str]:
    """The names before a single `=` or a brace: variables, temporal ones, START WITH variables, sources."""
    tokens = list(cut(script))
    return {one.text for one, other in pairwise(tokens) if one.kind == "NAME" and other.kind in ("=", "{")}


def keys_of(value: Any) -> set[str]:
    """The keys of all dicts within a value."""
    match value:
        case dict():
            return set(value) | {key for item in value.values() for key in keys_of(item)}
        case list():
            return {key for item in value for key in keys_of(item)}
        case _:
            return set()


def value_with(value: Any, names: dict[str, str]) -> Any:
    """A value whose dicts have the new keys."""
    match value:
        case dict():
            return {names.get(key, key): value_with(item, names) for key, item in value.items()}
        case list():
            return [value_with(item, names) for item in value]
        case _:
            return value


def script_with(script: str, names: dict[str, str]) -> str:
    """A script with the new names, in texts for `eval` and in keys `x['k']` as well."""
    tokens = list(cut(script))
    written, at = "", 0
    for number, token in enumerate(tokens):
        written += script[at : token.start]
        text = token.text
        if token.kind == "NAME" and not _is_builtin(tokens, number, names):
            text = names.get(text, text)
        elif token.kind == "STRING" and [other.text for other in tokens[max(number - 2, 0) : number]] == ["eval", "("]:
            text = text[0] + script_with(text[1:-1], names) + text[-1]
        elif (
            token.kind == "STRING" and number > 1 and tokens[number - 1].text == "[" and _is_operand(tokens[number - 2])
        ):
            text = text[0] + names.get(text[1:-1], text[1:-1]) + text[-1]
        written += text
        at = token.end
    return written + script[at:]


def _is_builtin(tokens: list[Any], number: int, names: dict[str, str]) -> bool:
    """Whether a name is that of a representation, behind AS."""
    return number > 0 and tokens[number - 1].kind == "AS"


def _is_operand(token: Any) -> bool:
    return token.kind in ("NAME", "THIS", "]", ")", "STRING")
