"""Generated code that knows its place in the script: it is built as syntax trees, and an exception finds its span.

Generated code carries the positions of the script instead of its own. A `CodePage` is the text that one piece of
generated code points into. It starts with the script; texts from elsewhere, such as a list literal of another script
that is read late, stand below it. So the lines of the script keep their numbers, and Python's own traceback shows them.
"""

from __future__ import annotations

import ast
import linecache
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cache
from itertools import islice
from types import FrameType, MappingProxyType, TracebackType
from typing import Any, TypeAlias, TypeVar

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


# --- Python code as syntax trees whose positions are those of the script, from nodes or from text
class AstBuilder:
    """Makes syntax trees, all at one position of the script, from nodes or from text.

    >>> build = AstBuilder((1, 1, 0, 0), {})
    >>> code = build.write("if KEY in closed:\\n    DROP", KEY="row", DROP=[build.continue_loop()])
    >>> print(ast.unparse(code[0]))
    if row in closed:
        continue
    >>> print(ast.unparse(build.express("most(found)[0]", most=max, found="found_1")))
    max(found_1)[0]
    """

    __slots__ = ("at", "namespace")

    def __init__(self, position: Position, namespace: dict[str, Any]) -> None:
        line, end_line, column, end_column = position
        self.at: Any = {"lineno": line, "end_lineno": end_line, "col_offset": column, "end_col_offset": end_column}
        self.namespace = namespace  # the globals of the code, which functions of the library are put into

    def write(self, text: str, /, **words: Word) -> list[ast.stmt]:
        """The statements of a text, each word in it replaced by what it stands for."""
        return copy_tree(parse_code(text), {word: self._build_word(meant) for word, meant in words.items()}, self.at)

    def express(self, text: str, /, **words: Word) -> ast.expr:
        """The expression that a text is."""
        (line,) = self.write(text, **words)
        assert isinstance(line, ast.Expr)
        return line.value

    def _build_word(self, meant: Word) -> ast.expr | Sequence[ast.stmt]:
        if isinstance(meant, str):
            return self.name(meant)
        if isinstance(meant, (ast.expr, list)):
            return meant
        return self.name(self.use(meant)) if callable(meant) else self.constant(meant)

    def use(self, function: Callable[..., Any]) -> str:
        """The name of a function of the library."""
        name = function.__name__
        assert self.namespace.setdefault(name, function) is function
        return name

    # --- expressions -----------------------------------------------------------------------------------

    def name(self, name: str) -> ast.expr:
        return ast.Name(name, ast.Load(), **self.at)

    def constant(self, value: Any) -> ast.expr:
        return ast.Constant(value, **self.at)

    def call(self, function: str | ast.expr, *arguments: ast.expr) -> ast.expr:
        callee = self.name(function) if isinstance(function, str) else function
        return ast.Call(callee, list(arguments), [], **self.at)

    def pack(self, *items: ast.expr) -> ast.expr:
        return ast.Tuple(list(items), ast.Load(), **self.at)

    def array(self, *items: ast.expr) -> ast.expr:
        return ast.List(list(items), ast.Load(), **self.at)

    def record(self, names: tuple[str, ...], values: tuple[ast.expr, ...]) -> ast.expr:
        return ast.Dict([self.constant(name) for name in names], list(values), **self.at)

    def item(self, value: ast.expr, index: int | ast.expr) -> ast.expr:
        part = self.constant(index) if isinstance(index, int) else index
        return ast.Subscript(value, part, ast.Load(), **self.at)

    def part(self, value: ast.expr, name: str) -> ast.expr:
        """`value.name`."""
        return ast.Attribute(value, name, ast.Load(), **self.at)

    def compare(self, left: ast.expr, operator: ast.cmpop, right: ast.expr) -> ast.expr:
        return ast.Compare(left, [operator], [right], **self.at)

    def negate(self, operand: ast.expr) -> ast.expr:
        return ast.UnaryOp(ast.Not(), operand, **self.at)

    def truth(self, operand: ast.expr) -> ast.expr:
        """The operand's truth as a bool; in a condition Python compiles it away."""
        return self.negate(self.negate(operand))

    def join_conditions(self, operator: ast.boolop, parts: list[ast.expr]) -> ast.expr:
        return ast.BoolOp(operator, parts, **self.at)

    def if_else(self, condition: ast.expr, then: ast.expr, otherwise: ast.expr) -> ast.expr:
        return ast.IfExp(condition, then, otherwise, **self.at)

    def bind(self, name: str, value: ast.expr) -> ast.expr:
        """`(name := value)`."""
        return ast.NamedExpr(ast.Name(name, ast.Store(), **self.at), value, **self.at)

    def yield_(self, value: ast.expr) -> ast.expr:
        """`yield value`."""
        return ast.Yield(value, **self.at)

    # --- statements ------------------------------------------------------------------------------------

    def assign(self, name: str, value: ast.expr) -> ast.stmt:
        return ast.Assign([ast.Name(name, ast.Store(), **self.at)], value, **self.at)

    def unpack(self, names: list[str], value: ast.expr) -> ast.stmt:
        targets: list[ast.expr] = [ast.Name(name, ast.Store(), **self.at) for name in names]
        return ast.Assign([ast.Tuple(targets, ast.Store(), **self.at)], value, **self.at)

    def add_to(self, name: str, by: int = 1) -> ast.stmt:
        return ast.AugAssign(ast.Name(name, ast.Store(), **self.at), ast.Add(), self.constant(by), **self.at)

    def run(self, value: ast.expr) -> ast.stmt:
        return ast.Expr(value, **self.at)

    def return_(self, value: ast.expr) -> ast.stmt:
        return ast.Return(value, **self.at)

    def when(self, condition: ast.expr, *then: ast.stmt) -> ast.stmt:
        return ast.If(condition, list(then), [], **self.at)

    def if_not(self, condition: ast.expr, *then: ast.stmt) -> ast.stmt:
        return self.when(self.negate(condition), *then)

    def continue_loop(self) -> ast.stmt:
        return ast.Continue(**self.at)

    def loop(self, names: list[str], items: ast.expr, body: list[ast.stmt]) -> ast.stmt:
        """`for name in items:`; with several names the items are tuples."""
        targets: list[ast.expr] = [ast.Name(name, ast.Store(), **self.at) for name in names]
        target = targets[0] if len(targets) == 1 else ast.Tuple(targets, ast.Store(), **self.at)
        return ast.For(target, items, body, [], **self.at)

    def try_unless_stopped(self, attempt: list[ast.stmt], otherwise: list[ast.stmt]) -> list[ast.stmt]:
        """The statements, and the other ones where they raise anything but the end of the run."""
        text = "try: ATTEMPT\nexcept Stopped: raise\nexcept Exception: OTHERWISE"
        return self.write(text, ATTEMPT=attempt, OTHERWISE=otherwise)

    def function(self, name: str, parameters: list[str], body: list[ast.stmt]) -> ast.stmt:
        arguments = ast.arguments([], [ast.arg(p, None, **self.at) for p in parameters], None, [], [], None, [])
        return ast.FunctionDef(name, arguments, body, [], None, **self.at)


