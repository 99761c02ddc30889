"""The runs of a comparison, for each statement that is a search."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import field, replace
from typing import Any

from ss2sql.bench.compare import Comparer, FinishedRun
from ss2sql.bench.results import BenchResult, BenchRules, compile_raced_statement, time_statement
from ss2sql.bench.strategies import RacedStrategy, list_strategies, parse_strategy
from ss2sql.errors import Cancelled, Error, OutOfSteps, SessionError, Source, Stopped, Timeout, UnsupportedError
from ss2sql.fast_dataclasses import dataclass
from ss2sql.frontend.resolve.resolver import resolve
from ss2sql.frontend.syntax import ast
from ss2sql.frontend.syntax.parser import parse
from ss2sql.language import plan
from ss2sql.language.cancellation import retry_with_stack
from ss2sql.language.plan_traversal import walk
from ss2sql.results import get_result_paths
from ss2sql.session.session import Session

NO_SEARCH = ""  # in place of a strategy


@dataclass(slots=True)
class StatementRuns:
    """The runs of one statement, `tree`, with its plan, its results so far, and notes."""

    session: Session
    rules: BenchRules
    tree: ast.Expr
    cells: list[BenchResult] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    reference: str | None = None

    @property
    def text(self) -> str:
        return " ".join(self.tree.span.text.split())

    @property
    def forbidden(self) -> list[BenchResult]:
        return [cell for cell in self.cells if cell.forbidden]

    @property
    def search(self) -> ast.Query | None:
        """The search of the statement, perhaps assigned to a variable."""
        tree = self.tree.value if isinstance(self.tree, ast.Assign) else self.tree
        return tree if isinstance(tree, ast.Query) and tree.searches else None

    def run_strategies(self) -> None:
        """Runs strategies on engines; their results are in `cells` as soon as they begin."""
        search = self.search
        own = RacedStrategy(search.options if search else ())
        name = own.name if search else NO_SEARCH
        compiled = compile_raced_statement(self.session, self.tree, "auto")
        comparer = Comparer(_find_raced_query(compiled.plan.statements[0].expr), name)
        self._run_strategy(own, name, comparer)
        if search is None:
            return
        for strategy in self._list_other_strategies(search, own, comparer):
            self._run_strategy(strategy, strategy.name, comparer)
        self._add_notes(own, comparer)

    def _list_other_strategies(self, search: ast.Query, own: RacedStrategy, comparer: Comparer) -> list[RacedStrategy]:
        """The strategies beside the script's own, whose longest path bounds MEMORIZE."""
        first = comparer.reference
        paths = get_result_paths(first.result) if first is not None and first.result is not None else None
        longest = max(map(len, paths), default=None) if paths is not None else None
        found: dict[str, RacedStrategy] = {}
        for text in self.rules.strategies:
            suited = list_strategies(search, longest) if text == "all" else [parse_strategy(text, search.options)]
            found.update((strategy.name, strategy) for strategy in suited)
        found.pop(own.name, None)
        return list(found.values())

    def _add_notes(self, own: RacedStrategy, comparer: Comparer) -> None:
        self.reference = None if comparer.reference is None else comparer.reference.cell.strategy
        if self.reference not in (None, own.name):
            self.notes.append(
                f"{own.name}, as written, did not finish, so the others are compared with {self.reference}."
            )
        if comparer.unnamed and any("SELECT does not name" in cell.answer for cell in self.cells):
            self.notes.append(
                "MEMORIZE and UNIQUE keep one state for each row: what they find is promised only where SELECT names "
                "all that STOP WITH, WHERE and CONNECT BY read."
            )

    def _run_strategy(self, strategy: RacedStrategy, name: str, comparer: Comparer) -> None:
        for engine in self.rules.engines:
            cell = BenchResult(name, engine)
            self.cells.append(cell)
            finished = self._run_on_engine(strategy, cell, comparer)
            if finished is not None:
                comparer.record_verdict(finished)

    def _run_on_engine(self, strategy: RacedStrategy, cell: BenchResult, comparer: Comparer) -> FinishedRun | None:
        """Runs a strategy on an engine and records the reason for a missing answer. Raises the script's first error."""
        engine: Any = cell.engine
        try:
            started = time.perf_counter()
            query = compile_raced_statement(self.session, self._build_variant(strategy), engine)
            cell.compile_seconds = time.perf_counter() - started
            result = time_statement(self.session, query, self.rules, cell)
        except UnsupportedError as error:
            cell.missing = error.message.rstrip(".")
        except Cancelled:
            cell.missing = "cancelled"
            raise
        except Stopped as stopped:
            cell.seconds.clear()
            paths = get_result_paths(stopped.partial) if stopped.partial is not None else None
            cell.missing = self._name_limit(stopped) + (f", {len(paths):,} paths by then" if paths else "")
        except Exception as error:
            if comparer.reference is None and cell.strategy == self.cells[0].strategy:
                raise
            kind = error.code if isinstance(error, Error) else type(error).__name__
            cell.missing = f"{kind}: {error.message if isinstance(error, Error) else error}"
            return FinishedRun(strategy, cell, None, None, kind)
        else:
            paths = get_result_paths(result)
            cell.paths, cell.rows = None if paths is None else len(paths), len(result)
            return FinishedRun(strategy, cell, _find_raced_query(query.plan.statements[0].expr), result)
        return None

    def _name_limit(self, stopped: Stopped) -> str:
        if isinstance(stopped, Timeout):
            return f"over {self.rules.timeout:g} s"
        if isinstance(stopped, OutOfSteps):
            return f"over {self.session.host.limits.max_steps:,} steps"
        return "out of memory"

    def _build_variant(self, strategy: RacedStrategy) -> ast.Expr:
        search, tree = self.search, self.tree
        if search is None:
            return tree
        changed = replace(search, options=strategy.options)
        return replace(tree, value=changed) if isinstance(tree, ast.Assign) else changed


def _find_raced_query(expr: plan.Expr) -> plan.Query | None:
    """The query of a statement, perhaps assigned to a variable."""
    value = expr.value if isinstance(expr, plan.Assign) else expr
    return value.query if isinstance(value, plan.Subquery) else None


def make_runs(session: Session, source: Source, rules: BenchRules) -> Iterator[StatementRuns]:
    """The runs of a script's statements in order; each has to run before the next one is requested.

    They are those of the searches, or of the last query where there is none. Other statements run once.
    Raises SessionError S002 where there is no query, and what compiling and running the script raises.
    """
    tree = parse(source)
    program = retry_with_stack(lambda: resolve(tree, session.host.make_catalog()))
    raced = _select_searches([statement.expr for statement in program.statements])
    for number, statement in enumerate(tree.statements[: raced[-1] + 1]):
        if number in raced:
            runs = StatementRuns(session, rules, statement)
            if runs.search is None and _has_raced_part(program.statements[number].expr, plan.Search):
                runs.notes.append("the search stands inside of another expression, so only the engines are raced.")
            yield runs
        if number < raced[-1]:
            compile_raced_statement(session, statement, "auto").run()


def _select_searches(statements: Sequence[plan.Expr]) -> list[int]:
    for kind in (plan.Search, plan.Query):
        found = [number for number, expr in enumerate(statements) if _has_raced_part(expr, kind)]
        if found:
            return found if kind is plan.Search else found[-1:]
    raise SessionError("S002", "the script has no query", hints=("bench races queries, searches above all",))


def _has_raced_part(expr: plan.Expr, kind: type) -> bool:
    return any(isinstance(node, kind) for node in walk(expr))
