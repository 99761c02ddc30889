"""Laws: how the answers of two strategies to the same search are related, and whether they obey."""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Iterable, Sequence
from functools import cached_property
from itertools import pairwise
from typing import Any, TypeAlias

from ss2sql.bench.strategies import WEIGHTS, Strategy
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language.values import make_hashable

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
    """The paths that a strategy has found. `bound` is that of MEMORIZE, `cut`: there may be more than these.

    `sorted`: the query fixes their order.
    """

    strategy: Strategy
    rows: Sequence[Sequence[Sequence[Any]]]
    bound: int | None = None
    cut: bool = False
    sorted: bool = False

    @cached_property
    def paths(self) -> list[Path]:
        return [tuple(tuple(map(make_hashable, row)) for row in path) for path in self.rows]

    @cached_property
    def ends(self) -> Counter[Hashable]:
        return Counter(path[-1] for path in self.paths)


def is_identical(one: Any, other: Any) -> bool:
    """Whether two values are identical, unlike 1 and 1.0."""
    if isinstance(one, (list, tuple)):
        return type(one) is type(other) and len(one) == len(other) and all(map(is_identical, one, other))
    if isinstance(one, dict):
        return isinstance(other, dict) and is_identical(list(one.items()), list(other.items()))
    return one is other or (type(one) is type(other) and make_hashable(one) == make_hashable(other))


def find_broken_rule(answer: Answer) -> str | None:
    """The law of its own strategy that an answer breaks, if any."""
    rule, lengths = answer.strategy.repeats, [len(path) for path in answer.paths]
    if rule and any(len(set(path)) < len(path) for path in answer.paths):
        return f"a row repeats on a path of {rule}"
    if rule == "UNIQUE" and any(count > 1 for count in answer.ends.values()):
        return "UNIQUE reaches a row twice"
    if answer.bound is not None and any(length > answer.bound for length in lengths):
        return f"MEMORIZE {answer.bound} gives a longer path"
    by_length = answer.strategy.order == "BREADTH FIRST" or (rule == "MEMORIZE" and not _is_weighted(answer))
    if by_length and not answer.sorted and any(a > b for a, b in pairwise(lengths)):
        return f"{rule if rule == 'MEMORIZE' else 'BREADTH FIRST'} gives a longer path before a shorter one"
    return None


def compare_answers(own: Answer, other: Answer, unnamed: Sequence[str]) -> Verdict:
    """The verdict on a strategy's answer beside that of the script's own strategy.

    `unnamed` is what other clauses read beside SELECT, see ss2sql/language/step_identity.py: with any of it the
    language promises nothing for MEMORIZE, nor which rows UNIQUE reaches.
    """
    broken = find_broken_rule(other)
    if broken is not None:
        return Verdict(broken, True)
    if own.paths == other.paths:
        return SAME
    if own.cut or other.cut:
        return _compare_selections(own, other)
    wrong = _find_difference(own, other, settled=not unnamed)
    if wrong is not None:
        return Verdict(wrong, True)
    if Counter(own.paths) == Counter(other.paths):
        return REORDERED
    if not unnamed or _find_difference(own, other, settled=True) is None:
        return Verdict(_describe_difference(own, other))
    return Verdict(f"{_count_paths(other)}: SELECT does not name {', '.join(unnamed)}")


def compare_group_rows(own: Sequence[Sequence[Any]], other: Sequence[Sequence[Any]]) -> Verdict:
    """The verdict on rows of groups from another order of the same search, on which sums of floats may depend."""
    one, two = ([tuple(map(make_hashable, row)) for row in rows] for rows in (own, other))
    if one == two:
        return SAME
    if Counter(one) == Counter(two):
        return REORDERED
    rounded = any(type(value) is float for row in (*own, *other) for value in row)
    return Verdict("other rows: sums of floats depend on the order" if rounded else "other rows", not rounded)


def _is_weighted(answer: Answer) -> bool:
    return answer.strategy.order in WEIGHTS


