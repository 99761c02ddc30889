"""The options of CONNECT BY: which go together, and what they make of a search."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, get_args

from ss2sql import plan
from ss2sql.errors import ResolveError
from ss2sql.frontend import ast
from ss2sql.frontend.scope import Scope

if TYPE_CHECKING:
    from ss2sql.frontend.resolve import Resolver

ORDERS = tuple(order.upper() for order in get_args(plan.Order))
REPEATS = ("NO CYCLE", "UNIQUE", "MEMORIZE")


def search_options(
    resolver: Resolver, tree: ast.Query, scope: Scope, outer: Scope | None, search: plan.Search
) -> plan.Search:
    """The search with the options of the query; contradictions are kept as errors R010."""
    given: dict[str, ast.Option] = {}
    for option in tree.options:
        if option.keyword in given:
            _contradiction(resolver, option, given[option.keyword], f"{option.keyword} is given twice", "write it once")
        given.setdefault(option.keyword, option)
    _check(resolver, given)

    def argument(keyword: str, sight: Scope | None) -> plan.Expr | None:
        option = given.get(keyword)
        if option is None or option.argument is None:
            return None
        if sight is outer:
            return outside(resolver, option.argument, outer, keyword)
        return resolver.guarded(resolver.expression, option.argument, sight)

    order: plan.Order = "depth first"
    if "UNIQUE" in given:
        order = "breadth first"
    for candidate in get_args(plan.Order):
        if candidate.upper() in given:
            order = candidate
    repeats: plan.Repeats = "allowed"
    for option_word, rule in (("NO CYCLE", "no cycle"), ("UNIQUE", "unique"), ("MEMORIZE", "memorize")):
        if option_word in given:
            repeats = rule  # type: ignore[assignment]
    return replace(
        search,
        order=order,
        repeats=repeats,
        weight=argument("COST", scope) or argument("PROBABILITY", scope),
        heuristic=argument("HEURISTIC", scope),
        bound=argument("MEMORIZE", outer),
        maximum=argument("MAXIMUM", outer),
    )


def outside(resolver: Resolver, tree: ast.Expr, outer: Scope | None, what: str) -> plan.Expr:
    """What is read once for the whole query, as LIMIT is: its elements and columns are not in sight."""
    before = len(resolver.errors)
    found = resolver.guarded(resolver.expression, tree, outer)
    for error in resolver.errors[before:]:
        once = f"{what} is read once, before there is an element"
        if error.code == "R014":
            error.hints = (once,)
        elif error.code == "R001":
            error.with_hint(once)
    return found


def _check(resolver: Resolver, given: dict[str, ast.Option]) -> None:
    orders = [given[word] for word in ORDERS if word in given]
    for option in orders[1:]:
        reason = f"{orders[0].keyword} and {option.keyword} are two orders of the same search"
        _contradiction(resolver, option, orders[0], reason, "keep one of them")
    repeats = [given[word] for word in REPEATS if word in given]
    if "MEMORIZE" in given:
        for option in repeats[:-1]:
            reason = f"MEMORIZE already yields paths without a repeated row, so {option.keyword} does not go with it"
            _contradiction(resolver, given["MEMORIZE"], option, reason, "keep one of them")
        for word in ("DEPTH FIRST", "BREADTH FIRST"):
            if word in given:
                reason = "MEMORIZE yields its paths shortest first, so it takes no order"
                _contradiction(resolver, given[word], given["MEMORIZE"], reason, f"leave {word} out")
    if "HEURISTIC" in given and "COST" not in given:
        error = ResolveError(
            "R010",
            "HEURISTIC is a lower bound of the remaining cost and needs COST",
            given["HEURISTIC"].span,
            ("add COST expr, the cost of one step",),
        )
        resolver.errors.append(error)


def _contradiction(resolver: Resolver, option: ast.Option, other: ast.Option, reason: str, hint: str) -> None:
    resolver.errors.append(ResolveError("R010", reason, option.span, (hint,), ((other.span, "the other one"),)))
