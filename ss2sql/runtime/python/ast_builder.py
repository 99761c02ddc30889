"""Writing Python code as syntax trees whose positions are those of the script, from nodes or from text."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Mapping
from functools import cache, reduce
from typing import Any, TypeVar

from ss2sql.runtime.run.error_locations import Position


class AstBuilder:
    """Makes syntax trees, all at one position of the script."""

    __slots__ = ("at",)

    def __init__(self, position: Position) -> None:
        line, end_line, column, end_column = position
        self.at: Any = {"lineno": line, "end_lineno": end_line, "col_offset": column, "end_col_offset": end_column}

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

    def call_method(self, path: str, *arguments: ast.expr) -> ast.expr:
        """`run.host.name(...)`, given as a path of names."""
        first, *parts = path.split(".")
        return self.call(reduce(self.part, parts, self.name(first)), *arguments)

    def compare(self, left: ast.expr, operator: ast.cmpop, right: ast.expr) -> ast.expr:
        return ast.Compare(left, [operator], [right], **self.at)

    def binary(self, left: ast.expr, operator: ast.operator, right: ast.expr) -> ast.expr:
        return ast.BinOp(left, operator, right, **self.at)

    def unary(self, operator: ast.unaryop, operand: ast.expr) -> ast.expr:
        return ast.UnaryOp(operator, operand, **self.at)

    def negate(self, operand: ast.expr) -> ast.expr:
        return self.unary(ast.Not(), operand)

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

    def store(self, container: ast.expr, key: ast.expr, value: ast.expr) -> ast.stmt:
        """`container[key] = value`."""
        return ast.Assign([ast.Subscript(container, key, ast.Store(), **self.at)], value, **self.at)

    def defer(self, value: ast.expr) -> ast.expr:
        """A function without parameters that gives the value."""
        return ast.Lambda(ast.arguments([], [], None, [], [], None, []), value, **self.at)

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

    def try_except(self, attempt: ast.stmt, error: str, otherwise: ast.stmt | None = None) -> ast.stmt:
        """The statement, and the other one, or nothing, where it raises the error of this name."""
        handler = ast.ExceptHandler(self.name(error), None, [otherwise or ast.Pass(**self.at)], **self.at)
        return ast.Try([attempt], [handler], [], [], **self.at)

    def try_unless_stopped(self, attempt: ast.stmt, otherwise: ast.stmt) -> ast.stmt:
        """The statement, and the other one where it raises anything but the end of the run."""
        ends = ast.ExceptHandler(self.name("Stopped"), None, [ast.Raise(**self.at)], **self.at)
        fails = ast.ExceptHandler(self.name("Exception"), None, [otherwise], **self.at)
        return ast.Try([attempt], [ends, fails], [], [], **self.at)

    def nonlocal_names(self, names: list[str]) -> ast.stmt:
        """`nonlocal a, b`."""
        return ast.Nonlocal(names, **self.at)

    def function(self, name: str, parameters: list[str], body: list[ast.stmt]) -> ast.stmt:
        arguments = ast.arguments([], [ast.arg(p, None, **self.at) for p in parameters], None, [], [], None, [])
        return ast.FunctionDef(name, arguments, body, [], None, **self.at)


# --- python text as syntax trees at a place of the script; names and copies of such trees
T = TypeVar("T")
POSITION_FIELDS = ("lineno", "end_lineno", "col_offset", "end_col_offset")

# What the words of a text stand for: an expression, or statements where the word stands alone on its line.
Substitutions = Mapping[str, ast.expr | list[ast.stmt]]


def generate_template(text: str, build: AstBuilder, words: Substitutions) -> list[ast.stmt]:
    """The statements of a text, each word in it replaced by what it stands for.

    >>> build = AstBuilder((1, 1, 0, 0))
    >>> words = {"KEY": build.name("row"), "DROP": [build.continue_loop()]}
    >>> code = generate_template("if KEY in closed:\\n    DROP", build, words)
    >>> print(ast.unparse(code[0]))
    if row in closed:
        continue
    """

    def fill_node(node: Any) -> Any:
        match node:
            case ast.Name(id=word, ctx=context) if word in words:
                meant = words[word]
                return ast.Name(meant.id, context, **build.at) if isinstance(meant, ast.Name) else meant
            case ast.AST():
                fields = {name: fill_node(value) for name, value in ast.iter_fields(node)}
                return type(node)(**fields, **(build.at if "lineno" in node._attributes else {}))
            case list():
                return [one for part in node for one in fill_parts(part)]
        return node

    def fill_parts(part: Any) -> list[Any]:
        if isinstance(part, ast.Expr) and isinstance(part.value, ast.Name):
            meant = words.get(part.value.id)
            if isinstance(meant, list):
                return meant
        return [fill_node(part)]

    return fill_node(_parse_code_template(text))  # type: ignore[no-any-return]


@cache
def _parse_code_template(text: str) -> list[ast.stmt]:
    return ast.parse(text).body


def strip_positions(code: list[ast.stmt]) -> list[ast.stmt]:
    """The statements without their places, which mean nothing in a script; `set_code_positions` gives them others."""
    for node in (node for part in code for node in ast.walk(part)):
        for word in POSITION_FIELDS:
            if hasattr(node, word):
                delattr(node, word)
    return code


def set_code_positions(tree: ast.AST, at: Mapping[str, int]) -> None:
    for node in ast.walk(tree):
        if "lineno" in node._attributes and not hasattr(node, "lineno"):
            for word, value in at.items():
                setattr(node, word, value)


def copy_tree(node: T) -> T:
    """A copy of syntax trees: `copy.deepcopy` takes four times as long.

    Fields and places alone: who shows tracebacks, as IPython does, notes the parents of nodes in them, and all trees
    share their `Load`.
    """
    if isinstance(node, list):
        return [copy_tree(part) for part in node]  # type: ignore[return-value]
    if not isinstance(node, ast.AST):
        return node
    made: Any = type(node).__new__(type(node))
    fields = node.__dict__
    made.__dict__.update({name: copy_tree(fields[name]) for name in node._fields if name in fields})
    made.__dict__.update({name: fields[name] for name in node._attributes if name in fields})
    return made  # type: ignore[no-any-return]


def list_names_code_reads(code: Iterable[ast.AST]) -> set[str]:
    """The names that are read, in functions further in, too."""
    return {node.id for node in _iterate_code_names(code) if isinstance(node.ctx, ast.Load)}


def list_names_code_sets(code: Iterable[ast.AST]) -> list[str]:
    """The names that are set, once for each time."""
    return [node.id for node in _iterate_code_names(code) if isinstance(node.ctx, ast.Store)]


def _iterate_code_names(code: Iterable[ast.AST]) -> Iterable[ast.Name]:
    return (node for part in code for node in ast.walk(part) if isinstance(node, ast.Name))
