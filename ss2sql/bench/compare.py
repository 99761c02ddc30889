"""Comparison of answers: equal for two engines, related by the language's laws for two strategies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field

from ss2sql.bench.laws import Answer, Verdict, compare_answers, compare_group_rows, find_broken_rule, is_identical
from ss2sql.bench.results import BenchResult
from ss2sql.bench.strategies import Strategy
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.plan_traversal import walk
from ss2sql.language.rows import Row
from ss2sql.language.step_identity import describe_unnamed
from ss2sql.results import get_paths
from ss2sql.results.result import Result


def find_variation(query: plan.Query) -> str | None:
    """The reason why two runs of a query may differ, or None."""
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


@dataclass(frozen=True, slots=True)
class FinishedRun:
    """The outcome of a strategy on an engine: the result, or its error as text. `query` is its plan."""

    strategy: Strategy
    cell: BenchResult
    query: plan.Query | None
    result: Result | None
    failure: str = ""

    @property
    def answer(self) -> Answer | None:
        """The paths of a search; None of anything else."""
        paths = None if self.result is None else get_paths(self.result)
        if self.result is None or paths is None or self.query is None or self.query.search is None:
            return None
        search = self.query.search
        bound = search.bound.value if isinstance(search.bound, plan.Constant) else None
        unbounded = search.bound is None or bound is not None
        cut = self.result.status == "maximum" or not _is_complete(self.query.limit, len(paths)) or not unbounded
        return Answer(self.strategy, paths, bound, cut, bool(self.query.order))


def _is_complete(limit: plan.Expr | None, number: int) -> bool:
    """Whether a limit has certainly cut nothing from so many results."""
    return limit is None or (isinstance(limit, plan.Constant) and type(limit.value) is int and limit.value > number)


@dataclass(slots=True)
class Comparer:
    """Compares each outcome with the first one, the reference, and with the same strategy on another engine."""

    own: str  # the strategy of the script as written
    variation: str | None  # the reason why two runs may differ
    unnamed: Sequence[str]  # what clauses read beside the rows, see ss2sql/language/step_identity.py
    reference: FinishedRun | None = None
    _answer: Answer | None = None
    _by_strategy: dict[str, FinishedRun] = field(default_factory=dict)

    @classmethod
    def for_query(cls, query: plan.Query | None, own: str) -> Comparer:
        searched = query is not None and query.search is not None
        return cls(own, find_variation(query) if query else None, describe_unnamed(query) if query and searched else ())

    def record_verdict(self, finished: FinishedRun) -> None:
        """Records the comparison of its answer in the result."""
        cell = finished.cell
        twin = self._by_strategy.setdefault(cell.strategy, finished)
        verdict = self._compare_reference(finished) if twin is finished else self._compare_twin(finished, twin)
        if verdict.forbidden and self.variation:
            verdict = Verdict(f"{verdict.words}; {self.variation}")
        cell.answer, cell.same, cell.forbidden = verdict.words, verdict.same, verdict.forbidden

    def _compare_twin(self, finished: FinishedRun, twin: FinishedRun) -> Verdict:
        """Compares with the same strategy on another engine, which must be equal, errors included."""
        if finished.failure or twin.failure:
            if finished.failure == twin.failure:
                return Verdict("")
            one = finished if finished.failure else twin
            other = twin if finished.failure else finished
            return Verdict(f"it fails in {one.cell.engine} and not so in {other.cell.engine}", True)
        assert finished.result is not None
        assert twin.result is not None
        if not _are_same(finished.result, twin.result):
            return Verdict(f"not what {twin.cell.engine} gives", True)
        return Verdict("same" if twin is self.reference else twin.cell.answer, same=twin.cell.same)

    def _compare_reference(self, finished: FinishedRun) -> Verdict:
        if finished.result is None:
            return Verdict("")
        answer = finished.answer
        if self.reference is None or self.reference.result is None:
            self.reference, self._answer = finished, answer
            broken = find_broken_rule(answer) if answer is not None else None
            words = AS_WRITTEN if finished.cell.strategy == self.own else REFERENCE
            return Verdict(words, same=True) if broken is None else Verdict(broken, True)
        if answer is None or self._answer is None:
            return compare_group_rows(list(self.reference.result), list(finished.result))
        return compare_answers(self._answer, answer, self.unnamed)


def _are_same(one: Result, other: Result) -> bool:
    """Whether two results are equal: rows or paths in the same order, or values."""
    if one.columns != other.columns or one.status != other.status:
        return False
    if one.answer is None or other.answer is None:
        return is_identical(one.value, other.value)
    first, second = one.answer.rows, other.answer.rows
    if first.groups is not None and not is_identical(first.groups, second.groups):
        return False
    if (first.paths is None) != (second.paths is None):
        return False
    if first.paths is None or second.paths is None:
        return _are_same_rows(first.rows or (), second.rows or ())
    return len(first.paths) == len(second.paths) and all(map(_are_same_rows, first.paths, second.paths))


def _are_same_rows(ours: Sequence[Row], theirs: Sequence[Row]) -> bool:
    return len(ours) == len(theirs) and all(
        is_identical(list(one), list(other)) for one, other in zip(ours, theirs, strict=True)
    )
