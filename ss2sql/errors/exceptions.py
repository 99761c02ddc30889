"""The classes of errors, the places in scripts that they name, and the text that shows them.

    error[P002]: expected ')' before the end of the script
     --> <script>:1:18
      |
    1 | max(SELECT a FROM
      |                  ^
      |    - opened here
      = help: write the missing ')'

The place of an error is marked with `^`, related places with `-`. The caller decides about colour.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import field
from functools import cached_property
from importlib import import_module
from typing import Any, ClassVar, Literal
from unicodedata import bidirectional, category, east_asian_width, normalize

from ss2sql.errors.codes import CODES
from ss2sql.extras import install_line
from ss2sql.fast_dataclasses import dataclass


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

    def find_line_column(self, offset: int) -> tuple[int, int]:
        """The line and column, both counted from 1, of a character offset."""
        line = bisect_right(self._line_starts, offset)
        return line, offset - self._line_starts[line - 1] + 1

    def get_line(self, number: int) -> str:
        """The text of a line, counted from 1, without its end."""
        start = self._line_starts[number - 1]
        end = self._line_starts[number] - 1 if number < len(self._line_starts) else len(self.text)
        return self.text[start:end].rstrip("\r")


@dataclass(frozen=True)
class Span:
    """A stretch of a script: character offsets `start` (included) to `end` (not included)."""

    source: Source
    start: int
    end: int

    @property
    def line(self) -> int:
        return self.source.find_line_column(self.start)[0]

    @property
    def column(self) -> int:
        return self.source.find_line_column(self.start)[1]

    @property
    def text(self) -> str:
        return self.source.text[self.start : self.end]

    @property
    def place(self) -> str:
        """`name:line:column`, as errors print it."""
        return f"{self.source.name}:{self.line}:{self.column}"

    def extend_to(self, other: Span) -> Span:
        """The stretch from the start of this span to the end of the other."""
        return Span(self.source, self.start, max(self.end, other.end))


NOWHERE = Span(Source(""), 0, 0)  # of what stands in no script


# --- the text of an error, in the manner of rustc: code and sentence, place, source lines with marks, hints
CONTROL_CHARACTERS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")


def escape_controls(text: str) -> str:
    """The text with `\\x1b` for an escape character, and so on. Ends of lines and tabs stay what they are."""
    return (
        text
        if text.isascii() and text.isprintable()
        else CONTROL_CHARACTERS.sub(lambda found: repr(found.group())[1:-1], text)
    )


WIDTH = 120  # cells of a line that are shown; a longer one is cut around its place
BEFORE = 60  # cells of it that stand before the place
TAB = "    "
DIRECTION_MARKS = frozenset({"LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI", "FSI", "PDI"})

RED, BLUE, CYAN, BOLD = "\x1b[1;31m", "\x1b[1;34m", "\x1b[1;36m", "\x1b[1m"


def render_all(error: Error, color: bool = False) -> str:
    """The text of all errors that were found together, with an empty line between them."""
    return "\n\n".join(render_error(one, color) for one in error.errors)


def render_error(error: Error, color: bool = False) -> str:
    """The text of one error; with ANSI colours where a terminal shows it."""
    marks = [_Mark(span, "-", BLUE, label) for span, label in error.related]
    spans = [mark.span for mark in marks]
    if error.span is not None:
        spans.append(error.span)
    width = max((len(str(span.source.find_line_column(span.end)[0])) for span in spans), default=1)
    page = _RenderedError(width, color)
    code = page.color_text(RED, f"error[{error.code}]")
    message = page.color_text(BOLD, f": {escape_controls(error.message)}")
    page.lines.append(code + message)
    if error.span is not None:
        own = _Mark(error.span, "^", RED)
        page.add_place(own)
        beside = [mark for mark in marks if _can_mark_together(mark, own)]
        page.show_mark(own, *beside)
        marks = [mark for mark in marks if mark not in beside]
    for mark in marks:
        if error.span is None or mark.span.source is not error.span.source:
            page.add_place(mark)
            page.show_mark(_Mark(mark.span, mark.sign, mark.style))
        else:
            page.show_mark(mark)
    head = page.color_text(BLUE, f"{page.gutter} = ") + page.color_text(CYAN, "help")
    page.lines.extend(f"{head}: {escape_controls(hint)}" for hint in error.hints)
    return "\n".join(page.lines)


@dataclass(frozen=True, slots=True)
class _Mark:
    """A place to be marked: with which sign, in which colour, and what is said there."""

    span: Span
    sign: str
    style: str
    label: str = ""


def _can_mark_together(one: _Mark, other: _Mark) -> bool:
    """Whether both can be marked below the same line: they are on it, and close to each other."""
    first, second = one.span, other.span
    lines = {first.line, second.line, _find_last_marked_line(first), _find_last_marked_line(second)}
    return first.source is second.source and len(lines) == 1 and abs(first.column - second.column) < BEFORE


def _find_last_marked_line(span: Span) -> int:
    return span.source.find_line_column(max(span.start, span.end - 1))[0]


@dataclass(slots=True)
class _RenderedError:
    """Lines of a rendered error under construction: the gutter is as wide as the largest line number."""

    width: int
    color: bool
    lines: list[str] = field(default_factory=list)

    @property
    def gutter(self) -> str:
        return " " * self.width

    def color_text(self, style: str, text: str) -> str:
        return f"{style}{text}\x1b[0m" if self.color and text else text

    def add_place(self, mark: _Mark) -> None:
        label = f": {mark.label}" if mark.label else ""
        self.lines.append(self.color_text(BLUE, f"{self.gutter}-->") + f" {mark.span.place}{label}")

    def add_line(self, text: str, number: int | None = None) -> None:
        """A line with its number, or one below it."""
        head = self.gutter if number is None else f"{number:>{self.width}}"
        self.lines.append(self.color_text(BLUE, f"{head} |") + (f" {text}" if text else ""))

    def show_mark(self, *marks: _Mark) -> None:
        """The first line of a place, and below it a line for each mark in it."""
        self.add_line("")
        span = marks[0].span
        cut = _ShownLine(span.source.get_line(span.line), min(one.span.column for one in marks) - 1)
        self.add_line(cut.shown, span.line)
        for one in marks:
            start, last = one.span.column - 1, _find_last_marked_line(one.span)
            place = cut.find_cell(start)
            length = max(1, cut.find_cell(start + one.span.end - one.span.start) - place)
            label = f" {one.label}" if one.label else ""
            label = f" ... to line {last}{label}" if last > one.span.line else label
            self.add_line(" " * place + self.color_text(one.style, one.sign * length + label))


class _ShownLine:
    """The shown part of a line, with the terminal's cell of each character."""

    def __init__(self, text: str, at: int) -> None:
        fits = len(text) <= WIDTH and sum(_show_character(char)[1] for char in text) <= WIDTH
        start, room = min(at, len(text)), BEFORE
        if fits:
            start = 0
        while start > 0 and room > 0:
            start -= 1
            room -= _show_character(text[start])[1]
        self._start = start
        self._places = [len("...") if start else 0]
        shown = ["..." if start else ""]
        for char in text[start : start + WIDTH]:
            seen, cells = _show_character(char)
            if self._places[-1] + cells > WIDTH + len("..."):
                break
            shown.append(seen)
            self._places.append(self._places[-1] + cells)
        more = start + len(self._places) - 1 < len(text)
        self.shown = "".join(shown) + ("..." if more else "")

    def find_cell(self, column: int) -> int:
        """The cell of the character at a column, counted from 0; the last cell for one that is cut off."""
        return self._places[max(0, min(column - self._start, len(self._places) - 1))]


