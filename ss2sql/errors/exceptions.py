"""The classes of errors, their hints, and the note on a user's exception."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Any, ClassVar, Literal, TypeAlias
from unicodedata import normalize

from ss2sql.errors.codes import CODES
from ss2sql.errors.renderer import Span, render_all


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


def _describe_span(span: Span | None) -> dict[str, Any]:
    if span is None:
        return dict.fromkeys(("file", "line", "column", "end_line", "end_column"))
    end_line, end_column = span.source.find_line_column(span.end)
    return {
        "file": span.source.name,
        "line": span.line,
        "column": span.column,
        "end_line": end_line,
        "end_column": end_column,
    }


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


# --- hints: known names that are similar to the one that was written; the wording for a shell
Spellings: TypeAlias = tuple[tuple[re.Pattern[str], str], ...]

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
        return tuple(f"did you mean '{one}', which is written with {_spell_code_points(one)}?" for one in twins)
    if close := suggest_similar(name, names):
        return ("did you mean " + " or ".join(f"'{one}'" for one in close) + "?",)
    if 0 < len(names) <= FEW:
        return ("known here: " + ", ".join(names),)
    return ()


def _spell_code_points(name: str) -> str:
    """A name with the code points of its characters beyond ASCII, for names that look the same."""
    return ", ".join(f"U+{ord(char):04X}" if not char.isascii() else char for char in name)


def respell_hints(error: Error, spellings: Spellings) -> None:
    """Rewrites hints for users of Python into hints for a command line or a shell."""
    for one in error.errors:
        for pattern, spelling in spellings:
            one.hints = tuple(pattern.sub(spelling, hint) for hint in one.hints)


# --- the note on a user's exception with the place in the script; type and traceback stay
def note_place(
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
    lines = [f"raised by the {kind} '{called}', called at {places}", *_show_script_lines(spans)]
    for span in evals:
        lines += [f"in the text that eval reads at {span.place}", *_show_script_lines([span])]
    note_once(exception, "\n".join(lines))


def note_once(exception: BaseException, note: str) -> None:
    """Adds the note, unless the exception already has a more precise one."""
    if getattr(exception, "_ss2sql_noted", False):
        return
    exception.add_note(note)
    try:
        exception._ss2sql_noted = True  # type: ignore[attr-defined]
    except AttributeError:
        return  # exceptions with __slots__ cannot be marked and may get a second note


def _show_script_lines(spans: Sequence[Span]) -> list[str]:
    lines = dict.fromkeys((span.source, span.line) for span in spans)
    return [f"  {number} | {source.get_line(number)}" for source, number in lines]
