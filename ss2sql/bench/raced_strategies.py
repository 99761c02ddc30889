"""Strategies for a search: the script's own, and those that find the same paths or a promised part of them."""

from __future__ import annotations

from collections.abc import Sequence

from ss2sql.errors import SessionError, Source
from ss2sql.fast_dataclasses import dataclass
from ss2sql.frontend.resolve.search_clauses import ORDERS, WEIGHTS
from ss2sql.frontend.syntax import ast
from ss2sql.frontend.syntax.parser import parse

QUERY_FRAME = ("SELECT this FROM [] START WITH x = 0 CONNECT BY ", " x = 0;")


@dataclass(frozen=True, slots=True)
class RacedStrategy:
    """Options of CONNECT BY, those that bound the results included."""

    options: tuple[ast.Option, ...]

    @property
    def texts(self) -> dict[str, str]:
        """The options as they are written, by their keywords."""
        words = {option.keyword: option.span.text.split() for option in self.options}
        return {keyword: " ".join([keyword, *text[len(keyword.split()) :]]) for keyword, text in words.items()}

    @property
    def order(self) -> str:
        """The order, also the default one."""
        return next((option.keyword for option in self.options if option.keyword in ORDERS), self._usual_order)

    @property
    def _usual_order(self) -> str:
        return "BREADTH FIRST" if self.repeats == "UNIQUE" else "DEPTH FIRST"

    @property
    def repeats(self) -> str:
        """What holds for rows that repeat: a keyword, or nothing where they are allowed."""
        return next((word for word in ("MEMORIZE", "UNIQUE", "NO CYCLE") if word in self.texts), "")

    @property
    def name(self) -> str:
        """The options as a script writes them, without a default order."""
        texts, order = self.texts, self.order
        words = [] if order in WEIGHTS or (self.repeats and order == self._usual_order) else [order]
        return " ".join(
            [*words, *(texts[word] for word in (*WEIGHTS, "HEURISTIC", self.repeats, "MAXIMUM") if word in texts)]
        )


def list_strategies(query: ast.Query, longest: int | None) -> list[RacedStrategy]:
    """The other strategies that keep the meaning of a search.

    A search with repeated rows also runs without them, and with each row once; a search without repeated rows keeps its
    rule. A cost or probability stays where the results are cut, since it chooses them. `longest` is the number of steps
    of the longest path that the search's own strategy has found, which bounds MEMORIZE; None if unknown.
    """
    own = RacedStrategy(query.options)
    texts = own.texts
    weight = texts.get("COST") or texts.get("PROBABILITY", "")
    orders = [f"{weight} {texts.get('HEURISTIC', '')}", weight] if weight else []
    if not weight or ("MAXIMUM" not in texts and query.limit is None):
        orders += ["", "DEPTH FIRST", "BREADTH FIRST"]
    by_name: dict[str, RacedStrategy] = {}
    for rule in _list_raced_repeats(own, bool(query.group)):
        bounded = f"MEMORIZE {longest}" if rule == "MEMORIZE" and longest else rule
        for order in orders if rule != "MEMORIZE" else [one for one in (weight, "") if one in orders]:
            strategy = parse_strategy(f"{order} {texts.get(rule, bounded)}", query.options)
            by_name.setdefault(strategy.name, strategy)
    by_name.pop(own.name, None)
    return list(by_name.values())


def _list_raced_repeats(own: RacedStrategy, grouped: bool) -> tuple[str, ...]:
    if grouped:
        return (own.repeats,)
    if own.repeats == "MEMORIZE":
        unbounded = own.texts["MEMORIZE"] == "MEMORIZE" or own.texts["MEMORIZE"].startswith("MEMORIZE BY")
        return ("MEMORIZE", "NO CYCLE", "UNIQUE") if unbounded else ("MEMORIZE", "UNIQUE")
    return {"": ("", "NO CYCLE", "UNIQUE", "MEMORIZE"), "NO CYCLE": ("NO CYCLE", "UNIQUE", "MEMORIZE")}.get(
        own.repeats, (own.repeats,)
    )


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
        options += tuple(option for option in own if option.keyword == "MAXIMUM")
    return RacedStrategy(options)