def _show_character(char: str) -> tuple[str, int]:
    """How a character is shown, and how many cells it takes.

    East Asian characters take two, combining ones none. Control characters, which would act on the terminal, and those
    that change the direction of writing, which would show another script than the one that runs, are shown as symbols.
    """
    if " " <= char <= "~":
        return char, 1
    if char == "\t":
        return TAB, len(TAB)
    if char < " " or char == "\x7f":
        return chr(0x2421 if char == "\x7f" else 0x2400 + ord(char)), 1
    kind = category(char)
    if kind in ("Cc", "Cs") or bidirectional(char) in DIRECTION_MARKS:
        return "\N{REPLACEMENT CHARACTER}", 1
    if kind in ("Mn", "Me", "Cf"):
        return char, 0
    return char, 2 if east_asian_width(char) in "WF" else 1


# --- the classes of errors, their hints, and the note on a user's exception
class Error(Exception):
    """The base of all errors of ss2sql.

    `code` is a key of `CODES`, `message` one sentence, `span` the place in the script (None where there is
    none), `hints` a tuple of sentences that say what to do, `related` further places with labels.
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
        return render_all(self)

    def as_dict(self) -> dict[str, Any]:
        """This error alone as data that JSON can hold, with lines and columns counted from 1.

        A stretch ends before `end_column`; where there is no place, its keys are None.
        """
        return {
            "code": self.code,
            "title": CODES[self.code].title,
            "message": self.message,
            **_describe_span(self.span),
            "hints": list(self.hints),
            "related": [{"message": label, **_describe_span(span)} for span, label in self.related],
            "documentation": CODES[self.code].page,
        }

    def with_span(self, span: Span | None) -> Error:
        """This error, at `span` if it had no place yet."""
        if self.span is None:
            self.span = span
        return self

    def with_hint(self, *hints: str) -> Error:
        self.hints += hints
        return self


PLACE = ("file", "line", "column", "end_line", "end_column")


def _describe_span(span: Span | None) -> dict[str, Any]:
    if span is None:
        return dict.fromkeys(PLACE)
    ends = span.source.find_line_column(span.end)
    return dict(zip(PLACE, (span.source.name, span.line, span.column, *ends), strict=True))


class ParseError(Error):
    """The text is not SelectScript."""


class ResolveError(Error):
    """A name, function, source or option does not exist or does not fit."""


class UnsupportedError(Error):
    """The script needs something that the demanded engine lacks."""


class ExecutionError(Error):
    """A script failed while it ran."""


class RepresentationError(Error):
    """Rows do not fit the representation that AS asks for."""


class Stopped(Error):  # noqa: N818 - not an error of the script
    """A run ended early; `partial` holds the result so far (a `Result`, or None), whose status is `status`."""

    status: ClassVar[Literal["timeout", "cancelled", "memory", "steps"]]
    partial: Any = None


class Timeout(Stopped):
    """The run took longer than its timeout; `partial` holds what was found."""

    status = "timeout"


class Cancelled(Stopped):
    """The run was interrupted; `partial` holds what was found."""

    status = "cancelled"


class OutOfMemory(Stopped):
    """The run exceeded its limit of memory, or the machine's; `partial` holds what was found, if known."""

    status = "memory"


