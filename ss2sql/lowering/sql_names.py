"""Names in SQL: those of columns, tables and functions, and the functions that SQLite has by itself."""

from __future__ import annotations

import re
from collections.abc import Iterable

import apsw

from ss2sql.errors.exceptions import CONTROL_CHARACTERS

ROW_NUMBER = "place in the walk"  # a hidden column of worlds; the blanks distinguish it from users' names
_UNWRITTEN = re.compile("[\0\ud800-\udfff]")
_SURROGATE = re.compile("[\ud800-\udfff]")
_PLAIN_COLUMN = re.compile(r"(?:(?!\d+\Z|with\Z|from\Z)[^_A-Z]+|this_\d+)\Z")
_PLAIN_CALL = re.compile(r"[^A-Z]+\Z")
_MARKED = re.compile(f"[A-Z^,;]|{CONTROL_CHARACTERS.pattern}")
SQLITE_FUNCTIONS = frozenset(
    str(name) for (name,) in apsw.Connection(":memory:").execute("SELECT lower(name) FROM pragma_function_list")
)


def quote_names(names: Iterable[str]) -> str:
    """Names of columns, quoted for a declaration."""
    return ", ".join('"' + name.replace('"', '""') + '"' for name in names)


def strip_sql_unwritable(name: str) -> str:
    """A name without what no text of SQL can hold: the character 0, and halves of surrogate pairs."""
    return _UNWRITTEN.sub("\N{REPLACEMENT CHARACTER}", name)


def strip_control_characters(name: str) -> str:
    """A name of our own choice, without characters that a terminal would obey."""
    return CONTROL_CHARACTERS.sub("\N{REPLACEMENT CHARACTER}", name)


def can_be_literal(value: str) -> bool:
    """Whether SQL can hold the text as a literal."""
    return not _SURROGATE.search(value)


def build_module_name(columns: tuple[str, ...], calls: tuple[str, ...] = (), function: str | None = None) -> str:
    """The name of the virtual table that walks lists with these columns, and calls, or what a function gives.

        >>> build_module_name(("x", "y")), build_module_name((), ("move",)), build_module_name((), (), "neighbours")
        ('elements_x_y', 'elements_with_move', 'elements_from_neighbours')

    Different tables have different names, also for SQLite, which sees no case; `a_b` is not `a, b`.
    """
    if function is not None:
        plain = _PLAIN_CALL.match(function) and not CONTROL_CHARACTERS.search(function)
        return f"elements_from_{function}" if plain else f"elements from {_MARKED.sub(_mark_sql_character, function)}"
    plain = all(_PLAIN_COLUMN.match(name) and not CONTROL_CHARACTERS.search(name) for name in columns)
    if plain and len(calls) <= 1 and all(map(_PLAIN_CALL.match, calls)):
        return "_".join(("elements", *columns, *(("with", *calls) if calls else ())))
    of_list, of_calls = (
        ", ".join(_MARKED.sub(_mark_sql_character, name) for name in names) for names in (columns, calls)
    )
    return "elements " + of_list + (f"; {of_calls}" if calls else "")


def choose_free_name(name: str, taken: set[str]) -> str:
    """The name, or with the first number that makes it one that is not `taken`; SQL does not see case. It is, then."""
    candidate, count = name, 1
    while candidate.lower() in taken:
        count += 1
        candidate = f"{name}_{count}"
    taken.add(candidate.lower())
    return candidate


def get_builtin_name(name: str) -> str:
    """The name of a built-in function in SQL; a name of SQLite's own stays SQLite's, for views and aggregates."""
    return f"{name}_of" if name in SQLITE_FUNCTIONS else name.replace(" ", "_")


def choose_sql_names(columns: tuple[str, ...]) -> dict[str, str]:
    """Names of columns as SQL can tell them apart, for SQL does not see upper and lower case."""
    # SQLite calls a column otherwise that is to be called true; one that is called rowid hides the real one.
    taken, names = {"this", "true", "false", "rowid"}, {}
    for name in columns:
        names[name] = choose_free_name(strip_control_characters(name), taken)
    return names


def _mark_sql_character(found: re.Match[str]) -> str:
    char = found.group()
    return f"^{char.lower()}" if " " <= char <= "~" else f"^{{{ord(char):x}}}"
