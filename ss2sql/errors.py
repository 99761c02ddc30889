"""Errors are data: a code, a sentence, a place and hints; one renderer turns them into text.

Every error that ss2sql raises itself is an `Error`. A Python function of the user that raises keeps its
own exception type; it only gets a note that names the line of the script (see `note_place`).
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from functools import cached_property
from typing import Any


@dataclass(frozen=True)
class Source:
    """A script's text with the name that errors show for it (a file name, or `<script>`)."""

    text: str
    name: str = "<script>"

    @cached_property
    def _line_starts(self) -> list[int]:
        starts = [0]
        starts.extend(i + 1 for i, char in enumerate(self.text) if char == "\n")
        return starts

    def line_column(self, offset: int) -> tuple[int, int]:
        """The line and column, both counted from 1, of a character offset."""
        line = bisect_right(self._line_starts, offset)
        return line, offset - self._line_starts[line - 1] + 1

    def line(self, number: int) -> str:
        """The text of a line, counted from 1, without its end."""
        start = self._line_starts[number - 1]
        end = self._line_starts[number] - 1 if number < len(self._line_starts) else len(self.text)
        return self.text[start:end].rstrip("\r")

    def offset(self, line: int, column: int) -> int:
        """The character offset of a line and column, both counted from 1."""
        return self._line_starts[line - 1] + column - 1


@dataclass(frozen=True)
class Span:
    """A stretch of a script: character offsets `start` (included) to `end` (not included)."""

    source: Source
    start: int
    end: int

    @property
    def line(self) -> int:
        return self.source.line_column(self.start)[0]

    @property
    def column(self) -> int:
        return self.source.line_column(self.start)[1]

    @property
    def text(self) -> str:
        return self.source.text[self.start : self.end]

    @property
    def place(self) -> str:
        """`name:line:column`, as errors print it."""
        return f"{self.source.name}:{self.line}:{self.column}"

    def to(self, other: Span) -> Span:
        """The stretch from the start of this span to the end of the other."""
        return Span(self.source, self.start, max(self.end, other.end))


@dataclass(frozen=True, slots=True)
class Code:
    """One kind of error: what `ss2sql list errors` and the error index say of it."""

    code: str
    title: str
    explanation: str


def _table(*rows: tuple[str, str, str]) -> dict[str, Code]:
    return {code: Code(code, title, explanation) for code, title, explanation in rows}