class OutOfSteps(Stopped):
    """The searches of the run exceeded the limit of steps; `partial` holds what was found."""

    status = "steps"


class SessionError(Error):
    """A session was used wrongly from Python: closed, or given something that it cannot register."""


class WorkersWarning(UserWarning):
    """`workers` has no effect on a run, or on the calls of one function; the message says why and what to do."""


def combine_errors(errors: Sequence[Error]) -> Error:
    """One exception for all `errors` (at least one), in the order of their places. What is said twice is said once."""
    ordered = sorted({(e.span, e.message): e for e in errors}.values(), key=lambda e: e.span.start if e.span else -1)
    first = ordered[0]
    first.errors = tuple(ordered)
    return first


def require_package(name: str, extra: str, user: str) -> Any:
    """A package of an extra. Raises SessionError S003 with the install command; `user` is what needs it."""
    try:
        return import_module(name)
    except ImportError as reason:
        message = f"{user} needs the package {name.partition('.')[0]}, which is not installed"
        raise SessionError("S003", message, hints=(install_line(extra),)) from reason


# --- hints: known names that are similar to the one that was written
FEW = 8  # up to so many names are all shown


def suggest_similar(name: str, known: Iterable[str]) -> list[str]:
    """The known names, three at most, with a similar spelling; a name that differs only in case is returned alone."""
    from difflib import get_close_matches

    lowered = {one.lower(): one for one in sorted(set(known), reverse=True)}
    if name.lower() in lowered:
        return [lowered[name.lower()]]
    close = get_close_matches(name.lower(), list(lowered), n=3, cutoff=0.6)
    # get_close_matches misses a name that merely lost its tail (mov for moves): offer prefixes as well.
    close += [one for one in sorted(lowered) if one not in close and len(name) > 1 and one.startswith(name.lower())]
    return [lowered[one] for one in close[:3]]


def suggest_names(name: str, known: Iterable[str]) -> tuple[str, ...]:
    """Hints with the closest known names, or with all names where there are few."""
    names = sorted(set(known))
    if twins := [one for one in names if one != name and normalize("NFKC", one) == normalize("NFKC", name)]:
        return tuple(f"did you mean '{one}', which is written with {_spell_hint_code_points(one)}?" for one in twins)
    if close := suggest_similar(name, names):
        return ("did you mean " + " or ".join(f"'{one}'" for one in close) + "?",)
    if 0 < len(names) <= FEW:
        return ("known here: " + ", ".join(names),)
    return ()


def join_words(words: Iterable[str], last: str = "or") -> str:
    """`a`, `a or b`, `a, b or c`."""
    *first, end = words
    return f"{', '.join(first)} {last} {end}" if first else end


def _spell_hint_code_points(name: str) -> str:
    """A name with the code points of its characters beyond ASCII, for names that look the same."""
    return ", ".join(f"U+{ord(char):04X}" if not char.isascii() else char for char in name)


# --- the note on a user's exception with the place in the script; type and traceback stay
def note_place_on_exception(
    exception: BaseException, called: str, spans: Sequence[Span], kind: str = "function", evals: Sequence[Span] = ()
) -> None:
    """Adds to a user's exception, once, the note with the function that raised it and its place in the script.

    Args:
        exception: what was raised; its type and its traceback stay.
        called: the name of what raised it.
        spans: where it is called.
        kind: what it is.
        evals: the places of the `eval` calls whose strings contain the call, the innermost first.
    """
    places = ", ".join(dict.fromkeys(span.place for span in spans)) or "<script>"
    lines = [f"raised by the {kind} '{called}', called at {places}", *_show_marked_lines(spans)]
    for span in evals:
        lines += [f"in the text that eval reads at {span.place}", *_show_marked_lines([span])]
    note_on_exception(exception, "\n".join(lines))


def note_on_exception(exception: BaseException, note: str) -> None:
    """Adds the note, unless the exception already has a more precise one."""
    if getattr(exception, "_ss2sql_noted", False):
        return
    exception.add_note(note)
    try:
        exception._ss2sql_noted = True  # type: ignore[attr-defined]
    except AttributeError:
        return  # exceptions with __slots__ cannot be marked and may get a second note


def _show_marked_lines(spans: Sequence[Span]) -> list[str]:
    lines = dict.fromkeys((span.source, span.line) for span in spans)
    return [f"  {number} | {source.get_line(number)}" for source, number in lines]
