"""The options of CONNECT BY: their meaning for a search, and their contradictions."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, get_args

from ss2sql import plan
from ss2sql.errors import ResolveError
from ss2sql.frontend import ast
from ss2sql.frontend.path_functions import says_path
from ss2sql.frontend.scope import Scope
from ss2sql.walk import sources_read

if TYPE_CHECKING:
    from ss2sql.frontend.resolve import Resolver

ORDERS = ("DEPTH FIRST", "BREADTH FIRST", "COST", "PROBABILITY")
REPEATS = ("NO CYCLE", "UNIQUE", "MEMORIZE")
RULES: tuple[tuple[str, plan.Repeats], ...] = (("NO CYCLE", "no cycle"), ("UNIQUE", "unique"), ("MEMORIZE", "memorize"))


def search_options(
    resolver: Resolver, tree: ast.Query, scope: Scope, outer: Scope | None, search: plan.Search
) -> plan.Search:
    """The search with the options of the query; contradictions are recorded as errors R010."""
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
    if "HEURISTIC" in given:
        order = "greedy"
    elif "UNIQUE" in given:
        order = "breadth first"
    for candidate in get_args(plan.Order):
        if candidate.upper() in given:
            order = candidate
    repeats: plan.Repeats = "allowed"
    by: tuple[ast.Expr, ...] = ()
    for word, rule in RULES:
        if word in given:
            repeats, by = rule, given[word].by
    scope.enter("BY")
    key = tuple(resolver.guarded(resolver.expression, part, scope) for part in by)
    own = {source.id for source in scope.sources}
    scope.enter("COST")
    return replace(
        search,
        key=key,
        by="row" if not key else "step" if any(sources_read(part) & own for part in key) else "state",
        order=order,
        repeats=repeats,
        weight=argument("COST", scope) or argument("PROBABILITY", scope),
        heuristic=argument("HEURISTIC", scope),
        bound=argument("MEMORIZE", outer),
        maximum=argument("MAXIMUM", outer),
    )


def with_compared_columns(resolver: Resolver, tree: ast.Query, query: plan.Query) -> plan.Query:
    """The query whose rows are compared without the columns that ask for the path."""
    search = query.search
    assert search is not None
    if search.repeats == "memorize":
        _check_memorize(resolver, tree)
    if search.repeats == "allowed" or search.key or not any(says_path(resolver, column) for column in tree.columns):
        return query
    pairs = zip(tree.columns, query.columns, strict=True)  # a star stands alone
    left = tuple(output.expr for column, output in pairs if not says_path(resolver, column))
    if not left:
        word = next(word for word, rule in RULES if rule == search.repeats)
        names = [name for name, _ in search.start if name.isidentifier()]
        columns = [name for source in query.sources for name, _ in source.columns or ()]
        by = (names or columns or ["x"])[0]
        message = f"{word} compares rows, and every column of SELECT asks for the path"
        resolver.errors.append(ResolveError("R010", message, query.columns[0].expr.span, (f"write {word} BY {by}",)))
    return replace(query, search=replace(search, key=left))


def _check_memorize(resolver: Resolver, tree: ast.Query) -> None:
    """Refuses path functions beside MEMORIZE outside the result: a step belongs to many paths."""
    asked = [tree.made, tree.first, tree.stop, tree.where, *(option.argument for option in tree.options)]
    asked += [*(assign.value for assign in tree.connect), *(key.expr for key in tree.siblings)]
    for expr in asked:
        if expr is not None and says_path(resolver, expr):
            message = "with MEMORIZE a step belongs to many paths, so only what is shown can ask for its path"
            hint = "write it in SELECT, GROUP BY, HAVING or ORDER BY, or write NO CYCLE in place of MEMORIZE"
            resolver.errors.append(ResolveError("R014", message, expr.span, (hint,)))


def outside(resolver: Resolver, tree: ast.Expr, outer: Scope | None, what: str) -> plan.Expr:
    """An expression that is evaluated once for the query, such as LIMIT; it sees none of its elements and columns."""
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
    for word in ("DEPTH FIRST", "BREADTH FIRST", "PROBABILITY", "MEMORIZE"):
        if "HEURISTIC" in given and "COST" not in given and word in given:
            reason = f"HEURISTIC without COST takes the smallest estimate first, so it does not go with {word}"
            hint = f"leave {word} out, or add COST expr, the cost of one step"
            if word in ORDERS:
                hint = "keep one of them"
            _contradiction(resolver, given["HEURISTIC"], given[word], reason, hint)


def _contradiction(resolver: Resolver, option: ast.Option, other: ast.Option, reason: str, hint: str) -> None:
    resolver.errors.append(ResolveError("R010", reason, option.span, (hint,), ((other.span, "the other one"),)))
