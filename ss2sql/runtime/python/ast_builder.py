"""Writing Python code as syntax trees whose positions are those of the script."""

from __future__ import annotations

import ast
from typing import Any

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
