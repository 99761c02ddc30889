"""The runs of a comparison, for each statement that is a search: timed, their answers compared, and reported."""

from __future__ import annotations

import os
import platform
import time
from collections import Counter
from collections.abc import Hashable, Iterator, Mapping, Sequence
from contextlib import redirect_stdout
from dataclasses import asdict, field, replace
from functools import cached_property
from statistics import median
from typing import TYPE_CHECKING, Any, TypeAlias

import apsw

from ss2sql.bench.raced_strategies import RacedStrategy, list_strategies, parse_strategy
from ss2sql.conformance.check_world import tag_checked_value
from ss2sql.errors import Cancelled, Error, OutOfSteps, SessionError, Source, Stopped, Timeout, UnsupportedError
from ss2sql.fast_dataclasses import dataclass
from ss2sql.frontend.syntax import ast
from ss2sql.frontend.syntax.parser import parse
from ss2sql.language import plan
from ss2sql.language.plan_traversal import describe_unnamed, walk
from ss2sql.language.values import make_hashable
from ss2sql.results import count_words, cut_text, get_result_paths
from ss2sql.results.result import Result
from ss2sql.runtime.run.run_state import Run
from ss2sql.session.compiled_query import Engine
from ss2sql.session.compiled_script import Query, run_in_session
from ss2sql.session.session import Session
from ss2sql.session.variables import Variables

if TYPE_CHECKING:
    from rich.console import Console


# --- the comparison of answers: equal for two engines, in words for two strategies
Path: TypeAlias = tuple[tuple[Hashable, ...], ...]


@dataclass(frozen=True, slots=True)
class Verdict:
    """An answer in a few words: the `same` in any order, another one, or one that the language forbids."""

    words: str
    forbidden: bool = False
    same: bool = False


SAME = Verdict("same", same=True)
REORDERED = Verdict("same, other order", same=True)


@dataclass(frozen=True)
class Answer:
    """The paths that a strategy has found. `cut`: there may be more than these."""

    strategy: RacedStrategy
    rows: Sequence[Sequence[Sequence[Any]]]
    cut: bool = False

    @cached_property
    def paths(self) -> list[Path]:
        return [tuple(tuple(map(make_hashable, row)) for row in path) for path in self.rows]

    @cached_property
    def ends(self) -> set[Hashable]:
        return {path[-1] for path in self.paths}


def compare_answers(own: Answer, other: Answer, unnamed: Sequence[str]) -> Verdict:
    """How a strategy's answer differs from that of the script's own strategy.

    `unnamed` is what other clauses read beside SELECT, see `find_unnamed`: with any of it the
    language promises nothing for MEMORIZE, nor which rows UNIQUE reaches.
    """
    if own.paths == other.paths:
        return SAME
    shared = (Counter(own.paths) & Counter(other.paths)).total()
    if shared == len(own.paths) == len(other.paths):
        return REORDERED
    count = count_words(len(other.paths), "path")
    if own.cut or other.cut:
        return Verdict(f"the first {count} of this order, {shared:,} the same")
    rules = {own.strategy.repeats, other.strategy.repeats}
    if unnamed and rules & {"UNIQUE", "MEMORIZE"} and own.ends != other.ends:
        return Verdict(f"{count}: SELECT does not name {', '.join(unnamed)}")
    if len(own.paths) == len(other.paths):
        return Verdict("other paths")
    return Verdict(f"{len(other.paths):,} of the {len(own.paths):,}" if len(other.paths) < len(own.paths) else count)


def compare_answer_groups(own: Sequence[Sequence[Any]], other: Sequence[Sequence[Any]]) -> Verdict:
    """The verdict on rows of groups from another order of the same search, on which sums of floats may depend."""
    one, two = ([tuple(map(make_hashable, row)) for row in rows] for rows in (own, other))
    if one == two:
        return SAME
    if Counter(one) == Counter(two):
        return REORDERED
    rounded = any(type(value) is float for row in (*own, *other) for value in row)
    return Verdict("other rows: sums of floats depend on the order" if rounded else "other rows", not rounded)


def find_reason_answers_differ(query: plan.Query) -> str | None:
    for node in walk(query):
        match node:
            case plan.Call(function=function) if function.volatility == "volatile":
                return f"{function.name} is volatile"
            case plan.Assign(name=name) | plan.TemporalAssign(name=name):
                return f"it assigns {name}"
            case plan.Eval():
                return "it reads a text with eval"
    return None


AS_WRITTEN, REFERENCE = "as written", "the measure of the others"