# --- python text as syntax trees at a place of the script; names and copies of such trees
T = TypeVar("T")

# What a word of a text stands for: an expression; statements, where the word stands alone on its line; a name; a
# function of the library; a constant.
Word: TypeAlias = "ast.expr | Sequence[ast.stmt] | str | Callable[..., Any] | int | None"


# Nodes with parts or positions; all trees share the others.
_COPIED = (ast.mod, ast.stmt, ast.expr, ast.excepthandler, ast.comprehension, ast.arguments, ast.arg, ast.keyword)


@cache
def parse_code(text: str) -> list[ast.stmt]:
    """The statements of a text without their positions, which mean nothing in a script. Read them, and copy them."""
    code = ast.parse(text).body
    for node in (node for part in code for node in ast.walk(part)):
        for position in ("lineno", "end_lineno", "col_offset", "end_col_offset"):
            node.__dict__.pop(position, None)
    return code


def copy_tree(
    node: T, words: Mapping[str, Any] = MappingProxyType({}), at: Mapping[str, int] = MappingProxyType({})
) -> T:
    """A copy of syntax trees, in which words are replaced by what they stand for, with positions where there are none.

    `copy.deepcopy` takes four times as long. What all trees share is not copied: who shows tracebacks, as IPython does,
    notes the parents of nodes in it.
    """
    kind: Any = type(node)
    if kind is list:
        lines: list[Any] = []
        for part in node:  # type: ignore[attr-defined]
            word = words.get(part.value.id) if type(part) is ast.Expr and type(part.value) is ast.Name else None
            lines += word if isinstance(word, list) else [copy_tree(part, words, at)]
        return lines  # type: ignore[return-value]
    if kind is ast.Name and (word := words.get(node.id)) is not None:  # type: ignore[attr-defined]
        return word if type(node.ctx) is ast.Load else ast.Name(word.id, node.ctx, **at)  # type: ignore
    if not isinstance(node, _COPIED):
        return node
    made = kind.__new__(kind)
    made.__dict__.update(at)
    for name, value in node.__dict__.items():
        made.__dict__[name] = copy_tree(value, words, at) if isinstance(value, (ast.AST, list)) else value
    return made  # type: ignore[no-any-return]


def list_names_code_reads(code: Iterable[ast.AST]) -> set[str]:
    """The names that are read, in functions further in, too."""
    return {node.id for node in _iterate_code_names(code) if isinstance(node.ctx, ast.Load)}


def list_names_code_sets(code: Iterable[ast.AST]) -> list[str]:
    """The names that are set, once for each time."""
    return [node.id for node in _iterate_code_names(code) if isinstance(node.ctx, ast.Store)]


def _iterate_code_names(code: Iterable[ast.AST]) -> Iterable[ast.Name]:
    return (node for part in code for node in ast.walk(part) if isinstance(node, ast.Name))
