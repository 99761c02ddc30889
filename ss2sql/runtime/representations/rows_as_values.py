"""The rows as values of Python: `AS dict`, `list`, `rows`, `set`, `value`, `void` and `prolog`.

`SELECT mass, isSphere FROM space AS prolog` gives `mass(sphere_1, 3.2).` and `isSphere(sphere_1).` True stands without
a value; False and None are no facts. What is false in Prolog is what is not told.
"""

from __future__ import annotations

import re
from collections import Counter
from itertools import chain
from math import isfinite
from typing import Any

from ss2sql.errors import RepresentationError
from ss2sql.language.plan import FactColumn
from ss2sql.language.rows import Table, refuse_argument, request_hidden_columns
from ss2sql.language.values import format_value
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