@dataclass(frozen=True)
class FinishedRun:
    """The outcome of a strategy on an engine: the result, or its error as text. `query` is its plan."""

    strategy: RacedStrategy
    cell: BenchResult
    query: plan.Query | None
    result: Result | None
    failure: str = ""

    @cached_property
    def answer(self) -> Answer | None:
        """The paths of a search; None of anything else."""
        paths = None if self.result is None else get_result_paths(self.result)
        if self.result is None or paths is None or self.query is None or self.query.search is None:
            return None
        search = self.query.search
        unbounded = search.bound is None or isinstance(search.bound, plan.Constant)
        limit = self.query.limit
        known = isinstance(limit, plan.Constant) and type(limit.value) is int and limit.value > len(paths)
        cut = self.result.status == "maximum" or not (limit is None or known) or not unbounded
        return Answer(self.strategy, paths, cut)


def compare_engines(one: FinishedRun, other: FinishedRun) -> Verdict:
    """The verdict on the same strategy on another engine, which must be equal, errors included."""
    if one.failure == other.failure != "":
        return Verdict("")
    if one.failure or other.failure:
        failed, passed = (one, other) if one.failure else (other, one)
        return Verdict(f"it fails in {failed.cell.engine} and not so in {passed.cell.engine}", True)
    if _list_contents(one.result) != _list_contents(other.result):
        return Verdict(f"not what {other.cell.engine} gives", True)
    written = other.cell.answer in (AS_WRITTEN, REFERENCE)
    return Verdict("same" if written else other.cell.answer, same=other.cell.same)


def _list_contents(result: Result | None) -> Any:
    """What two engines have to agree on: rows or paths in their order, or a value, with their types."""
    assert result is not None
    answer = result.answer
    found = result.value if answer is None else [answer.rows.groups, *map(list, result)]
    return result.columns, result.status, tag_checked_value(found)


# --- the settings and the results of a comparison
@dataclass(frozen=True, slots=True)
class BenchRules:
    """The settings: engines, strategies, the number of runs after a first one, and a limit in seconds.

    `strategies` are options of CONNECT BY as a user writes them; "all" means all that suit the search.
    """

    engines: tuple[Engine, ...] = ("database", "native")
    strategies: tuple[str, ...] = ("all",)
    repeat: int = 5
    timeout: float = 10.0


@dataclass(slots=True)
class BenchResult:
    """The result of one strategy on one engine."""

    strategy: str
    engine: str
    seconds: list[float] = field(default_factory=list)  # of its runs
    compile_seconds: float | None = None
    paths: int | None = None  # None for statements that are no search
    rows: int | None = None
    steps: int = 0  # of one run
    calls: dict[str, int] = field(default_factory=dict)  # of one run
    answer: str = ""  # in a few words
    same: bool = False  # equals the answer of the script as written, in any order
    forbidden: bool = False  # the language forbids the answer
    missing: str | None = None  # the reason why there are no runs

    @property
    def name(self) -> str:
        return f"{self.strategy} in {self.engine}" if self.strategy else self.engine

    @property
    def best(self) -> float | None:
        return min(self.seconds, default=None)

    @property
    def middle(self) -> float | None:
        return median(self.seconds) if self.seconds else None

    def as_dict(self) -> dict[str, Any]:
        return asdict(self) | {"best": self.best, "median": self.middle}


# --- times one compiled statement
def compile_raced_statement(session: Session, statement: ast.Expr, engine: Engine) -> Query:
    """One statement, compiled for an engine. Raises the errors of compilation, such as UnsupportedError."""
    tree = ast.Script((statement,), span=statement.span)

    def compile_in_run(_: Run) -> Query:  # in which columns of files are read, so that their types are known
        program = session.host.resolve_script(tree, {}, "wrong")
        query = Query(session.host, session.execute, tree, program, engine)
        query.statements()
        return query

    return run_in_session(session.host, compile_in_run)


def time_statement(session: Session, query: Query, settings: BenchRules, cell: BenchResult) -> Result:
    """Runs a statement repeatedly, records the times in the cell, and gives the result of the first run.

    The first run has cold caches and does not count, unless it took more than half of the time limit. No further run
    begins after the limit. Every run starts with the variables of the first one.
    """
    before = dict(session.host.names.values)
    first, seconds = _run_once(query, settings)
    spent = seconds
    if seconds > settings.timeout / 2:
        cell.seconds.append(seconds)
    else:
        while len(cell.seconds) < settings.repeat and (spent < settings.timeout or not cell.seconds):
            _restore_variables(session.host.names, before)
            _, seconds = _run_once(query, settings)
            cell.seconds.append(seconds)
            spent += seconds
    stats = first.stats
    cell.steps, cell.calls = stats.generated, dict(stats.calls)
    return first


