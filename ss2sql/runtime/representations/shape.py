"""From rows to the value that AS asks for, and the representations that a session starts with.

`AS dict`, `list`, `rows`, `set`, `value`, `void` and `prolog` give the rows as values of Python. `SELECT mass, isSphere
FROM space AS prolog` gives `mass(sphere_1, 3.2).` and `isSphere(sphere_1).` True stands without a value; False and None
are no facts. What is false in Prolog is what is not told.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from inspect import signature
from itertools import chain
from math import isfinite
from typing import Any

from ss2sql.errors import Error, RepresentationError, note_place_on_exception
from ss2sql.language import plan
from ss2sql.language.cancellation import ITEMS_PER_CHECK, Check, iterate_with_check
from ss2sql.language.plan import FactColumn
from ss2sql.language.rows import (
    HIDDEN_COLUMNS_ATTRIBUTE,
    Path,
    Row,
    Rows,
    Table,
    iterate_checked_paths,
    refuse_argument,
    request_hidden_columns,
)
from ss2sql.language.values import Opaque, convert_value, copy_for_python, format_value
from ss2sql.runtime.representations.as_plane import as_plane
from ss2sql.runtime.run.run_state import pause_collector
from ss2sql.runtime.run.search_paths import SearchPaths, measure_path_lengths
from ss2sql.runtime.run.value_sizes import CELL_SIZE, MAX_SIZE, ValueSizes
from ss2sql.vtables.contract import Element


def as_dict(table: Table) -> list[dict[str, Any]]:
    """A list of dicts, one per row, by the names of the columns."""
    return table.dicts()


def as_list(table: Table) -> list[Any]:
    """The values of all columns in one flat list, row after row."""
    return list(chain.from_iterable(table))


def as_rows(table: Table) -> list[tuple[Any, ...]]:
    """A list of tuples."""
    return list(table)


def as_set(table: Table) -> set[Any]:
    """The different values of all columns, lists as tuples; the first of equal values stands for all of them.

    Raises RepresentationError V001 for a value without a hash.
    """
    return set(map(_represent_set_element, chain.from_iterable(table)))


def _represent_set_element(value: Any) -> Any:
    if isinstance(value, list):
        return tuple(map(_represent_set_element, value))
    try:
        hash(value)
    except TypeError:
        hint = "select its parts, or use AS list"
        raise RepresentationError(
            "V001", f"{format_value(value)} cannot be an element of a set", hints=(hint,)
        ) from None
    return value


def as_value(table: Table) -> Any:
    """The first column of the first row; None where there is no row."""
    return table.rows[0][0] if table.rows else None


def as_void(table: Table) -> None:
    """None: the query runs for its effects."""


# --- `AS prolog`: every selected call as a fact, in a text that Prolog loads
_PLAIN = re.compile(r"[a-z][a-zA-Z0-9_]*", re.ASCII)
_ESCAPES = {"\\": "\\\\", "'": "\\'", "\n": "\\n", "\t": "\\t", "\r": "\\r"}

# Predicates of the ISO standard, which Prolog lets nobody define anew unless it is told to.
_WORDS = """
    abolish/1 arg/3 assert/1 asserta/1 assertz/1 at_end_of_stream/1 atom/1 atom_chars/2 atom_codes/2 atom_concat/3
    atom_length/2 atomic/1 bagof/3 call/1 call/2 call/3 call/4 callable/1 catch/3 char_code/2 char_conversion/2 clause/2
    close/1 close/2 compare/3 compound/1 copy_term/2 current_input/1 current_op/3 current_output/1 current_predicate/1
    current_prolog_flag/2 discontiguous/1 dynamic/1 findall/3 float/1 flush_output/1 functor/3 get_byte/1 get_byte/2
    get_char/1 get_char/2 get_code/1 get_code/2 ground/1 halt/1 initialization/1 integer/1 is/2 keysort/2 length/2
    multifile/1 nl/1 nonvar/1 number/1 number_chars/2 number_codes/2 numbervars/3 once/1 op/3 open/3 open/4 peek_byte/1
    peek_byte/2 peek_char/1 peek_char/2 peek_code/1 peek_code/2 phrase/2 phrase/3 put_byte/1 put_byte/2 put_char/1
    put_char/2 put_code/1 put_code/2 read/1 read/2 read_term/2 read_term/3 retract/1 retractall/1 set_input/1
    set_output/1 set_prolog_flag/2 set_stream_position/2 setof/3 sort/2 stream_property/2 sub_atom/5 subsumes_term/2
    term_variables/2 throw/1 var/1 write/1 write/2 write_canonical/1 write_canonical/2 write_term/2 write_term/3
    writeq/1 writeq/2
