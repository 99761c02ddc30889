"""What the language promises of the paths that two strategies of one search find."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import pairwise

from ss2sql.bench.runs import Answer
from ss2sql.bench.strategies import WEIGHTS
from ss2sql.frontend.syntax import ast


def bound_of(answer: Answer) -> int | None:
    """The bound of MEMORIZE, where it is a number."""
    option = answer.strategy.find_option("MEMORIZE")
    argument = None if option is None else option.argument
    return argument.value if isinstance(argument, ast.Literal) else None


def broken_law(own: Answer, other: Answer, unnamed: Sequence[str], ordered: bool = True) -> str | None:
    """The law that `other` breaks, alone or beside an answer of the script's own strategy, if any.

    `unnamed` as in `compare_answers`. `ordered`: the order is the search's own.
    """
    rule, order, bound = other.strategy.repeats, other.strategy.order, bound_of(other)
    lengths = [len(path) for path in other.paths]
    if rule and any(len(set(path)) < len(path) for path in other.paths):
        return "a row repeats on a path"
    if rule == "UNIQUE" and len(other.ends) < len(other.paths):
        return "a row is reached twice"
    if bound is not None and max(lengths, default=0) > bound:
        return "longer than its bound"
    by_length = order == "BREADTH FIRST" or (rule == "MEMORIZE" and order not in WEIGHTS)
    if ordered and by_length and any(a > b for a, b in pairwise(lengths)):
        return "a longer path before a shorter one"
    dropping = [one.strategy.order == "PROBABILITY" for one in (own, other)]  # steps of probability 0
    if own.cut or other.cut:
        same = own.strategy.repeats == rule and rule in ("", "NO CYCLE") and own.cut and other.cut
        return "another number" if same and not any(dropping) and len(own.paths) != len(other.paths) else None
    if "UNIQUE" in (own.strategy.repeats, rule):
        unique, wider = (own, other) if own.strategy.repeats == "UNIQUE" else (other, own)
        return broken_by_unique(unique, wider, settled=not unnamed)
    if "MEMORIZE" in (own.strategy.repeats, rule) and unnamed:
        return None
    one, two = allowed(other, own.paths), allowed(own, other.paths)
    return "other paths" if (one - two and not dropping[1]) or (two - one and not dropping[0]) else None


def broken_by_unique(unique: Answer, wider: Answer, settled: bool) -> str | None:
    """UNIQUE finds some of the paths, one to every row; `settled`: equal rows go on equally."""
    whole, every = (one.strategy.order != "PROBABILITY" for one in (unique, wider))
    if every and wider.strategy.repeats in ("", "NO CYCLE") and set(unique.paths) - set(wider.paths):
        return "a path of UNIQUE that there is not"
    if settled and whole and wider.ends - unique.ends:
        return "a row is not reached"
    if settled and every and wider.strategy.repeats != "MEMORIZE" and unique.ends - wider.ends:
        return "a row that there is not"
    return None


def allowed(answer: Answer, paths: Iterable[tuple]) -> Counter:
    """The paths that the strategy of an answer could find."""
    bound, simple = bound_of(answer), bool(answer.strategy.repeats)
    return Counter(p for p in paths if (bound is None or len(p) <= bound) and (not simple or len(set(p)) == len(p)))
