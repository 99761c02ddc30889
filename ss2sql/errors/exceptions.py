"""The classes of errors."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, ClassVar, Literal

from ss2sql.errors.codes import CODES
from ss2sql.errors.renderer import render_all
from ss2sql.errors.spans import Span


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
    """One exception for all `errors` (at least one), in the order of their places."""
    ordered = sorted(errors, key=lambda e: e.span.start if e.span else -1)
    first = ordered[0]
    first.errors = tuple(ordered)
    return first
