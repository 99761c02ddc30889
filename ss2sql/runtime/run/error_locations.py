"""Where a script is when something goes wrong: from Python's traceback to the span in the script.

Generated code carries the positions of the script instead of its own. A `CodePage` is the text that one piece of
generated code points into. It starts with the script; texts from elsewhere, such as a list literal of another script
that is read late, stand below it. So the lines of the script keep their numbers, and Python's own traceback shows them.
"""

from __future__ import annotations

import ast
import linecache
from collections.abc import Iterator
from itertools import islice
from types import FrameType, TracebackType
from typing import TypeAlias

from ss2sql.errors import Error, ExecutionError, Source, Span, Stopped, note_place_on_exception
from ss2sql.language.operations import OPERATIONS

# First line, last line, first column, last column, as a code object's co_positions gives them.
Position: TypeAlias = tuple[int | None, int | None, int | None, int | None]

PAGE = "__page__"  # the name of the page among the globals of generated code
EVAL_LABEL = "in the text that this eval reads"


class CodePage:
    """The texts that the spans of one piece of generated code come from, as one text with line numbers."""

    def __init__(self, source: Source) -> None:
        self.name = source.name
        self._lines: list[str] = []
        self._first: dict[int, int] = {}
        self._sources: list[Source] = []  # keeps the sources alive: _first goes by their identity
        self._spans: dict[Position, Span] = {}
        self._by_line: dict[int, Span] = {}
        self._functions: dict[Position, str] = {}
        self._evals: set[Position] = set()
        self._indexes: dict[Position, list[ast.expr]] = {}
        self._append_source(source)

    def _append_source(self, source: Source) -> int:
        first = self._first[id(source)] = len(self._lines)
        self._sources.append(source)
        self._lines.extend(f"{line}\n" for line in source.text.split("\n"))
        return first

    def add_span(self, span: Span) -> Position:
        """The position that stands for the span; columns count bytes, as Python's do."""
        source = span.source
        first = self._first.get(id(source))
        if first is None:
            first = self._append_source(source)
        line, column = source.find_line_column(span.start)
        end_line, end_column = source.find_line_column(span.end)
        position = (
            first + line,
            first + end_line,
            self._count_bytes(first + line, column - 1),
            self._count_bytes(first + end_line, end_column - 1),
        )
        self._spans[position] = span
        self._by_line.setdefault(position[0], span)
        return position

    def _count_bytes(self, line: int, column: int) -> int:
        text = self._lines[line - 1]
        return column if text.isascii() else len(text[:column].encode("utf-8", "surrogatepass"))

    def note_call(self, span: Span, function: str) -> None:
        """Notes which function is called at the span, for the note on a user's exception."""
        self._functions[self.add_span(span)] = function

    def note_eval(self, span: Span) -> None:
        """Notes that the code of another page is called at the span."""
        self._evals.add(self.add_span(span))

    def note_index(self, span: Span, operands: ast.expr) -> None:
        """Notes a list and an index, of which code at the span takes the element without a test before.

        The caller guarantees that it does no harm to evaluate them again. A test would cost 0.05 us each time.
        """
        self._indexes.setdefault(self.add_span(span), []).append(operands)

    def explain_index_error(self, position: Position, frame: FrameType) -> ExecutionError | None:
        """What is wrong with the index that is out of range at a position; None if none was noted there."""
        take_item, names = OPERATIONS["item"].value, {**frame.f_globals, **frame.f_locals}
        assert take_item is not None
        exact = position in self._indexes
        for place, noted in self._indexes.items():
            for operands in noted if place == position or (not exact and place[0] == position[0]) else ():
                try:
                    container, index = eval(compile(ast.Expression(operands), self.name, "eval"), names)  # our own code
                    take_item(list(container), index)  # some lists are tuples there
                except ExecutionError as error:
                    return error
                except Exception:  # of another index at this place, which the code did not come to
                    continue
        return None

    def find_span(self, position: Position) -> Span | None:
        """The span at a position; by its line alone where Python was told to forget columns."""
        found = self._spans.get(position)
        return found if found is not None or position[0] is None else self._by_line.get(position[0])

    def find_name(self, position: Position) -> str:
        """The function that is called at a position, or the name that is read there."""
        span = self.find_span(position)
        return self._functions.get(position) or (span.text if span and span.text.isidentifier() else "<script>")

    def is_eval_call(self, position: Position) -> bool:
        return position in self._evals

    def show_in_traceback(self) -> None:
        """Hands the lines to Python's traceback."""
        linecache.cache[self.name] = (sum(map(len, self._lines)), None, self._lines, self.name)


Place: TypeAlias = tuple[CodePage, Position, FrameType | None]


def locate_in_script(error: Exception) -> Exception:
    """The exception that leaves the native executor in place of `error`, with its place in the script.

    An Error without a span gets that of the innermost generated code, a user's exception gets a note. A
    variable that was read before it got a value, which Python reports as NameError, becomes an Error, and so does
    Python's IndexError where an index is not tested.
    """
    error = _unwrap_stop_iteration(error)
    trail = list(_iterate_generated_frames(error.__traceback__))
    if not trail:
        return error
    for page, _, _ in trail:
        page.show_in_traceback()
    page, position, frame = trail[-1]
    innermost, span = frame is not None, page.find_span(position)
    if isinstance(error, IndexError) and frame is not None:
        found = page.explain_index_error(position, frame)
        error = error if found is None else found.with_traceback(error.__traceback__)
    if isinstance(error, NameError) and innermost and span is not None and span.text.isidentifier():
        error = _build_unset_error(span.text, error)  # any other name is one of generated code, and a mistake of ours
    if isinstance(error, Error):
        if not isinstance(error, Stopped):
            error.with_span(span)
            _add_running_evals(error, trail)
    else:
        evals = [place for place, _ in _iterate_running_evals(trail) if place != span]
        note_place_on_exception(error, page.find_name(position), [span] if span else [], evals=evals)
    return error


def _unwrap_stop_iteration(error: Exception) -> Exception:
    """A StopIteration of a user's function, which Python turns into a RuntimeError where it leaves a generator."""
    cause = error.__cause__
    if (
        type(error) is RuntimeError
        and isinstance(cause, StopIteration)
        and str(error) == "generator raised StopIteration"
    ):
        return cause
    return error


def _build_unset_error(name: str, error: NameError) -> ExecutionError:
    message = f"the variable '{name}' has no value yet"
    return ExecutionError("R001", message, hints=("assign it before it is read",)).with_traceback(error.__traceback__)


def _add_running_evals(error: Error, trail: list[Place]) -> None:
    """Adds the places of the evals around the error, innermost first."""
    for place in _iterate_running_evals(trail):
        if place[0] != error.span and place not in error.related:
            error.related += (place,)


def _iterate_running_evals(trail: list[Place]) -> Iterator[tuple[Span, str]]:
    """The evals around the place where a trail ends, innermost first, as an Error relates to them."""
    for page, position, _ in reversed(trail):
        span = page.find_span(position)
        if span is not None and page.is_eval_call(position):
            yield span, EVAL_LABEL


def _iterate_generated_frames(traceback: TracebackType | None) -> Iterator[Place]:
    """The generated frames of a traceback, outermost first: page, position, the frame if it is the last of all."""
    while traceback is not None:
        page = traceback.tb_frame.f_globals.get(PAGE)
        if isinstance(page, CodePage):
            positions = traceback.tb_frame.f_code.co_positions()
            innermost = traceback.tb_frame if traceback.tb_next is None else None
            yield page, next(islice(positions, traceback.tb_lasti // 2, None)), innermost
        traceback = traceback.tb_next
