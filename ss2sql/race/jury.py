"""Comparison of answers: equal for two engines, related by the language's laws for two strategies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field

from ss2sql import plan
from ss2sql.race.cells import Cell
from ss2sql.race.lineup import Strategy
from ss2sql.race.promises import Answer, Verdict, alike, broken_rule, compared, compared_rows
from ss2sql.records import dataclass
from ss2sql.results import found_paths
from ss2sql.runtime.result import Result
from ss2sql.runtime.rows import Row
from ss2sql.told import unnamed
from ss2sql.walk import walk


def whims(query: plan.Query) -> str | None:
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
class Finished:
    """The outcome of a strategy on an engine: the result, or its error as text. `query` is its plan."""

    strategy: Strategy
    cell: Cell
    query: plan.Query | None
    result: Result | None
    failure: str = ""

    @property
    def answer(self) -> Answer | None:
        """The paths of a search; None of anything else."""
        paths = None if self.result is None else found_paths(self.result)
        if self.result is None or paths is None or self.query is None or self.query.search is None:
            return None
        search = self.query.search
        bound = search.bound.value if isinstance(search.bound, plan.Constant) else None
        unbounded = search.bound is None or bound is not None
        cut = self.result.status == "maximum" or not _fits(self.query.limit, len(paths)) or not unbounded
        return Answer(self.strategy, paths, bound, cut, bool(self.query.order))


def _fits(limit: plan.Expr | None, number: int) -> bool:
    """Whether a limit has certainly cut nothing from so many results."""
    return limit is None or (isinstance(limit, plan.Constant) and type(limit.value) is int and limit.value > number)


@dataclass(slots=True)
class Jury:
    """Compares each outcome with the first one, the reference, and with the same strategy on another engine."""

    own: str  # the strategy of the script as written
    whim: str | None  # the reason why two runs may differ
    unnamed: Sequence[str]  # what clauses read beside the rows, see ss2sql/told.py
    reference: Finished | None = None
    _answer: Answer | None = None
    _by_strategy: dict[str, Finished] = field(default_factory=dict)

    @classmethod
    def of(cls, query: plan.Query | None, own: str) -> Jury:
        searched = query is not None and query.search is not None
        return cls(own, whims(query) if query else None, unnamed(query) if query and searched else ())

    def judge(self, finished: Finished) -> None:
        """Records the comparison of its answer in the result."""
        cell = finished.cell
        twin = self._by_strategy.setdefault(cell.strategy, finished)
        verdict = self._beside_reference(finished) if twin is finished else self._beside_twin(finished, twin)
        if verdict.forbidden and self.whim:
            verdict = Verdict(f"{verdict.words}; {self.whim}")
        cell.answer, cell.same, cell.forbidden = verdict.words, verdict.same, verdict.forbidden

    def _beside_twin(self, finished: Finished, twin: Finished) -> Verdict:
        """Compares with the same strategy on another engine, which must be equal, errors included."""
        if finished.failure or twin.failure:
            if finished.failure == twin.failure:
                return Verdict("")
            one = finished if finished.failure else twin
            other = twin if finished.failure else finished
            return Verdict(f"it fails in {one.cell.engine} and not so in {other.cell.engine}", True)
        assert finished.result is not None
        assert twin.result is not None
        if not _same(finished.result, twin.result):
            return Verdict(f"not what {twin.cell.engine} gives", True)
        return Verdict("same" if twin is self.reference else twin.cell.answer, same=twin.cell.same)

    def _beside_reference(self, finished: Finished) -> Verdict:
        if finished.result is None:
            return Verdict("")
        answer = finished.answer
        if self.reference is None or self.reference.result is None:
            self.reference, self._answer = finished, answer
            broken = broken_rule(answer) if answer is not None else None
            words = AS_WRITTEN if finished.cell.strategy == self.own else REFERENCE
            return Verdict(words, same=True) if broken is None else Verdict(broken, True)
        if answer is None or self._answer is None:
            return compared_rows(list(self.reference.result), list(finished.result))
        return compared(self._answer, answer, self.unnamed)


def _same(one: Result, other: Result) -> bool:
    """Whether two results are equal: rows or paths in the same order, or values."""
    if one.columns != other.columns or one.status != other.status:
        return False
    if one.answer is None or other.answer is None:
        return alike(one.value, other.value)
    first, second = one.answer.rows, other.answer.rows
    if first.groups is not None and not alike(first.groups, second.groups):
        return False
    if (first.paths is None) != (second.paths is None):
        return False
    if first.paths is None or second.paths is None:
        return _same_rows(first.rows or (), second.rows or ())
    return len(first.paths) == len(second.paths) and all(map(_same_rows, first.paths, second.paths))


def _same_rows(ours: Sequence[Row], theirs: Sequence[Row]) -> bool:
    return len(ours) == len(theirs) and all(
        alike(list(one), list(other)) for one, other in zip(ours, theirs, strict=True)
    )
