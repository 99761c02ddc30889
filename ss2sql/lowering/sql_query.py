"""A lowered query: its text, the values to bind and their other forms, functions, how steps are read; names in SQL.

A list becomes one BLOB, a byte for every element, so that SQLite finds an element by its place: a Python call for each
index takes 0.3 us, `substr` of a BLOB 0.05 us whatever its length. A value of an unknown kind that numbers are
compared with becomes the number that it equals.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import apsw

from ss2sql.errors import Span
from ss2sql.errors.exceptions import CONTROL_CHARACTERS
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.values import make_hashable

if TYPE_CHECKING:
    from ss2sql.vtables.reading import LateColumns, Snapshot


class BlobValue(bytes):
    """A BLOB that is handed to SQLite as it is; no value of the language."""


@dataclass(frozen=True, slots=True)
class ListEncoding:
    """The integers or bools of a list, or of a list of lists, row after row: each as a byte, `least` as 0."""

    nested: bool
    least: int

    def pack_value(self, value: Any) -> BlobValue:
        elements: Iterable[int] = chain.from_iterable(value) if self.nested else value
        least = self.least
        # bytes() alone takes 2 ms for 100,000 elements, the subtraction 5 ms more.
        return BlobValue(elements) if least == 0 else BlobValue(element - least for element in elements)


@dataclass(frozen=True, slots=True)
class PointSetEncoding:
    """Which points of a box are elements of a list: the byte 1 for those that are, 0 for the others.

    `box` has the least and the greatest integer in each position; the last position varies fastest.
    """

    box: tuple[tuple[int, int], ...]

    @property
    def size(self) -> int:
        size = 1
        for low, high in self.box:
            size *= high - low + 1
        return size

    def pack_value(self, value: Any) -> BlobValue:
        cells = bytearray(self.size)
        for point in value:
            place = 0
            for (low, high), coordinate in zip(self.box, point, strict=True):
                place = place * (high - low + 1) + int(coordinate) - low
            cells[place] = 1
        return BlobValue(cells)


@dataclass(frozen=True, slots=True)
class EqualValueEncoding:
    """The number, or the string, that a value equals; None where it equals none."""

    text: bool

    def pack_value(self, value: Any) -> Any:
        if self.text:
            return value if type(value) is str else None
        found = value if isinstance(value, (str, list, dict)) else make_hashable(value)
        if type(found) is bool:
            return int(found)
        return found if type(found) in (int, float) else None


BlobEncoding: TypeAlias = ListEncoding | PointSetEncoding | EqualValueEncoding


# --- a lowered query: its text, the values to bind, the functions to have, and how the steps of a search are kept
StepCounting: TypeAlias = Literal["steps", "product", "entered"]


@dataclass(frozen=True, slots=True)
class ElementCall:
    """A call of the user's `function` with each element of a list, whose value stands in the column `name`.

    `arguments` are columns of the list by name, `this` among them, and further arguments of the table by number.
    """

    name: str
    function: str
    arguments: tuple[str | int, ...]


@dataclass(frozen=True, slots=True)
class ListTable:
    """A virtual table that walks a list: the columns of its elements, after `this`, and then those of calls.

    With a `function` of the user it walks what this gives, and its arguments are `arity` of the function.
    """

    columns: tuple[str, ...]
    calls: tuple[ElementCall, ...] = ()
    function: str | None = None
    arity: int = 1

    @property
    def arguments(self) -> int:
        """The number of arguments."""
        numbers = [part for call in self.calls for part in call.arguments if isinstance(part, int)]
        return self.arity + max(numbers, default=0)


@dataclass(frozen=True, slots=True)
class Bookkeeping:
    """How the steps of a search are kept and counted."""

    counts: StepCounting = "steps"  # how the number of generated steps is known
    all_go_on: bool = False  # every step that enters goes on
    all_results: bool = False  # every step that enters is a result
    sources: tuple[str, ...] = ()  # the parameters that are walked as sources, where each state has all their elements
    arms: int = 1  # the number of SELECTs that make the steps from a state
    parts: tuple[int, ...] = ()  # for each column of a row the number of values that form its list; 0: it is one value
    keyed: bool = False  # something else than rows is compared
    steps_unkept: bool = False  # steps have numbers, but are not kept
    uncounted_starts: int = 0  # how many starts no call of the statement counts


@dataclass(frozen=True, slots=True)
class Parameter:
    """A value that is bound as `:name`: the expression is evaluated once, before the statement runs.

    With `flag` set the value is a bool that travels as 0 or 1, with `blob_encoding` it is packed into a blob.
    """

    name: str
    expr: plan.Expr
    flag: bool = False
    blob_encoding: BlobEncoding | None = None

    def encode_value(self, value: Any) -> Any:
        return value if self.blob_encoding is None else self.blob_encoding.pack_value(value)


@dataclass(frozen=True, slots=True)
class SqlQuery:
    """A lowered query. Its columns: of a search the step's and its parent's number; then outputs, keys, orders.

    Of each of these it says whether a bool travels as 0 or 1 in it.
    """

    query: plan.Query
    text: str
    parameters: tuple[Parameter, ...]
    outputs: tuple[bool, ...]
    keys: tuple[bool, ...]  # the values of groups
    orders: tuple[bool, ...]  # the keys of ORDER BY where SQL does not sort
    sorted: bool  # SQL has done ORDER BY
    limited: bool  # SQL has done LIMIT
    calls: Mapping[str, tuple[Span, ...]]
    modules: Mapping[str, ListTable]
    plain: frozenset[str] = frozenset()  # parameters whose handles stand for all values that equal theirs
    plain_rows: bool = False  # the rows consist of numbers, strings and None
    plain_keys: bool = False  # what a search compares does
    bookkeeping: Bookkeeping = Bookkeeping()
    snapshot: Snapshot | None = None  # of the worlds that it reads, if any
    late: LateColumns | None = None  # makes the rows where the statement gives only keys of worlds
    applied: tuple[str, ...] = ()  # the rewrites that lowering has applied
    only_iterated: frozenset[str] = frozenset()  # parameters whose value nobody reads as a whole
    truths: frozenset[str] = frozenset()  # functions whose calls are conditions, see lower.py


# --- SQL text with what it needs beside it
class Sql(str):
    """SQL text with what it needs beside it.

    `parameters` are the values bound to its `:names`, `statements` the texts of the script's statements one
    by one, `modules` the virtual tables that it reads, with the columns of their elements.
    """

    parameters: Mapping[str, Any]
    statements: tuple[Sql, ...]
    modules: Mapping[str, ListTable]

    def __new__(
        cls,
        text: str,
        parameters: Mapping[str, Any] | None = None,
        statements: tuple[Sql, ...] = (),
        modules: Mapping[str, ListTable] | None = None,
    ) -> Sql:
        self = super().__new__(cls, text)
        self.parameters = dict(parameters or {})
        self.statements = statements or (self,)
        self.modules = dict(modules or {})
        return self


def join_sql(texts: Sequence[Sql]) -> Sql:
    """The texts of several statements as one, each with its own parameters in `statements`."""
    if len(texts) == 1:
        return texts[0]
    parameters = {name: value for text in texts for name, value in text.parameters.items()}
    modules = {name: columns for text in texts for name, columns in text.modules.items()}
    joined = "\n\n".join(text if text.startswith("--") else f"{text};" for text in texts)
    return Sql(joined, parameters, tuple(texts), modules)


# --- names in SQL: those of columns, tables and functions, and the functions that SQLite has by itself
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
