"""The options of CONNECT BY: their meaning for a search, and their contradictions."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, get_args

from ss2sql.errors import ResolveError
from ss2sql.frontend.resolve.path_functions import calls_path_function
from ss2sql.frontend.resolve.scope import Scope
from ss2sql.frontend.syntax import ast
from ss2sql.language import plan
from ss2sql.language.plan_traversal import list_sources

if TYPE_CHECKING:
    from ss2sql.frontend.resolve.resolver import Resolver

ORDERS = tuple(order.upper() for order in get_args(plan.Order) if order != "greedy")
REPEATS = ("NO CYCLE", "UNIQUE", "MEMORIZE")
RULES: tuple[tuple[str, plan.Repeats], ...] = (("NO CYCLE", "no cycle"), ("UNIQUE", "unique"), ("MEMORIZE", "memorize"))


def resolve_search_options(
    resolver: Resolver, tree: ast.Query, scope: Scope, outer: Scope | None, search: plan.Search
) -> plan.Search:
    """The search with the options of the query; contradictions are recorded as errors R010."""
    options: dict[str, ast.Option] = {}
    for option in tree.options:
        if option.keyword in options:
            _contradict(resolver, option, options[option.keyword], f"{option.keyword} is given twice", "write it once")
        options.setdefault(option.keyword, option)
    _check_search_clauses(resolver, options)

    def resolve_argument(keyword: str, visible: Scope | None) -> plan.Expr | None:
        option = options.get(keyword)
        if option is None or option.argument is None:
            return None
        if visible is outer:
            return resolve_outside(resolver, option.argument, outer, keyword)
        return resolver.record_errors(resolver.resolve_expr, option.argument, visible)

    order: plan.Order = "depth first"
    if "HEURISTIC" in options:
        order = "greedy"
    elif "UNIQUE" in options:
        order = "breadth first"
    for candidate in get_args(plan.Order):
        if candidate.upper() in options:
            order = candidate
    repeats: plan.Repeats = "allowed"
    by: tuple[ast.Expr, ...] = ()
    for word, rule in RULES:
        if word in options:
            repeats, by = rule, options[word].by
    scope.enter_clause("BY")
    key = tuple(resolver.record_errors(resolver.resolve_expr, part, scope) for part in by)
    own = {source.id for source in scope.sources}
    scope.enter_clause("COST")
    return replace(
        search,
        key=key,
        by="row" if not key else "step" if any(list_sources(part) & own for part in key) else "state",
        order=order,
        repeats=repeats,
        weight=resolve_argument("COST", scope) or resolve_argument("PROBABILITY", scope),
        heuristic=resolve_argument("HEURISTIC", scope),
        bound=resolve_argument("MEMORIZE", outer),
        maximum=resolve_argument("MAXIMUM", outer),
    )


def resolve_without_path(resolver: Resolver, tree: ast.Query, query: plan.Query) -> plan.Query:
    """The query whose rows are compared without the columns that ask for the path."""
    search = query.search
    assert search is not None
    if search.repeats == "memorize":
        _check_memorize(resolver, tree)
    if (
        search.repeats == "allowed"
        or search.key
        or not any(calls_path_function(resolver, column) for column in tree.columns)
    ):
        return query
    pairs = zip(tree.columns, query.columns, strict=True)  # a star stands alone
    left = tuple(output.expr for column, output in pairs if not calls_path_function(resolver, column))
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
    evaluated = [tree.made, tree.first, tree.stop, tree.where, *(option.argument for option in tree.options)]
    evaluated += [*(assign.value for assign in tree.connect), *(key.expr for key in tree.siblings)]
    for expr in evaluated:
        if expr is not None and calls_path_function(resolver, expr):
            message = "with MEMORIZE a step belongs to many paths, so only what is shown can ask for its path"
            hint = "write it in SELECT, GROUP BY, HAVING or ORDER BY, or write NO CYCLE in place of MEMORIZE"
            resolver.errors.append(ResolveError("R014", message, expr.span, (hint,)))


def resolve_outside(resolver: Resolver, tree: ast.Expr, outer: Scope | None, what: str) -> plan.Expr:
    """An expression that is evaluated once for the query, such as LIMIT; it sees none of its elements and columns."""
    before = len(resolver.errors)
    found = resolver.record_errors(resolver.resolve_expr, tree, outer)
    for error in resolver.errors[before:]:
        once = f"{what} is read once, before there is an element"
        if error.code == "R014":
            error.hints = (once,)
        elif error.code == "R001":
            error.with_hint(once)
    return found


def _check_search_clauses(resolver: Resolver, options: dict[str, ast.Option]) -> None:
    orders = [options[word] for word in ORDERS if word in options]
    for option in orders[1:]:
        reason = f"{orders[0].keyword} and {option.keyword} are two orders of the same search"
        _contradict(resolver, option, orders[0], reason, "keep one of them")
    repeats = [options[word] for word in REPEATS if word in options]
    if "MEMORIZE" in options:
        for option in repeats[:-1]:
            reason = f"MEMORIZE already yields paths without a repeated row, so {option.keyword} does not go with it"
            _contradict(resolver, options["MEMORIZE"], option, reason, "keep one of them")
        for word in ("DEPTH FIRST", "BREADTH FIRST"):
            if word in options:
                reason = "MEMORIZE yields its paths shortest first, so it takes no order"
                _contradict(resolver, options[word], options["MEMORIZE"], reason, f"leave {word} out")
    for word in ("DEPTH FIRST", "BREADTH FIRST", "PROBABILITY", "MEMORIZE"):
        if "HEURISTIC" in options and "COST" not in options and word in options:
            reason = f"HEURISTIC without COST takes the smallest estimate first, so it does not go with {word}"
            hint = f"leave {word} out, or add COST expr, the cost of one step"
            if word in ORDERS:
                hint = "keep one of them"
            _contradict(resolver, options["HEURISTIC"], options[word], reason, hint)


def _contradict(resolver: Resolver, option: ast.Option, other: ast.Option, reason: str, hint: str) -> None:
    resolver.errors.append(ResolveError("R010", reason, option.span, (hint,), ((other.span, "the other one"),)))