def _run_once(query: Query, settings: BenchRules) -> tuple[Result, float]:
    """One run, with the value that AS makes; the script's output is hidden."""
    with open(os.devnull, "w", encoding="utf-8") as nowhere, redirect_stdout(nowhere):
        started = time.perf_counter()
        result = query.run(timeout=settings.timeout)
        result.value  # noqa: B018 - the paths of a search are put together when they are read
        return result, time.perf_counter() - started


def _restore_variables(names: Variables, before: Mapping[str, Any]) -> None:
    for name in names.values.keys() - before.keys():
        names.forget_name(name)
    for name, value in before.items():
        if names.values.get(name) is not value:
            names.assign_value(name, value)


# --- the runs of a comparison, for each statement that is a search
NO_SEARCH = ""  # in place of a strategy


@dataclass(slots=True)
class StatementRuns:
    """The runs of one statement, `tree`, with its plan, its results so far, and notes."""

    session: Session
    rules: BenchRules
    tree: ast.Expr
    cells: list[BenchResult] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    finished: list[FinishedRun] = field(default_factory=list)  # one of each strategy
    variation: str | None = None  # why two runs may differ anyhow
    unnamed: Sequence[str] = ()  # see `compare_answers`

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

    @property
    def reference(self) -> FinishedRun | None:
        """The first run with a result, which the others are compared with."""
        return next((run for run in self.finished if run.result is not None), None)

    def run_strategies(self) -> None:
        """Runs strategies on engines; their results are in `cells` as soon as they begin."""
        search = self.search
        own = RacedStrategy(search.options if search else ())
        compiled = compile_raced_statement(self.session, self.tree, "auto")
        query = _find_raced_query(compiled.plan.statements[0].expr)
        if query is not None:
            self.variation = find_reason_answers_differ(query)
            self.unnamed = () if query.search is None else describe_unnamed(query)
        self._run_strategy(own, own.name if search else NO_SEARCH)
        if search is not None:
            for strategy in self._list_other_strategies(search, own):
                self._run_strategy(strategy, strategy.name)
            self._add_notes(own)

    def _list_other_strategies(self, search: ast.Query, own: RacedStrategy) -> list[RacedStrategy]:
        """The strategies beside the script's own, whose longest path bounds MEMORIZE."""
        first = self.reference
        paths = get_result_paths(first.result) if first is not None and first.result is not None else None
        longest = max(map(len, paths or ()), default=None)
        found: dict[str, RacedStrategy] = {}
        for text in self.rules.strategies:
            suited = list_strategies(search, longest) if text == "all" else [parse_strategy(text, search.options)]
            found.update((strategy.name, strategy) for strategy in suited)
        found.pop(own.name, None)
        return list(found.values())

    def _add_notes(self, own: RacedStrategy) -> None:
        first = own.name if self.reference is None else self.reference.cell.strategy
        if first != own.name:
            self.notes.append(f"{own.name}, as written, did not finish, so the others are compared with {first}.")
        if self.unnamed and any("SELECT does not name" in cell.answer for cell in self.cells):
            self.notes.append(
                "MEMORIZE and UNIQUE keep one state for each row: what they find is promised only where SELECT names "
                "all that STOP WITH, WHERE and CONNECT BY read."
            )

    def _run_strategy(self, strategy: RacedStrategy, name: str) -> None:
        for engine in self.rules.engines:
            cell = BenchResult(name, engine)
            self.cells.append(cell)
            finished = self._run_on_engine(strategy, cell)
            if finished is None:
                continue
            verdict = self._judge_run(finished)
            cell.answer, cell.same, cell.forbidden = verdict.words, verdict.same, verdict.forbidden
            if verdict.forbidden and self.variation:
                cell.answer, cell.forbidden = f"{verdict.words}; {self.variation}", False
            if all(one.cell.strategy != name for one in self.finished):  # the first of an engine is enough to compare
                self.finished.append(finished)

    def _judge_run(self, run: FinishedRun) -> Verdict:
        """Compares a run with the same strategy on another engine, or else with the reference."""
        twin = next((one for one in self.finished if one.cell.strategy == run.cell.strategy), None)
        if twin is not None:
            return compare_engines(run, twin)
        if run.result is None:
            return Verdict("")
        first = self.reference
        if first is None or first.result is None:
            return Verdict(AS_WRITTEN if run.cell.strategy == self.cells[0].strategy else REFERENCE, same=True)
        if first.answer is None or run.answer is None:
            return compare_answer_groups(list(first.result), list(run.result))
        return compare_answers(first.answer, run.answer, self.unnamed)

    def _run_on_engine(self, strategy: RacedStrategy, cell: BenchResult) -> FinishedRun | None:
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
            if self.reference is None and cell.strategy == self.cells[0].strategy:
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
    program = session.host.resolve_script(tree, {}, "wrong")
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