"""
_STANDARD = frozenset(_WORDS.split())


@request_hidden_columns("calls")
def as_prolog(table: Table) -> str:
    """Every selected call as a fact, in a string that Prolog loads.

    Each fact stands once, those of one predicate together in the order of their first.
    """
    names = _name_prolog_atoms([*table.rows, *table.hidden])
    predicates: dict[tuple[str, int], dict[str, None]] = {}
    for index, row in enumerate(table.rows):
        hidden = table.hidden[index] if table.hidden else ()
        for column, value in enumerate(row):
            fact = table.facts[column] if table.facts else FactColumn("", ())
            if value is None or value is False:
                continue
            functor = fact.name or table.columns[column]
            arguments = [hidden[place] for place in fact.places]
            if value is not True and fact.has_value:
                arguments.append(value)
            terms = [write_term(argument, names) for argument in arguments]
            line = f"{write_atom(functor)}({', '.join(terms)})." if terms else f"{write_atom(functor)}."
            predicates.setdefault((functor, len(terms)), {})[line] = None
    return "".join(_write_facts(*key, facts) for key, facts in predicates.items())


def _write_facts(functor: str, count: int, facts: dict[str, None]) -> str:
    directive = ""
    if f"{functor}/{count}" in _STANDARD:
        directive = f":- redefine_system_predicate({functor}({', '.join('_' * count)})).\n"
    return directive + "".join(f"{fact}\n" for fact in facts)


def _name_prolog_atoms(rows: list[tuple[Any, ...]]) -> dict[Element, str]:
    """What elements are called: by their own names, with their keys where several have one name."""
    found: dict[Element, str] = {}
    for value in _find_world_elements([list(row) for row in rows]):
        if value not in found:
            name = getattr(value, "name", None)
            found[value] = name if isinstance(name, str) and name else _represent_as_atom(value.table.name, value)
    often = Counter(found.values())
    return {element: name if often[name] == 1 else _represent_as_atom(name, element) for element, name in found.items()}


def _represent_as_atom(name: str, element: Element) -> str:
    key = element.key
    parts = key if isinstance(key, tuple) else (key,)
    return "_".join([name, *map(str, parts)])


def _find_world_elements(value: Any) -> list[Element]:
    if isinstance(value, Element):
        return [value]
    parts = value if isinstance(value, list) else list(value.values()) if isinstance(value, dict) else []
    return [element for part in parts for element in _find_world_elements(part)]


def write_term(value: Any, names: dict[Element, str]) -> str:
    """A value as Prolog writes it: texts as atoms, dicts as lists of pairs, objects by how they are shown."""
    match value:
        case None:
            return "none"
        case bool():
            return "true" if value else "false"
        case int():
            return str(value)
        case float():
            return _write_float(value)
        case str():
            return write_atom(value)
        case list() | tuple():
            return f"[{', '.join(write_term(part, names) for part in value)}]"
        case dict():
            return f"[{', '.join(f'{write_atom(str(k))}-({write_term(part, names)})' for k, part in value.items())}]"
        case Element():
            return write_atom(names[value])
        case _:
            return write_atom(format_value(value))


def _write_float(value: float) -> str:
    """Prolog's floats have digits on both sides of a point: 1.0e-7."""
    if not isfinite(value):
        refuse_argument("prolog", f"cannot write {value}", "leave it out with WHERE")
    digits, exponent, power = repr(value).partition("e")
    return (digits if "." in digits else f"{digits}.0") + exponent + power


