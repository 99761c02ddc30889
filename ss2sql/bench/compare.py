"""Comparison of answers: equal for two engines, in words for two strategies."""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Sequence
from dataclasses import field
from functools import cached_property
from typing import Any, TypeAlias

from ss2sql.bench.results import BenchResult
from ss2sql.bench.strategies import RacedStrategy
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.plan_traversal import walk
from ss2sql.language.rows import Row
from ss2sql.language.step_identity import describe_unnamed
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


def are_answers_identical(one: Any, other: Any) -> bool:
    """Whether two values are identical, unlike 1 and 1.0."""
    if isinstance(one, (list, tuple)):
        return type(one) is type(other) and len(one) == len(other) and all(map(are_answers_identical, one, other))
    if isinstance(one, dict):
        return isinstance(other, dict) and are_answers_identical(list(one.items()), list(other.items()))
    return one is other or (type(one) is type(other) and make_hashable(one) == make_hashable(other))


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
    return Verdict(_describe_difference(own, other))


def compare_answer_groups(own: Sequence[Sequence[Any]], other: Sequence[Sequence[Any]]) -> Verdict:
    """The verdict on rows of groups from another order of the same search, on which sums of floats may depend."""
    one, two = ([tuple(map(make_hashable, row)) for row in rows] for rows in (own, other))
    if one == two:
        return SAME
    if Counter(one) == Counter(two):
        return REORDERED
    rounded = any(type(value) is float for row in (*own, *other) for value in row)
    return Verdict("other rows: sums of floats depend on the order" if rounded else "other rows", not rounded)


def _describe_difference(own: Answer, other: Answer) -> str:
    """A difference that the language allows, in words."""
    here, there = len(own.paths), len(other.paths)
    if own.strategy.repeats == other.strategy.repeats == "UNIQUE":
        return "other paths to the same rows"
    if here == there:
        return "other paths"
    if there > here:
        return f"{count_words(len(other.paths), 'path')}, as {other.strategy.name} finds more"
    why = {"UNIQUE": "one for each row", "NO CYCLE": "without repeated rows", "MEMORIZE": "without repeated rows"}
    return f"{there:,} of the {here:,}, {why.get(other.strategy.repeats, 'none of probability 0')}"


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


@dataclass(frozen=True, slots=True)
class FinishedRun:
    """The outcome of a strategy on an engine: the result, or its error as text. `query` is its plan."""

    strategy: RacedStrategy
    cell: BenchResult
    query: plan.Query | None
    result: Result | None
    failure: str = ""

    @property
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
        return cls(
            own,
            find_reason_answers_differ(query) if query else None,
            describe_unnamed(query) if query and searched else (),
        )

    def record_verdict(self, finished: FinishedRun) -> None:
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
        if not _are_answers_equal(finished.result, twin.result):
            return Verdict(f"not what {twin.cell.engine} gives", True)
        return Verdict("same" if twin is self.reference else twin.cell.answer, same=twin.cell.same)

    def _compare_reference(self, finished: FinishedRun) -> Verdict:
        if finished.result is None:
            return Verdict("")
        answer = finished.answer
        if self.reference is None or self.reference.result is None:
            self.reference, self._answer = finished, answer
            return Verdict(AS_WRITTEN if finished.cell.strategy == self.own else REFERENCE, same=True)
        if answer is None or self._answer is None:
            return compare_answer_groups(list(self.reference.result), list(finished.result))
        return compare_answers(self._answer, answer, self.unnamed)


def _are_answers_equal(one: Result, other: Result) -> bool:
    """Whether two results are equal: rows or paths in the same order, or values."""
    if one.columns != other.columns or one.status != other.status:
        return False
    if one.answer is None or other.answer is None:
        return are_answers_identical(one.value, other.value)
    first, second = one.answer.rows, other.answer.rows
    if first.groups is not None and not are_answers_identical(first.groups, second.groups):
        return False
    if (first.paths is None) != (second.paths is None):
        return False
    if first.paths is None or second.paths is None:
        return _do_engines_agree_on_rows(first.rows or (), second.rows or ())
    return len(first.paths) == len(second.paths) and all(map(_do_engines_agree_on_rows, first.paths, second.paths))


def _do_engines_agree_on_rows(ours: Sequence[Row], theirs: Sequence[Row]) -> bool:
    return len(ours) == len(theirs) and all(
        are_answers_identical(list(one), list(other)) for one, other in zip(ours, theirs, strict=True)
    )
