"""Comparison of answers: equal for two engines, in words for two strategies."""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Sequence
from functools import cached_property
from typing import Any, TypeAlias

from ss2sql.bench.results import BenchResult
from ss2sql.bench.strategies import RacedStrategy
from ss2sql.conformance.check_world import tag_checked_value
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.plan_traversal import describe_unnamed, walk
from ss2sql.language.values import make_hashable
from ss2sql.results import count_words, get_result_paths
from ss2sql.results.result import Result

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

    `unnamed` is what other clauses read beside SELECT, see ss2sql/language/step_identity.py: with any of it the
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


class Comparer:
    """Compares each outcome with the first one, the reference, and with the same strategy on another engine."""

    def __init__(self, query: plan.Query | None, own: str) -> None:
        self.own = own  # the strategy of the script as written
        self.variation = None if query is None else find_reason_answers_differ(query)
        # What clauses read beside the rows, see ss2sql/language/step_identity.py.
        self.unnamed = () if query is None or query.search is None else describe_unnamed(query)
        self.reference: FinishedRun | None = None
        self._by_strategy: dict[str, FinishedRun] = {}

    def record_verdict(self, finished: FinishedRun) -> None:
        cell = finished.cell
        twin = self._by_strategy.setdefault(cell.strategy, finished)
        verdict = self._compare_reference(finished) if twin is finished else self._compare_twin(finished, twin)
        if verdict.forbidden and self.variation:
            verdict = Verdict(f"{verdict.words}; {self.variation}")
        cell.answer, cell.same, cell.forbidden = verdict.words, verdict.same, verdict.forbidden

    def _compare_twin(self, finished: FinishedRun, twin: FinishedRun) -> Verdict:
        """Compares with the same strategy on another engine, which must be equal, errors included."""
        if finished.failure == twin.failure != "":
            return Verdict("")
        if finished.failure or twin.failure:
            one, other = (finished, twin) if finished.failure else (twin, finished)
            return Verdict(f"it fails in {one.cell.engine} and not so in {other.cell.engine}", True)
        if _list_contents(finished.result) != _list_contents(twin.result):
            return Verdict(f"not what {twin.cell.engine} gives", True)
        return Verdict("same" if twin is self.reference else twin.cell.answer, same=twin.cell.same)

    def _compare_reference(self, finished: FinishedRun) -> Verdict:
        if finished.result is None:
            return Verdict("")
        if self.reference is None or self.reference.result is None:
            self.reference = finished
            return Verdict(AS_WRITTEN if finished.cell.strategy == self.own else REFERENCE, same=True)
        own, other = self.reference.answer, finished.answer
        if own is None or other is None:
            return compare_answer_groups(list(self.reference.result), list(finished.result))
        return compare_answers(own, other, self.unnamed)


def _list_contents(result: Result | None) -> Any:
    """What two engines have to agree on: rows or paths in their order, or a value, with their types."""
    assert result is not None
    answer = result.answer
    found = result.value if answer is None else [answer.rows.groups, *map(list, result)]
    return result.columns, result.status, tag_checked_value(found)
