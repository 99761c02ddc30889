"""Strategies for a search: the script's own, and those that find the same paths or a promised part of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ss2sql.errors import SessionError, Source
from ss2sql.fast_dataclasses import dataclass
from ss2sql.frontend.resolve.search_clauses import ORDERS, REPEATS
from ss2sql.frontend.syntax import ast
from ss2sql.frontend.syntax.parser import parse

WEIGHTS = ("COST", "PROBABILITY")
QUERY_FRAME = ("SELECT this FROM [] START WITH x = 0 CONNECT BY ", " x = 0;")


@dataclass(frozen=True, slots=True)
class RacedStrategy:
    """Options of CONNECT BY, those that bound the results included."""

    options: tuple[ast.Option, ...]

    def list_options(self, keyword: str) -> tuple[ast.Option, ...]:
        return tuple(option for option in self.options if option.keyword == keyword)

    def find_option(self, keyword: str) -> ast.Option | None:
        return next(iter(self.list_options(keyword)), None)

    @property
    def order(self) -> str:
        """The order, also the default one."""
        written = next((option.keyword for option in self.options if option.keyword in ORDERS), None)
        return written or ("BREADTH FIRST" if self.repeats == "UNIQUE" else "DEPTH FIRST")

    @property
    def repeats(self) -> str:
        """What holds for rows that repeat: a keyword, or nothing where they are allowed."""
        written = {option.keyword for option in self.options} & set(REPEATS)
        return next((word for word in ("MEMORIZE", "UNIQUE", "NO CYCLE") if word in written), "")

    @property
    def name(self) -> str:
        """The options as a script writes them, without a default order."""
        usual = "BREADTH FIRST" if self.repeats == "UNIQUE" else "DEPTH FIRST"
        words = [] if self.order in WEIGHTS or (self.repeats and self.order == usual) else [self.order]
        chosen = map(self.find_option, (*WEIGHTS, "HEURISTIC", self.repeats, "MAXIMUM"))
        return " ".join([*words, *(_format_raced_option(option) for option in chosen if option)])


def _format_raced_option(option: ast.Option) -> str:
    if option.argument is None:
        return option.keyword
    argument = option.argument
    if isinstance(argument, ast.Literal):
        return f"{option.keyword} {argument.value!r}"
    return f"{option.keyword} {' '.join(argument.span.text.split())}"


def list_strategies(query: ast.Query, longest: int | None) -> list[RacedStrategy]:
    """The other strategies that keep the meaning of a search.

    A search with repeated rows also runs without them, and with each row once; a search without repeated rows keeps its
    rule. A cost or probability stays where the results are cut, since it chooses them. `longest` is the number of steps
    of the longest path that the search's own strategy has found, which bounds MEMORIZE; None if unknown.
    """
    own = RacedStrategy(query.options)
    found: list[RacedStrategy] = []
    for rule in _list_raced_repeats(own, bool(query.group)):
        for order in _list_raced_orders(query, own):
            if rule == "MEMORIZE":
                if order and order[0].keyword not in WEIGHTS:
                    continue
                order = tuple(option for option in order if option.keyword != "HEURISTIC")
            options = (*order, *_make_repeats_options(query, own, rule, longest), *own.list_options("MAXIMUM"))
            found.append(RacedStrategy(options))
    by_name = {strategy.name: strategy for strategy in found}
    by_name.pop(own.name, None)
    return list(by_name.values())


def _list_raced_orders(query: ast.Query, own: RacedStrategy) -> Iterator[tuple[ast.Option, ...]]:
    weight = own.find_option("COST") or own.find_option("PROBABILITY")
    heuristic = own.find_option("HEURISTIC")
    if weight is not None:
        if heuristic is not None:
            yield weight, heuristic
        yield (weight,)
        if own.find_option("MAXIMUM") is not None or query.limit is not None:
            return
    yield ()
    yield (ast.Option("DEPTH FIRST", None, span=query.span),)
    yield (ast.Option("BREADTH FIRST", None, span=query.span),)


def _list_raced_repeats(own: RacedStrategy, grouped: bool) -> tuple[str, ...]:
    if grouped:
        return (own.repeats,)
    if own.repeats == "MEMORIZE":
        option = own.find_option("MEMORIZE")
        return ("MEMORIZE", "UNIQUE") if option and option.argument else ("MEMORIZE", "NO CYCLE", "UNIQUE")
    return {"": ("", "NO CYCLE", "UNIQUE", "MEMORIZE"), "NO CYCLE": ("NO CYCLE", "UNIQUE", "MEMORIZE")}.get(
        own.repeats, (own.repeats,)
    )


def _make_repeats_options(
    query: ast.Query, own: RacedStrategy, rule: str, longest: int | None
) -> tuple[ast.Option, ...]:
    if not rule:
        return ()
    bound = ast.Literal(longest, span=query.span) if rule == "MEMORIZE" and longest else None
    return own.list_options(rule) or (ast.Option(rule, bound, span=query.span),)


def parse_strategy(text: str, own: Sequence[ast.Option]) -> RacedStrategy:
    """The strategy that a user has written, `UNIQUE COST km`; the script's MAXIMUM stays unless it names one.

    Raises ParseError, and SessionError S002 for text with more than options in it.
    """
    start, end = QUERY_FRAME
    (statement, *others) = parse(Source(start + text + end, "--strategy")).statements
    whole = isinstance(statement, ast.Query) and [assign.name for assign in statement.connect] == ["x"]
    if not whole or others or not isinstance(statement, ast.Query):
        raise SessionError("S002", f"{text!r} is more than options of CONNECT BY", hints=("write UNIQUE, or COST km",))
    options = statement.options
    if not any(option.keyword == "MAXIMUM" for option in options):
        options += RacedStrategy(tuple(own)).list_options("MAXIMUM")
    return RacedStrategy(options)