def _compare_selections(own: Answer, other: Answer) -> Verdict:
    """The verdict on two answers of which one was cut: strategies with the same paths have the same number."""
    same_rule = own.strategy.repeats == other.strategy.repeats and own.strategy.repeats in ("", "NO CYCLE")
    dropping = "PROBABILITY" in (own.strategy.order, other.strategy.order)
    if same_rule and not dropping and own.cut and other.cut and len(own.paths) != len(other.paths):
        return Verdict(f"{_count_paths(other)}, not {len(own.paths):,}", True)
    if own.cut and other.cut and Counter(own.paths) == Counter(other.paths):
        return REORDERED
    shared = (Counter(own.paths) & Counter(other.paths)).total()
    return Verdict(f"the first {_count_paths(other)} of this order, {shared:,} the same")


def _find_difference(own: Answer, other: Answer, settled: bool) -> str | None:
    """How two complete answers contradict each other; `settled`: equal rows have equal stops, goals, next states."""
    if "UNIQUE" in (own.strategy.repeats, other.strategy.repeats):
        unique, wider = (own, other) if own.strategy.repeats == "UNIQUE" else (other, own)
        return _contradicts_unique(unique, wider, settled)
    if "MEMORIZE" in (own.strategy.repeats, other.strategy.repeats) and not settled:
        return None
    one, two = _select_allowed(other, own.paths), _select_allowed(own, other.paths)
    if not _drops_steps(other) and (missing := one - two):
        return f"{_format_count(missing)} missing"
    if not _drops_steps(own) and (new := two - one):
        return f"{_format_count(new)} too many"
    return None


def _contradicts_unique(unique: Answer, wider: Answer, settled: bool) -> str | None:
    """A contradiction to the law that UNIQUE finds some of the paths, one to every row."""
    if wider.strategy.repeats in ("", "NO CYCLE") and not _drops_steps(wider):
        foreign = set(unique.paths) - set(wider.paths)
        if foreign:
            return f"{_format_count(foreign)} of UNIQUE that {wider.strategy.name} does not have"
    if settled and not _drops_steps(unique):
        missing = wider.ends.keys() - unique.ends.keys()
        if missing:
            return f"UNIQUE does not reach {_format_count(missing, 'row')}"
    if settled and wider.strategy.repeats != "MEMORIZE" and not _drops_steps(wider):
        new = unique.ends.keys() - wider.ends.keys()
        if new:
            return f"UNIQUE reaches {_format_count(new, 'row')} more"
    return None


def _drops_steps(answer: Answer) -> bool:
    """Whether the strategy leaves out steps that others take: those of probability 0."""
    return answer.strategy.order == "PROBABILITY"


def _select_allowed(answer: Answer, paths: Iterable[Path]) -> Counter[Path]:
    """The paths that the strategy of an answer could find."""
    bound = answer.bound
    simple = bool(answer.strategy.repeats)
    return Counter(
        path for path in paths if (bound is None or len(path) <= bound) and (not simple or len(set(path)) == len(path))
    )


def _describe_difference(own: Answer, other: Answer) -> str:
    """A difference that the language allows, in words."""
    here, there = len(own.paths), len(other.paths)
    if own.strategy.repeats == other.strategy.repeats == "UNIQUE":
        return "other paths to the same rows"
    if here == there:
        return "other paths"
    if there > here:
        return f"{_count_paths(other)}, as {other.strategy.name} finds more"
    why = {"UNIQUE": "one for each row", "NO CYCLE": "without repeated rows", "MEMORIZE": "without repeated rows"}
    return f"{there:,} of the {here:,}, {why.get(other.strategy.repeats, 'none of probability 0')}"


def _count_paths(answer: Answer) -> str:
    return f"{len(answer.paths):,} path{'' if len(answer.paths) == 1 else 's'}"


def _format_count(found: Counter[Path] | set[Any], word: str = "path") -> str:
    number = found.total() if isinstance(found, Counter) else len(found)
    return f"{number:,} {word}{'' if number == 1 else 's'}"
