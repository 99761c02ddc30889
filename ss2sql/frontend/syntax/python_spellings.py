"""Spellings of Python and its like, which SelectScript writes differently: each error shows the right form."""

from __future__ import annotations

from collections.abc import Callable

from ss2sql.errors import ParseError
from ss2sql.frontend.syntax.parse_failure import VALUES, ParseFailure
from ss2sql.frontend.syntax.parse_table import END
from ss2sql.frontend.syntax.tokenizer import OPENING

_FUNCTION = "functions are written in Python, and session.function(f) registers them"
_ASSIGN = "an assignment has no word in front: {found} = ..."

# Words at the beginning of a statement, and what to write; {found} is the text after the word.
_FIRST = {
    "FOR": "a loop is a query: SELECT ... FROM {found} = list",
    "WHILE": "a loop that goes on is a search: START WITH n = 0 CONNECT BY n = n + 1 STOP WITH n == 9",
    "DEF": _FUNCTION, "FUNCTION": _FUNCTION, "CLASS": _FUNCTION, "IMPORT": _FUNCTION,
    "RETURN": "the value of a script is that of its last statement: write {found} alone",
    "LET": _ASSIGN, "VAR": _ASSIGN, "CONST": _ASSIGN, "SET": _ASSIGN, "DECLARE": _ASSIGN,
    "DEL": "variables stay; clear() forgets all of them",
}  # fmt: skip


def explain_python(t: ParseFailure) -> ParseError | None:
    """The error for a known spelling of a programming language; None for anything else."""
    checks: tuple[Callable[[ParseFailure], ParseError | None], ...] = (
        _explain_python_for, _explain_from_first, _explain_lambda, _explain_comprehension, _explain_slice,
        _explain_item_assignment, _explain_string_prefix, _explain_range, _explain_inner_quote,
    )  # fmt: skip
    return next((error for check in checks if (error := check(t))), None)


def _explain_python_for(t: ParseFailure) -> ParseError | None:
    """`for x in nums: ...`, `let x = 5`, `import math`."""
    word = t.peek()
    upper = word.text.upper()
    if word.kind != "NAME" or t.peek(2).kind != ";" or t.bracket or upper not in _FIRST:
        return None
    if t.found.kind not in VALUES and t.found.kind not in OPENING and t.found.kind != "-":
        return None
    hint = _FIRST[upper].format(found=t.cut_text(t.found.start, t.found.end))
    return t.explain("P006", f"there is no {word.text} in SelectScript", hint, at=word)


def _explain_lambda(t: ParseFailure) -> ParseError | None:
    word = t.peek()
    if word.text == "lambda" and t.values[-1:] == [word]:
        return t.explain("P006", "there is no lambda in SelectScript", _FUNCTION, at=word)
    return None


def _explain_comprehension(t: ParseFailure) -> ParseError | None:
    """`[x for x in nums]`."""
    if t.found.text != "for" or t.wants_operand or t.bracket is None:
        return None
    column = t.cut_text(t.bracket.end, t.peek().end)
    name = t.next.text if t.next.kind == "NAME" else "x"
    return t.explain("P006", "there is no for in SelectScript", f"write (SELECT {column} FROM {name} = ... AS list)")


def _explain_slice(t: ParseFailure) -> ParseError | None:
    """`x[a:b:c]`."""
    if t.found.kind == ":" and t.clause == "x[" and "]" in t.expected:
        return t.explain("P006", "a slice has no step", "a slice has two bounds: x[a:b]")
    return None


def _explain_item_assignment(t: ParseFailure) -> ParseError | None:
    """`x[0] = 5`."""
    if t.found.kind != "=" or t.peek().kind != "]" or t.clause or "+" not in t.expected:
        return None
    left = t.read_operand()
    name, bracket, _ = left.partition("[")
    if not bracket or not name.isidentifier():
        return None
    hint = f"assign a new list to {name}, or write {left} == ... to compare"
    return t.explain("P006", f"an element is not assigned, and {left} is one", hint)


def _explain_string_prefix(t: ParseFailure) -> ParseError | None:
    """`f"{x}"`, `r"text"`."""
    word = t.peek()
    if t.found.kind != "STRING" or word.kind != "NAME" or word.end != t.found.start or len(word.text) > 2:
        return None
    cure = (
        "join the parts with +, and numbers with str(...)" if "f" in word.text.lower() else "write \\\\ for a backslash"
    )
    return t.explain("P006", f"no {word.text} stands in front of a string", cure, at=word)


def _explain_range(t: ParseFailure) -> ParseError | None:
    """`1..10` reads as two numbers, 1. and .10."""
    first, second = t.peek(), t.found
    if first.kind != "FLOAT" or second.kind != "FLOAT" or first.end != second.start:
        return None
    return t.explain(
        "P006", "there is no operator ..", f"write range({first.text.rstrip('.')}, {second.text.lstrip('.')})"
    )


def _explain_inner_quote(t: ParseFailure) -> ParseError | None:
    """`'it's'`: the string ends at its second quote."""
    string = t.peek()
    if string.kind != "STRING" or t.found.kind != "NAME" or string.end != t.found.start:
        return None
    quote, other = string.text[0], '"' if string.text[0] == "'" else "'"
    return t.explain("P001", f"the string {t.cut_text(string.start, string.end)} ends at its second {quote}",
                   f"a quote inside a string is written \\{quote}, or the string stands in {other}")  # fmt: skip


def _explain_from_first(t: ParseFailure) -> ParseError | None:
    """`FROM people SELECT name`, as some languages have it."""
    if t.found.kind != "FROM" or t.peek().kind != ";" or t.bracket or t.next.kind == END:
        return None
    return t.explain("P001", "a query starts with SELECT, not with FROM", "write SELECT ... FROM ...")
