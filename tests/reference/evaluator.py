"""Statements and expressions: sections 3, 4 and 8 of the language page."""

from __future__ import annotations

import inspect
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, assert_never

from ss2sql.errors import Error, Source
from ss2sql.frontend.syntax import ast
from ss2sql.frontend.syntax.parser import parse

from . import groups, paths, queries, sight
from .functions import BUILTINS, aggregate
from .sight import Frame, LateList
from .values import OPERATORS, Failure, equal, fresh, incoming, item_at, sized, slice_of


class Reference:
    """An evaluator with its functions, variables and tables; one instance can run several scripts.

    `functions` are Python functions by name, `variables` and `tables` (lists of dicts) Python values. The
    declared `volatility` is taken and not needed: every function is called at every occurrence, which is
    right for all three classes. After a run `variables` holds the script variables, `printed` what `print`
    wrote, `steps` the number of steps that searches generated, `calls` the calls of each user function.
    """

    def __init__(
        self,
        functions: Mapping[str, Callable[..., Any]] | None = None,
        variables: Mapping[str, Any] | None = None,
        tables: Mapping[str, list[dict[str, Any]]] | None = None,
        volatility: Mapping[str, str] | None = None,
    ) -> None:
        self.functions = dict(functions or {})
        self.variables: dict[str, Any] = {name: incoming(value) for name, value in (variables or {}).items()}
        self.tables = {name: incoming(rows) for name, rows in (tables or {}).items()}
        self.volatility = dict(volatility or {})
        self.history: dict[str, History] = {}
        self.clock: Callable[[], float] = time.time
        self.printed: list[str] = []
        self.labels: dict[int, str] = {}  # of the columns of the queries that run, by identity
        self.assigned: frozenset[str] = frozenset()  # the names that the script assigns anywhere
        self.steps = 0
        self.calls: dict[str, int] = {}

    def run(self, script: str | ast.Script) -> Any:
        """The value of the script's last statement.

        A statement that is a query, or assigns one, gives its representation as it is; inside anything else the
        representation becomes a value of the language (tuples and sets become lists).

        Raises:
            Failure: the script fails with the code of ss2sql that it holds.
            Exception: whatever a function of the user raised.
        """
        value: Any = None
        statements = self.parsed(script, "<script>").statements
        self.assigned = frozenset(sight.assigned_names(statements))
        for statement in statements:
            match statement:
                case ast.Query():
                    value = queries.answer(self, statement, None)
                case ast.Assign(name=name, value=ast.Query() as query):
                    value = queries.answer(self, query, None)
                    self.history.pop(name, None)
                    self.variables[name] = sized(incoming(value))
                case _:
                    value = self.evaluate(statement, None)
        return value if isinstance(value, (tuple, set)) else fresh(value)

    @staticmethod
    def parsed(script: str | ast.Script, name: str) -> ast.Script:
        if isinstance(script, ast.Script):
            return script
        try:
            return parse(Source(script, name))
        except Error as error:
            raise Failure(error.code, error.message) from error

    # Expressions

    def evaluate(self, expr: ast.Expr, frame: Frame | None) -> Any:
        """The value of an expression in the sight of a frame (None: outside of every query)."""
        if frame is not None and frame.group is not None:
            found = in_group(expr, frame.group)
            if found:
                return found[0]
        match expr:
            case ast.Literal(value=value):
                return value
            case ast.Name(name=name):
                found = self.lookup(name, frame)
                if not found:
                    raise Failure("R001", name)
                return found[0]
            case ast.This(source=source):
                return sight.this(frame) if source is None else self.source(source, frame).element
            case ast.Attribute(source=source, name=name):
                bound = sight.first(frame) if source is None else self.source(source, frame)
                if name not in bound.columns:
                    raise Failure("R001", f"{source}.{name}")
                return bound.column(name)
            case ast.ListLiteral(items=items):
                return sized([self.evaluate(item, frame) for item in items])
            case ast.Index(value=value, index=index):
                return item_at(self.evaluate(value, frame), self.evaluate(index, frame))
            case ast.Slice(value=value, lower=lower, upper=upper):
                parts = [None if part is None else self.evaluate(part, frame) for part in (value, lower, upper)]
                return slice_of(*parts)
            case ast.Operator(function="in" | "not_in", operands=(item, ast.Query(representation=None) as query)):
                return self.operate(expr.function, [self.operand(item, frame), self.values_of(query, frame)])
            case ast.Operator(function=function, operands=operands):
                return self.operate(function, [self.operand(operand, frame) for operand in operands])
            case ast.Between(value=value, low=low, high=high):
                value = self.operand(value, frame)
                above = bool(self.operate("ge", [value, self.operand(low, frame)]))
                return above and bool(self.operate("le", [value, self.operand(high, frame)]))
            case ast.And(parts=parts):
                return all(bool(self.evaluate(part, frame)) for part in parts)
            case ast.Or(parts=parts):
                return any(bool(self.evaluate(part, frame)) for part in parts)
            case ast.Xor(left=left, right=right):
                return bool(self.evaluate(left, frame)) != bool(self.evaluate(right, frame))
            case ast.Not(operand=operand):
                return not self.evaluate(operand, frame)
            case ast.If():
                return self.choose(expr, frame)
            case ast.Assign():
                return self.assign(expr, frame)
            case ast.TemporalAssign() | ast.Temporal():
                return self.temporal(expr, frame)
            case ast.Call():
                return self.call(expr, frame)
            case ast.Query():
                return sized(incoming(queries.answer(self, expr, frame)))
            case _:
                assert_never(expr)

    def values_of(self, expr: ast.Expr, frame: Frame | None) -> Any:
        """What stands right of IN: a query without AS is the list of its single column."""
        if isinstance(expr, ast.Query) and expr.representation is None:
            expr = replace(expr, representation=ast.Representation("list", (), (), span=expr.span))
        return self.evaluate(expr, frame)

    def operand(self, expr: ast.Expr, frame: Frame | None) -> Any:
        """The value of an operand: a query without AS is that of its single column and its single row, if any."""
        if not isinstance(expr, ast.Query) or expr.representation is not None:
            return self.evaluate(expr, frame)
        if (expr.searches and not expr.last) or len(expr.columns) > 1 or isinstance(expr.columns[0], ast.Star):
            raise Failure("R014", "a query as an operand")
        form = ast.Representation("list", (), (), span=expr.span)
        values = self.evaluate(replace(expr, representation=form), frame)
        if not isinstance(values, list) or len(values) > 1:
            raise Failure("X007", "several rows")
        return values[0] if values else None

    def alone(self, expr: ast.Expr, frame: Frame) -> Any:
        """The value of a SELECT column, GROUP BY or ORDER BY key: a bare name may be a function of `this`."""
        in_sight = frame.group is not None and in_group(expr, frame.group)
        if isinstance(expr, ast.Name) and not in_sight and not self.lookup(expr.name, frame):
            if expr.name not in self.functions and expr.name not in BUILTINS:
                raise Failure("R001", expr.name)
            return self.call_function(expr.name, [sight.this(frame)], {})
        return self.evaluate(expr, frame)

    def lookup(self, name: str, frame: Frame | None) -> tuple[Any, ...]:
        """What a bare name means: a tuple of its value, or of nothing."""
        for level in sight.frames(frame):
            if name in level.columns:
                return (self.alone(level.columns[name], replace(level, columns={})),)
            found = sight.in_query(level, name)
            if found:
                return found
        if name not in self.variables:
            return sight.undeclared(frame, name)
        value = self.variables[name]
        return (self.late(value, frame),) if isinstance(value, LateList) else (value,)

    def late(self, value: LateList, frame: Frame | None) -> Any:
        if sight.late_literal(value.literal, frame):
            raise Failure("R011", "the sources that the list mentions are not in sight")
        return self.evaluate(value.literal, frame)

    def source(self, name: str, frame: Frame | None) -> sight.Bound:
        bound = sight.source_named(frame, name)
        if bound is None:
            raise Failure("R003", name)
        return bound

    def choose(self, expr: ast.If, frame: Frame | None) -> Any:
        """IF: one branch, left to right; its last value. A missing then is True, a missing else False."""
        holds = bool(self.evaluate(expr.condition, frame))
        value: Any = holds
        for part in expr.then if holds else expr.otherwise:
            value = self.evaluate(part, frame)
        return value

    def assign(self, expr: ast.Assign, frame: Frame | None) -> Any:
        if sight.is_state(frame, expr.name):
            raise Failure("R007", expr.name)
        self.history.pop(expr.name, None)
        if sight.late_literal(expr.value, frame):
            assert isinstance(expr.value, ast.ListLiteral)
            self.variables[expr.name] = LateList(expr.value)
            return None
        value = self.evaluate(expr.value, frame)
        self.variables[expr.name] = fresh(value)
        return value

    # Functions

    def operate(self, function: str, operands: list[Any]) -> Any:
        """An operator; a function of the user with its name replaces it. `NOT IN` is the opposite of `IN`."""
        if function == "not_in":
            return not self.operate("in", operands)
        if function in self.functions:
            return self.call_user(function, operands, {})
        return sized(OPERATORS[function](*operands))

    def call(self, expr: ast.Call, frame: Frame | None) -> Any:
        if expr.function not in self.functions:
            if paths.is_path_function(self, expr):
                return paths.value(self, expr, frame)
            match expr.function:
                case "print":
                    return self.print_values([self.evaluate(argument, frame) for argument in expr.arguments])
                case "eval":
                    return self.eval_text(expr, frame)
                case "to":
                    groups.arity(expr, 2)
                    return self.evaluate(expr.arguments[0], frame)
                case "times":
                    groups.arity(expr, 1)
                    if not isinstance(expr.arguments[0], ast.Temporal):
                        raise Failure("R014", "times outside of a reading")
                    return self.temporal(expr.arguments[0], frame, 0)
                case "getTime":
                    groups.arity(expr, 0)
                    return self.now()
        if expr.star or expr.distinct:
            raise Failure("R008", "count(*) outside of GROUP BY")
        return self.call_function(expr.function, [self.evaluate(part, frame) for part in expr.arguments], {})

    def call_table(self, expr: ast.Call, frame: Frame | None) -> Any:
        """A call in FROM: `name = expr` is a named argument."""
        named = [part for part in expr.arguments if isinstance(part, ast.Assign)]
        if not named:
            return self.call(expr, frame)
        arguments = [self.evaluate(part, frame) for part in expr.arguments if not isinstance(part, ast.Assign)]
        return self.call_function(
            expr.function, arguments, {part.name: self.evaluate(part.value, frame) for part in named}
        )

    def call_function(self, name: str, arguments: list[Any], named: dict[str, Any]) -> Any:
        if name in self.functions:
            return self.call_user(name, arguments, named)
        if name in OPERATORS:
            if len(arguments) != (1 if name == "neg" else 2) or named:
                raise Failure("R005", name)
            return sized(OPERATORS[name](*arguments))
        if name not in BUILTINS:
            raise Failure("R002", name)
        least, most, function = BUILTINS[name]
        if not least <= len(arguments) <= most or named:
            raise Failure("R005", name)
        return sized(function(*arguments))

    def call_user(self, name: str, arguments: list[Any], named: dict[str, Any]) -> Any:
        """Calls a Python function with deep copies and takes its result in; its exceptions pass as they are."""
        function = self.functions[name]
        try:
            inspect.signature(function).bind(*arguments, **named)
        except TypeError as error:
            raise Failure("R005", name) from error
        except ValueError:
            pass  # a function without a signature
        self.calls[name] = self.calls.get(name, 0) + 1
        return incoming(function(*fresh(arguments), **fresh(named)))

    def print_values(self, values: list[Any]) -> Any:
        self.printed.append(" ".join(str(value) for value in values))
        return values[-1] if values else None

    def eval_text(self, expr: ast.Call, frame: Frame | None) -> Any:
        """`eval(text)`: the text's statements in the sight of the current row, the value of the last one."""
        groups.arity(expr, 1)
        text = self.evaluate(expr.arguments[0], frame)
        if not isinstance(text, str):
            raise Failure("X007", "eval reads a string")
        value: Any = None
        for statement in self.parsed(text, "<eval>").statements:
            value = self.evaluate(statement, frame)
        return value

    # Temporal variables

    def now(self) -> Any:
        return self.call_user("getTime", [], {}) if "getTime" in self.functions else self.clock()

    def temporal(self, expr: ast.TemporalAssign | ast.Temporal, frame: Frame | None, part: int = 1) -> Any:
        if isinstance(expr, ast.TemporalAssign):
            keep, value = self.evaluate(expr.keep, frame), self.evaluate(expr.value, frame)
            history = self.history.setdefault(expr.name, History())
            history.store(self.now(), keep, fresh(value))
            self.variables[expr.name] = fresh(value)
            return value
        if expr.name not in self.history:
            raise Failure("R001", f"{expr.name} has no history")
        when = None if expr.when is None else self.evaluate(expr.when, frame)
        return self.history[expr.name].read(self.now(), when, part)