def write_atom(text: str) -> str:
    """A text as an atom, in quotes where it needs them."""
    if _PLAIN.fullmatch(text):
        return text
    return "'" + "".join(_escape_character(letter) for letter in text) + "'"


def _escape_character(letter: str) -> str:
    if letter in _ESCAPES:
        return _ESCAPES[letter]
    if letter == "\0":
        refuse_argument("prolog", "cannot write a text that holds the letter \\0", "leave it out with WHERE")
    return letter if letter.isprintable() else f"\\x{ord(letter):x}\\"


# What a session starts with.
REPRESENTATIONS: dict[str, Callable[..., Any]] = {
    "dict": as_dict,
    "list": as_list,
    "rows": as_rows,
    "value": as_value,
    "set": as_set,
    "void": as_void,
    "plane": as_plane,
    "prolog": as_prolog,
}


# --- from rows to the value that AS asks for
# What the language makes of rows so that scripts go on with it: lists where `AS rows` gives tuples.
SHARED_FORMS: dict[str, Callable[[Table], Any]] = {
    "dict": REPRESENTATIONS["dict"],
    "list": REPRESENTATIONS["list"],
    "rows": lambda table: list(map(list, table)),
    "value": REPRESENTATIONS["value"],
}
PATH_FORMS = frozenset(SHARED_FORMS)  # which cannot fail
BUILT_IN_FORMS = PATH_FORMS | {"set", "void"}  # of values of the language
PLAIN_TYPES = (bool, int, float, str, list, dict, type(None))