# --- the report of a comparison: a table for people, and data
MOST_TEXT = 90  # characters of a statement above its table


def compute_timing_ratios(results: Sequence[BenchResult]) -> list[float | None]:
    fastest = min((result.best for result in results if result.best is not None), default=None)
    return [result.best / fastest if result.best is not None and fastest else None for result in results]


def print_runs(runs: StatementRuns, console: Console) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table
    from rich.text import Text

    grouped = any(result.rows is not None and result.paths is None for result in runs.cells)
    counted = "rows" if grouped or runs.search is None else "paths"
    first = "strategy" if runs.search else ""
    heads = [first, "engine", "best ms", "median", "ratio", counted, "steps", "calls"]
    table = Table(box=SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=(0, 1, 0, 0))
    for number, head in enumerate(heads):
        table.add_column(head, justify="left" if number < 2 else "right", no_wrap=number > 0)
    table.add_column("answer", min_width=12)
    before = None
    for number, (result, ratio) in enumerate(zip(runs.cells, compute_timing_ratios(runs.cells), strict=True)):
        name = "" if result.strategy == before else result.strategy
        style = "bold red" if result.forbidden else "dim" if result.missing else ""
        answer = _format_answer(result, None if name else runs.cells[number - 1])
        table.add_row(*map(Text, (name, result.engine, *_format_timings(result, ratio), answer)), style=style)
        before = result.strategy
    title = f"{runs.tree.span.place}  {cut_text(runs.text, MOST_TEXT)}"
    console.print(title, markup=False, highlight=False, no_wrap=True, overflow="ellipsis")
    console.print(table)
    for line in (*_describe_fastest(runs), *_list_skipped_runs(runs.cells), *runs.notes):
        console.print(line, markup=False, highlight=False)


def _describe_fastest(runs: StatementRuns) -> list[str]:
    """The fastest with the same answer, and its speedup over the script as written."""
    same = [result for result in runs.cells if result.same and result.best]
    if len(same) < 2:
        return []
    winner, written = (
        min(found, key=lambda result: result.best or 0)
        for found in (same, [result for result in same if result.strategy == same[0].strategy])
    )
    gain = ""
    if winner is not written:
        gain = f", {(written.best or 0) / (winner.best or 1):.1f} times as fast as {written.name}"
    elif winner.strategy == runs.cells[0].strategy != "":
        gain = ", as it is written"
    return [f"Fastest with the same answer: {winner.name}{gain}."]


def _list_skipped_runs(results: Sequence[BenchResult]) -> list[str]:
    places: dict[str, list[str]] = {}
    for result in results:
        if result.missing is not None:
            places.setdefault(result.missing, []).append(result.name)
    return [f"Not run: {', '.join(found)}: {reason}." for reason, found in places.items()]


def _format_timings(result: BenchResult, ratio: float | None) -> list[str]:
    if result.best is None or result.middle is None or ratio is None:
        return [""] * 6
    rows = result.rows if result.paths is None else result.paths
    return [
        format_milliseconds(result.best),
        format_milliseconds(result.middle),
        f"{ratio:.1f}" if ratio < 100 else f"{ratio:,.0f}",
        f"{rows:,}",
        f"{result.steps:,}" if result.steps else "",
        f"{sum(result.calls.values()):,}" if result.calls else "",
    ]


def _format_answer(result: BenchResult, above: BenchResult | None) -> str:
    """The answer in a few words, unless the same strategy has it in the row above."""
    if above is not None and result.answer == above.answer and len(result.answer) > len(SAME.words):
        return f"as {above.engine}"
    return "FORBIDDEN: " * result.forbidden + result.answer or ("not run" if result.missing else "")


def format_milliseconds(seconds: float) -> str:
    value = seconds * 1000
    return f"{value:,.0f}" if value >= 1000 else f"{value:.3g}" if value >= 0.01 else f"{value:.4f}"


def collect_race_report(all_runs: Sequence[StatementRuns], settings: BenchRules) -> dict[str, Any]:
    from ss2sql import __version__

    machine = {
        "ss2sql": __version__, "python": platform.python_version(), "sqlite": apsw.sqlite_lib_version(),
        "machine": platform.machine(), "system": platform.system(),
    }  # fmt: skip
    statements = [
        {
            "place": runs.tree.span.place,
            "text": runs.tree.span.text,
            "reference": (runs.reference and runs.reference.cell.strategy) or None,
            "notes": runs.notes,
            "cells": [
                result.as_dict() | {"ratio": ratio}
                for result, ratio in zip(runs.cells, compute_timing_ratios(runs.cells), strict=True)
            ],
        }
        for runs in all_runs
    ]
    return {"on": machine, "repeat": settings.repeat, "timeout": settings.timeout, "statements": statements}