CODES: dict[str, Code] = _table(
    ("P001", "unexpected text", "The text does not fit the grammar at this place."),
    ("P002", "unexpected end", "The script ends before a statement is complete, most often a missing parenthesis."),
    (
        "P003",
        "unreadable text",
        "A character, string or comment that the language does not have or that is not closed.",
    ),
    ("P004", "script too large", "A script may have at most 256 KiB."),
    ("P005", "nested too deeply", "Parentheses, queries or operators nested deeper than 200 are refused."),
    ("P006", "a spelling of SQL", "SQL writes this differently from SelectScript; the error shows the right form."),
    ("P007", "number out of range", "Integers have 64 bits, floats are finite."),
    ("P008", "empty script", "There is no statement to run."),
    ("P009", "unclosed inner query", "A query inside another stands in parentheses or ends with AS."),
    ("R001", "unknown name", "No variable, column or START WITH variable of this name is in sight."),
    ("R002", "unknown function", "No function of this name is built in or registered."),
    ("R003", "unknown source", "FROM names something that is neither a variable, a table nor a world."),
    ("R004", "ambiguous name", "Two sources have a column of this name: write `source.column`."),
    ("R005", "wrong number of arguments", "The function takes another number of arguments."),
    ("R006", "unknown representation", "AS names a representation that nobody registered."),
    ("R007", "assignment to a search variable", "A START WITH variable is changed in CONNECT BY only."),
    ("R008", "aggregate in the wrong place", "Aggregates work on lists, or on groups inside GROUP BY."),
    ("R009", "missing parameter", "The compiled script has names that must be given a value when it runs."),
    ("R010", "contradictory options", "These options of CONNECT BY do not go together."),
    (
        "R011",
        "late list outside its query",
        "A list that mentions `a.this` can only be read by a query with the source a.",
    ),
    ("R012", "incomplete search", "START WITH and STOP WITH need CONNECT BY."),
    ("R013", "repeated name", "Two sources, clauses or variables of one query have the same name."),
    ("R014", "misplaced construct", "The construct exists, but not in this place."),
    (
        "U001",
        "not possible in the database",
        "The engine `database` was demanded for something that only runs natively.",
    ),
    ("X001", "operands do not fit", "The operator does not work on values of these types."),
    ("X002", "division by zero", "The right operand of / or % is zero."),
    ("X003", "index out of range", "The list is shorter than the index, or the dict lacks the key."),
    ("X004", "value not allowed", "NaN, infinities, complex numbers and integers beyond 64 bits are refused."),
    ("X005", "not a source", "FROM needs a list, a dict of columns, a table, a world or a query."),
    (
        "X006",
        "wrong option value",
        "MAXIMUM, MEMORIZE, LIMIT, COST, HEURISTIC or PROBABILITY got a value out of range.",
    ),
    ("X007", "wrong argument", "A built-in function got an argument that it cannot use."),
    ("X008", "missing column", "A row lacks a column that the query reads."),
    ("X009", "database error", "SQLite refused or broke off a statement."),
    ("X010", "row limit", "The query has more rows than max_rows allows."),
    ("X011", "world cannot be read", "A simulator refused, an element is gone, or a table breaks its declarations."),
    ("X012", "wrong block", "A function that takes arrays has to return one element for each row."),
    ("X013", "worker died", "A process that was to call functions, as `workers` asks for, ended by itself."),
    ("V001", "representation failed", "The rows do not fit the representation, or its arguments are wrong."),
    ("T001", "timeout", "The run took longer than its timeout."),
    ("T002", "cancelled", "The run was interrupted."),
    ("S001", "session is closed", "A closed session cannot run scripts."),
    ("S002", "wrong registration", "A function, variable, table or representation cannot be registered like this."),
    ("S003", "missing package", "It needs a package that is not installed; the error shows how to install it."),
)


class Error(Exception):
    """The base of all errors of ss2sql.

    `code` is a key of `CODES`, `message` one sentence, `span` the place in the script (None where there is
    none), `hints` a tuple of sentences that say what to do, `related` places that have to do with it.
    `errors` holds every error found at once, this one first. `str(error)` is the rendered message.
    """

    def __init__(
        self,
        code: str,
        message: str,
        span: Span | None = None,
        hints: Iterable[str] = (),
        related: Iterable[tuple[Span, str]] = (),
    ) -> None:
        super().__init__(code, message)
        assert code in CODES, code
        self.code = code
        self.message = message
        self.span = span
        self.hints = tuple(hints)
        self.related = tuple(related)
        self.errors: tuple[Error, ...] = (self,)

    def __str__(self) -> str:
        return "\n\n".join(render(error) for error in self.errors)

    def located(self, span: Span | None) -> Error:
        """This error, at `span` if it had no place yet."""
        if self.span is None:
            self.span = span
        return self

    def with_hint(self, *hints: str) -> Error:
        self.hints += hints
        return self


class ParseError(Error):
    """The text is not SelectScript."""


class ResolveError(Error):
    """A name, function, source or option does not exist or does not fit."""


class UnsupportedError(Error):
    """The database was demanded for something that it cannot do."""


class ExecutionError(Error):
    """A script failed while it ran."""


class RepresentationError(Error):
    """Rows could not be given the form that AS asks for."""


class Stopped(Error):  # noqa: N818 - not an error of the script
    """A run ended early; `partial` holds the result so far (a `Result`, or None)."""

    partial: Any = None


class Timeout(Stopped):
    """The run took longer than its timeout; `partial` holds what was found."""