class Representations:
    """The representations of a session, those of the language and the user's, by their names in lower case.

    What they make of rows has at most `most` bytes.
    """

    def __init__(self, most: int = MAX_SIZE) -> None:
        self.most = most
        self.functions: dict[str, Callable[..., Any]] = dict(REPRESENTATIONS)

    def represent_rows(
        self,
        form: plan.Representation,
        rows: Rows,
        arguments: Sequence[Any],
        named: Mapping[str, Any],
        check: Check | None = None,
    ) -> Any:
        """The value that AS makes of rows, as the user gets it: nothing in it is shared.

        Of a search it is a list with one value per path; of a partition a dict from group value to that. `check` is
        called every few thousand rows and raises where the run has to end.
        """

        if form.name == "void":
            return None
        sizes, size = ValueSizes(self.most), 0

        def copy_values(some: Sequence[Any]) -> list[Any]:
            nonlocal size
            size = sizes.measure_rows([some], size)
            copies: list[Any] = copy_for_python(list(some))
            if check is not None:
                check()
            return copies

        def copy_portions(some: Iterable[Path]) -> Iterator[Path]:
            """Copies of rows, of paths, or of their cells, if there is room for them: until then they share values.

            Some thousand cells at once: of paths with a dozen lists each takes 2 us, one by one 8.
            """
            for portion in _split_into_portions(some):
                if len(portion) > 1:
                    yield from copy_values(portion)
                    continue
                (long,) = portion
                starts = range(0, len(long), ITEMS_PER_CHECK)
                parts = (copy_values(long[start : start + ITEMS_PER_CHECK]) for start in starts)
                yield type(long)(chain.from_iterable(parts))  # type: ignore[call-arg]

        def represent_paths(positions: Sequence[int] | None) -> Any:
            results: Sequence[Any] = rows.rows if rows.paths is None else rows.paths  # type: ignore[assignment]
            if positions is None:
                chosen = results
            elif isinstance(results, SearchPaths):
                chosen = results.choose_paths(positions)
            else:
                chosen = [results[index] for index in positions]
            if rows.paths is None:
                if form.name == "value" and self.is_built_in(form):
                    chosen = chosen[:1]
                own = list(chosen if rows.plain else copy_portions(chosen))
                return self._call_representation(form, rows.columns, own, arguments, named, check)
            if not (arguments or named or form.hidden) and self.is_built_in(form) and form.name in PATH_FORMS:
                if form.name == "list":
                    flat = (
                        chosen.iterate_cells()
                        if isinstance(chosen, SearchPaths)
                        else map(list, map(chain.from_iterable, chosen))
                    )
                    return list(iterate_checked_paths(flat if rows.plain else copy_portions(flat), check))
                represent, columns = REPRESENTATIONS[form.name], rows.columns
                paths = chosen if rows.plain else copy_portions(chosen)
                return [represent(Table(columns, path, check=check)) for path in iterate_checked_paths(paths, check)]
            paths = map(list, chosen if rows.plain else copy_portions(chosen))
            return [
                self._call_representation(form, rows.columns, path, arguments, named, check)
                for path in iterate_checked_paths(paths, check)
            ]

        with pause_collector() if form.name in BUILT_IN_FORMS and self.is_built_in(form) else nullcontext():
            if rows.groups is None:
                return represent_paths(None)
            return {_make_group_key(key, form): represent_paths(positions) for key, positions in rows.groups}

    def represent_subquery(
        self, query: plan.Query, rows: Rows, arguments: Sequence[Any], named: Mapping[str, Any], sizes: ValueSizes
    ) -> Any:
        """The value of a query inside of a script, as a value of the language."""
        rows = represent_starred_columns(query, rows, sizes.pause)
        if self.is_shared(query.representation, rows):
            return self.share_values(query.representation, rows, sizes)
        value = self.represent_rows(query.representation, rows, arguments, named, sizes.pause)
        return sizes.check_value(self.make_language_value(query.representation.name, value))

    def is_shared(self, form: plan.Representation, rows: Rows) -> bool:
        """Whether what the script goes on with is a list of the values that the rows hold, and no copy of them."""
        return self._shares_values(form) and rows.groups is None

    def _shares_values(self, form: plan.Representation) -> bool:
        extended = bool(form.arguments or form.named or form.hidden)
        return form.name in SHARED_FORMS and self.is_built_in(form) and not extended

    def find_row_shape(
        self, form: plan.Representation, columns: tuple[str, ...], sizes: ValueSizes, known: bool = False
    ) -> Callable[[list[Row]], Any] | None:
        """What makes such a value of rows with these columns; None where it takes more than the rows.

        Its size is checked, unless it is `known` to fit.
        """
        if not self._shares_values(form):
            return None
        make, pause = SHARED_FORMS[form.name], sizes.pause
        short = ITEMS_PER_CHECK if form.name == "list" else -1  # lists without a table: 0.4 us in place of 1.2

        def shape_rows(rows: list[Row]) -> Any:
            plain = len(rows) <= short
            return list(chain.from_iterable(rows)) if plain else make(Table(columns, rows, check=pause))

        return shape_rows if known else lambda rows: sizes.check_value(shape_rows(rows))

    def share_values(self, form: plan.Representation, rows: Rows, sizes: ValueSizes) -> Any:
        """Such a value.

        Nobody changes it in place, so a query of queries of queries of four rows each takes as long as its rows do:
        of ten of them in each other copies took 18 s and 1.4 GB.
        """
        make, columns, check = SHARED_FORMS[form.name], rows.columns, sizes.pause
        if rows.paths is None:
            shape_rows = self.find_row_shape(form, columns, sizes)
            assert shape_rows is not None
            return shape_rows(rows.rows or [])
        if form.name != "value":
            sizes.check_room(
                CELL_SIZE * len(columns) * sum(iterate_with_check(measure_path_lengths(rows.paths), check))
            )
        paths = iterate_checked_paths(map(list, rows.paths), check)
        return sizes.check_value([make(Table(columns, path, check=check)) for path in paths])

    def _call_representation(
        self,
        form: plan.Representation,
        columns: tuple[str, ...],
        own: list[Row],
        arguments: Sequence[Any],
        named: Mapping[str, Any],
        check: Check | None,
    ) -> Any:
        table = Table(columns, own, check=check)
        if form.hidden:
            shown = -form.hidden
            seen, told = [row[:shown] for row in own], [row[shown:] for row in own]
            table = Table(columns[:shown], seen, told, form.facts, form.labels, check)
        copies = {name: copy_for_python(value) for name, value in named.items()}
        try:
            return self.functions[form.name](table, *map(copy_for_python, arguments), **copies)
        except Error as error:
            raise error.with_span(form.span) from None
        except TypeError as error:
            if error.__traceback__ is not None and error.__traceback__.tb_next is not None:
                self._add_place(error, form)
                raise  # it was raised inside the function, not by the call of it
            message = f"AS {form.name} {self._explain_refusal(form.name, len(arguments), str(error))}"
            raise RepresentationError("V001", message, form.span, (self._describe_usage(form.name),)) from error
        except Exception as error:
            self._add_place(error, form)
            raise

    def _add_place(self, error: Exception, form: plan.Representation) -> None:
        """Says on an exception of the user where its representation is called."""
        note_place_on_exception(error, form.name, [form.span] if form.span else [], "representation")

    def _explain_refusal(self, name: str, number: int, reason: str) -> str:
        """What is wrong with the arguments: Python counts the table, which nobody wrote, among them."""
        _, *parameters = signature(self.functions[name]).parameters.values()
        most = sum(p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD) for p in parameters)
        if number > most and not any(p.kind is p.VAR_POSITIONAL for p in parameters):
            return f"takes {f'at most {most}' if most else 'no'} argument{'' if most == 1 else 's'}, not {number}"
        return f"cannot take these arguments: {reason.partition('() ')[2] or reason}"

    def _describe_usage(self, name: str) -> str:
        _, *parameters = signature(self.functions[name]).parameters.values()
        names = [p.name if p.default is p.empty else f"[{p.name}]" for p in parameters]
        return f"it is called as AS {name}({', '.join(names)})" if names else "leave them out"

    def list_hidden_columns(self) -> dict[str, str]:
        """What representations request beside the columns, by name; see `request_hidden_columns`."""
        found = {name: getattr(function, HIDDEN_COLUMNS_ATTRIBUTE, "") for name, function in self.functions.items()}
        return {name: wanted for name, wanted in found.items() if wanted}

    def is_built_in(self, form: plan.Representation) -> bool:
        """Whether the representation is one of the language, not replaced by the user."""
        return self.functions.get(form.name) is REPRESENTATIONS.get(form.name)

    def make_language_value(self, name: str, value: Any) -> Any:
        """A representation's value as scripts go on with it; what the user's own made stays the object that it is."""
        if name in BUILT_IN_FORMS or isinstance(value, PLAIN_TYPES):
            return convert_value(value, f"AS {name}")
        try:
            hash(value)
        except TypeError:
            return Opaque(value)
        return value


def represent_starred_columns(query: plan.Query, rows: Rows, check: Check | None = None) -> Rows:
    """The rows of a query, with those columns taken apart that SELECT * could not know beforehand."""
    stars = frozenset(index for index, output in enumerate(query.columns) if output.star)
    return rows.expand_stars(stars, check) if stars else rows


def _split_into_portions(some: Iterable[Path]) -> Iterator[list[Path]]:
    """Lists of rows or paths with some thousand cells or rows together; one that has as many alone stands alone."""
    portion: list[Path] = []
    room = ITEMS_PER_CHECK
    for one in some:
        room -= len(one) + 1
        if room < 0 and portion:
            yield portion
            portion, room = [], ITEMS_PER_CHECK - len(one) - 1
        portion.append(one)
    if portion:
        yield portion


def _make_group_key(value: Any, form: plan.Representation) -> Any:
    own = copy_for_python(value)
    try:
        hash(own)
    except Exception as error:
        hint = "group by its parts, or by its text"
        raise RepresentationError(
            "V001", f"{format_value(own)} cannot be the key of a group", form.span, (hint,)
        ) from error
    return own
