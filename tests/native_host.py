"""A small host for the native executor: scripts run through the frontend and the executor, without a session."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from ss2sql import plan
from ss2sql.errors import Error, ExecutionError, Source
from ss2sql.frontend.catalog import Catalog
from ss2sql.frontend.parser import parse
from ss2sql.frontend.resolve import resolve, resolve_text
from ss2sql.kinds import type_of
from ss2sql.runtime.builtins import BUILTINS
from ss2sql.runtime.functions import builtin_functions, user_function
from ss2sql.runtime.native import NativeQuery, compile_statement
from ss2sql.runtime.native.calls import native_callable
from ss2sql.runtime.rows import Rows
from ss2sql.runtime.run import Run
from ss2sql.runtime.shaping import Shapes, with_stars
from ss2sql.runtime.values import normalise
from ss2sql.vtables.memories import Memories


class FakeHost:
    """A host without a memo, so that every call that the executor makes is counted in `run.stats.calls`.

    `functions` are Python functions by name, `volatility` theirs where it is not immutable.
    """

    def __init__(
        self,
        functions: dict[str, Callable[..., Any]] | None = None,
        volatility: dict[str, plan.Volatility] | None = None,
        tables: dict[str, tuple[plan.TableSource, list[tuple[Any, ...]]]] | None = None,
        **variables: Any,
    ) -> None:
        self.functions = dict(functions or {})
        self.volatility = dict(volatility or {})
        self.tables = dict(tables or {})
        self.variables = {name: normalise(value, f"the variable '{name}'") for name, value in variables.items()}
        self.late: dict[str, Any] = {}
        self.kept: dict[str, list[Any]] = {}
        self.printed: list[tuple[Any, ...]] = []
        self.memories = Memories()
        self.graphs = None
        self.texts = 0  # how often a text was resolved
        self.reads = 0  # how often a table was read

    # --- what a run asks -------------------------------------------------------------------------------

    def variable(self, name: str, run: Run) -> Any:
        if name not in self.variables:
            raise ExecutionError("R001", f"the variable '{name}' has no value yet")
        return self.variables[name]

    def assign(self, name: str, value: Any) -> None:
        self.variables[name] = value

    def call(self, function: plan.Function, run: Run) -> Any:
        name = function.name
        if function.builtin:
            return BUILTINS[name].python or {"print": self.print, "getTime": lambda: 7.0}[name]
        entry = user_function(name, self.functions[name], self.volatility.get(name, "immutable"))
        known = run.callables[f"{name}, {len(run.callables)}"] = native_callable(entry, run, 0)
        return known

    def print(self, *values: Any) -> Any:
        self.printed.append(values)
        return values[-1]

    def resolve_text(self, text: str, scope: Any) -> tuple[plan.Expr, ...]:
        self.texts += 1
        return resolve_text(parse(Source(text, "<eval>")), scope, self.catalog())

    def bind_late(self, name: str, literal: Any) -> None:
        self.variables.pop(name, None)
        self.late[name] = literal

    def temporal(self, name: str, when: float | None) -> Any:
        return list(self.kept[name]) if when is None else self.kept[name][-1]

    def store_temporal(self, name: str, keep: Any, value: Any) -> None:
        self.kept.setdefault(name, []).append(value)
        self.variables[name] = value

    def shape(self, query: plan.Query, rows: Rows, arguments: tuple[Any, ...], named: dict[str, Any], run: Run) -> Any:
        return Shapes().of_inner(query, with_stars(query, rows), arguments, named, run.sizes)

    def table_rows(self, source: plan.TableSource) -> list[tuple[Any, ...]]:
        self.reads += 1
        return self.tables[source.table][1]

    # --- running ---------------------------------------------------------------------------------------

    def catalog(self) -> Catalog:
        functions = builtin_functions()
        for name in self.functions:
            volatility = self.volatility.get(name, "immutable")
            functions[name] = plan.Function(name, 0, None, volatility, builtin=False)
        return Catalog(
            functions,
            ("dict", "list", "rows", "value", "set", "void", "show"),
            self.variables,
            lambda name: type_of(self.variables[name]),
            lambda schema, name: self.tables[name][0] if name in self.tables else None,
            tuple(self.tables),
            late=self.late,
        )

    def start(self, **limits: Any) -> Run:
        return Run(self, **limits)

    def run(self, script: str, run: Run | None = None) -> Any:
        """The value of the last statement."""
        run = self.start() if run is None else run
        value = None
        for statement in resolve(parse(Source(script)), self.catalog()).statements:
            value = compile_statement(statement.expr)(run)
        return value

    def query(self, script: str) -> NativeQuery:
        """The script's only statement, a query, compiled."""
        (statement,) = resolve(parse(Source(script)), self.catalog()).statements
        assert isinstance(statement.expr, plan.Subquery)
        return NativeQuery(statement.expr.query)

    def error(self, script: str, run: Run | None = None) -> Error:
        """The error that a script ends with."""
        try:
            self.run(script, run)
        except Error as error:
            return error
        raise AssertionError(f"no error: {script}")


def place(error: Error) -> str:
    """`line:column` of an error, with the text that it points at."""
    assert error.span is not None
    return f"{error.span.line}:{error.span.column} {error.span.text}"


def generated_code(run: Callable[[], Any]) -> list[str]:
    """The code of each query that is compiled natively while a function runs, as text."""
    texts: list[str] = []
    made = NativeQuery.__init__

    def noted(self: NativeQuery, query: plan.Query) -> None:
        made(self, query)
        texts.append(self.source_text)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(NativeQuery, "__init__", noted)
        run()
    return texts