class History:
    """The values of a temporal variable with their times, oldest first."""

    def __init__(self) -> None:
        self.keep: float = 0
        self.entries: list[tuple[float, Any]] = []

    def store(self, now: float, keep: float, value: Any) -> None:
        self.keep = keep
        self.entries.append((float(now), value))

    def since(self, start: float) -> list[tuple[float, Any]]:
        """The entries that were stored or in force at `start` or later: the last one always is."""
        ends = [time for time, _ in self.entries[1:]]
        return [entry for entry, end in zip(self.entries, ends, strict=False) if end >= start] + self.entries[-1:]

    def read(self, now: float, when: float | None, part: int) -> Any:
        """`v{}`, `v{-seconds}` or `v{time}` at the time `now`: the values, or their times where `part` is 0."""
        self.entries = self.since(now - self.keep)
        if when is None:
            return [entry[part] for entry in self.entries]
        if when < 0:
            return [entry[part] for entry in self.since(now + when)]
        before = [entry[part] for entry in self.entries if entry[0] <= when]
        return before[-1] if before else None


def _aggregate(node: ast.Call, values: Sequence[Any]) -> Any:
    """An aggregate of the values; what else stands in the call is a literal."""
    return aggregate(node.function, values, *(one.value for one in node.arguments[1:] if isinstance(one, ast.Literal)))


def in_group(expr: ast.Expr, group: sight.Group) -> tuple[Any, ...]:
    """A key or an aggregate of GROUP BY while the row of a group is made: a tuple of its value, or of nothing."""
    for node, values in group.aggregates:
        if node is expr:
            for failed in (value for value in values if isinstance(value, groups.Failed)):
                raise failed.reason
            if node.distinct:
                values = tuple(
                    value for at, value in enumerate(values) if not any(map(equal, values[:at], [value] * at))
                )
            return (len(values) if node.star else _aggregate(node, values),)
    for key, value in group.keys:
        if same(key, expr):
            return (value,)
    return ()


def same(left: ast.Expr, right: ast.Expr) -> bool:
    """Whether two expressions are the same text; unlike the trees' own equality this tells 1, 1.0 and True apart."""
    return repr(left) == repr(right)