class Cancelled(Stopped):
    """The run was interrupted; `partial` holds what was found."""


class SessionError(Error):
    """A session was used wrongly from Python: closed, or given something that it cannot register."""


class WorkersWarning(UserWarning):
    """`workers` has no effect on a run, or on the calls of one function; the text says why and what to do."""


def several(errors: Sequence[Error]) -> Error:
    """One exception that stands for all `errors` (at least one), in the order of their places."""
    ordered = sorted(errors, key=lambda e: e.span.start if e.span else -1)
    first = ordered[0]
    first.errors = tuple(ordered)
    return first


def did_you_mean(name: str, known: Iterable[str]) -> tuple[str, ...]:
    """Hints with the closest known names, or all names where there are few."""
    names = sorted(set(known))
    lowered = {n.lower(): n for n in reversed(names)}
    close = get_close_matches(name.lower(), list(lowered), n=3, cutoff=0.6)
    # get_close_matches misses a name that merely lost its tail (mov for moves): offer prefixes as well.
    close += [n for n in lowered if n not in close and len(name) > 1 and n.startswith(name.lower())]
    if close:
        return ("did you mean " + " or ".join(f"'{lowered[n]}'" for n in close[:3]) + "?",)
    if 0 < len(names) <= 8:
        return ("known here: " + ", ".join(names),)
    return ()


def note_place(exception: BaseException, function: str, spans: Sequence[Span]) -> None:
    """Adds to a user's exception the note that names the function and its place in the script, once."""
    if getattr(exception, "_ss2sql_noted", False):
        return
    places = ", ".join(dict.fromkeys(span.place for span in spans)) or "<script>"
    lines = [f"raised by the function '{function}', called at {places}"]
    for number in dict.fromkeys(span.line for span in spans):
        lines.append(f"  {number} | {spans[0].source.line(number)}")
    exception.add_note("\n".join(lines))
    try:
        exception._ss2sql_noted = True  # type: ignore[attr-defined]
    except AttributeError:
        return  # exceptions with __slots__ cannot be marked; a second note does no harm


@dataclass(slots=True)
class _Block:
    """Lines of a rendered error under construction: the gutter is as wide as the largest line number."""

    width: int
    lines: list[str] = field(default_factory=list)

    def show(self, span: Span, label: str = "") -> None:
        text = span.source.line(span.line).replace("\t", " ")
        start = span.column - 1
        # A very long line is cut around the place, so that the caret stays on the screen.
        cut = max(0, start - 60)
        shown = ("..." if cut else "") + text[cut : cut + 120] + ("..." if len(text) > cut + 120 else "")
        offset = start - cut + (3 if cut else 0)
        length = max(1, min(span.end - span.start, len(text) - start, 120 - (start - cut)))
        gutter = " " * self.width
        self.lines.append(f"{gutter} |")
        self.lines.append(f"{span.line:>{self.width}} | {shown}")
        self.lines.append(f"{gutter} | {' ' * offset}{'^' * length}{' ' + label if label else ''}")


def render(error: Error) -> str:
    """The text of one error: code and sentence, place, source line with carets, hints."""
    head = f"error[{error.code}]: {error.message}"
    spans = [span for span in (error.span, *(span for span, _ in error.related)) if span is not None]
    if not spans:
        return "\n".join([head, *(f"  = help: {hint}" for hint in error.hints)])
    block = _Block(max(len(str(span.line)) for span in spans))
    gutter = " " * block.width
    block.lines.append(head)
    if error.span is not None:
        block.lines.append(f"{gutter}--> {error.span.place}")
        block.show(error.span)
    for span, label in error.related:
        if error.span is not None and span.source is error.span.source:
            block.show(span, label)
        else:
            block.lines.append(f"{gutter}--> {span.place}: {label}")
            block.show(span)
    block.lines.extend(f"{gutter} = help: {hint}" for hint in error.hints)
    return "\n".join(block.lines)
