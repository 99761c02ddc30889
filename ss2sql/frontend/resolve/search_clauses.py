"""The clauses of a search: its options, and the types of START WITH variables in all states.

The types are a fixpoint: CONNECT BY is resolved with assumed types, which grow until its values stay within them or
lose their bounds. In `x = x + dx` a number grows with every step, by a bounded amount, so its size follows from the
number of steps; types alone could not prove it, for each step would widen the bounds of the last one.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple, get_args

from ss2sql.errors import ResolveError
from ss2sql.frontend.resolve.from_clause import resolve_sources
from ss2sql.frontend.resolve.path_functions import calls_path_function
from ss2sql.frontend.resolve.scope import Scope
from ss2sql.frontend.syntax import ast
from ss2sql.language import plan
from ss2sql.language.kinds import ANY, Kind, Type, drop_bounds, is_supertype, make_list_type, unite
from ss2sql.language.plan_traversal import list_plan_choices, list_sources

if TYPE_CHECKING:
    from ss2sql.frontend.resolve.resolver import Resolver


# --- the types of START WITH variables, valid in the first state and in every one that CONNECT BY makes
# A round resolves FROM and CONNECT BY once more, and in nested queries the rounds multiply.
_ROUNDS = {1: 6, 2: 3}

# No path has more steps: each keeps its row until the search ends, at 100 bytes or more, so 2^36 of them take
# 6 TB (and at 0.3 us a step, which nothing here reaches, 6 hours).
STEPS = 2**36
# How far a number may grow. Integers of this size can be added without leaving 64 bits.
_LIMITS: dict[Kind, float] = {Kind.INT: 2**62, Kind.FLOAT: 1e300}


def infer_state_types(resolver: Resolver, tree: ast.Query, scope: Scope, start: Mapping[str, plan.Expr]) -> None:
    """Sets the types of the START WITH variables in `scope` that hold throughout the search."""
    first = {name: value.type for name, value in start.items()}
    scope.states.update(_find_fixpoint(resolver, tree, scope, first) or dict.fromkeys(first, ANY))


def _find_fixpoint(
    resolver: Resolver, tree: ast.Query, scope: Scope, first: Mapping[str, Type]
) -> dict[str, Type] | None:
    """Types that CONNECT BY stays within; None where some still change in the last round.

    A number that is `counted` may be anything up to the limit until its sum is known, in a round that assumes this.
    """
    types, counted = dict(first), set[Slot]()
    assigned = [assign.name for assign in tree.connect]
    candidates = {
        Slot(scope.query, name, at): part
        for name, kind in first.items()
        for at, part in _split_type(kind).items()
        if assigned.count(name) == 1 and part.kinds in _LIMITS and part.is_bounded(_LIMITS[part.kinds])
    }
    rounds = _ROUNDS.get(scope.depth, 0)
    patience = rounds // 3
    for number in range(rounds):
        far = {slot: Type(kind.kinds, -_LIMITS[kind.kinds], _LIMITS[kind.kinds]) for slot, kind in candidates.items()}
        assumed = {name: _put_parts(name, kind, {slot: far[slot] for slot in counted}) for name, kind in types.items()}
        proved, settled = dict[Slot, Type](), True
        for name, value in _resolve_connect(resolver, tree, scope, assumed):
            if name not in types:
                continue
            for slot in [slot for slot in candidates if slot.name == name]:
                total = _sum_up(value, slot, candidates[slot], number < patience)
                if total is not None:
                    proved[slot] = total
                elif slot in counted:
                    del candidates[slot]
                    counted.discard(slot)
                    settled = False
            kind = _put_parts(name, value.type, {slot: far[slot] for slot in counted})
            if is_supertype(assumed[name], kind):
                continue
            settled = False
            counting = {slot for slot in proved if slot.name == name} - counted
            counted |= counting
            grown = unite((types[name], kind))
            types[name] = grown if counting or number < patience else drop_bounds(grown)
        if settled:
            return {name: _put_parts(name, kind, {s: proved[s] for s in counted}) for name, kind in assumed.items()}
    return None


class Slot(NamedTuple):
    """A number in the state: a START WITH variable, or the element at `position` of one that holds a short list."""

    query: int
    name: str
    position: int | None

    def is_read_by(self, expr: plan.Expr) -> bool:
        """Whether the expression is the number as it was before the step."""
        match expr:
            case plan.State(query=self.query, name=self.name):
                return self.position is None
            case plan.Call(
                function=plan.Function(name="item", builtin=True),
                arguments=(plan.State(query=self.query, name=self.name), plan.Constant(value=int(position))),
            ):
                return position == self.position
            case _:
                return False


def _split_type(kind: Type) -> dict[int | None, Type]:
    """The types of the elements of a short list by their positions; of any other type itself."""
    return dict(enumerate(kind.positions)) if kind.is_only(Kind.LIST) and kind.positions else {None: kind}


def _put_parts(name: str, kind: Type, known: Mapping[Slot, Type]) -> Type:
    """The type of a variable with these types of the numbers in it."""
    parts = _split_type(kind)
    changed = {slot.position: part for slot, part in known.items() if slot.name == name and slot.position in parts}
    if None in changed:
        return changed[None]
    return make_list_type([changed.get(at, part) for at, part in parts.items()]) if changed else kind


def _resolve_connect(
    resolver: Resolver, tree: ast.Query, scope: Scope, types: Mapping[str, Type]
) -> list[tuple[str, plan.Expr]]:
    """CONNECT BY with these types of variables. What else the resolver finds is forgotten."""
    attempt = scope.copy_scopes()
    attempt.states.update(types)
    errors = len(resolver.errors)
    stable = (dict(resolver.parameters), dict(resolver.tables), resolver.tentative, resolver.numbers)
    resolve_sources(resolver, tree, attempt)
    before = attempt.enter_clause("CONNECT BY")
    values = [(a.name, resolver.record_errors(resolver.resolve_expr, a.value, attempt)) for a in tree.connect]
    # A proof sees through the user's functions.
    connect = [(name, resolver.inliner.inline_calls(value)) for name, value in values]
    attempt.enter_clause(before)
    del resolver.errors[errors:]
    resolver.parameters, resolver.tables, resolver.tentative, resolver.numbers = stable
    return connect


def _sum_up(value: plan.Expr, slot: Slot, first: Type, hasty: bool) -> Type | None:
    """The type of a number that steps change by bounded amounts, or set to bounded values; None where none is proved.

    `hasty` sees plain sums alone: `max(x - 1, 0)` may stay within bounds that are closer.
    """
    if slot.position is not None:
        items = value.items if isinstance(value, plan.MakeList) else ()
        if slot.position >= len(items):
            return None
        value = items[slot.position]
    parts = tuple(_list_alternatives(value))
    if not value.type.is_only(first.kinds) or (hasty and len(parts) > 1):
        return None
    changes = [(_find_change(part, slot), part.type) for part in parts]
    least = min((change[0] for change, _ in changes if change is not None), default=0)
    most = max((change[1] for change, _ in changes if change is not None), default=0)
    fixed = unite((first, *(kind for change, kind in changes if change is None)))
    if fixed.low is None or fixed.high is None or least == most == 0:
        return None
    # Rounding changes a sum of floats by at most what was added.
    steps = STEPS * (4 if first.kinds == Kind.FLOAT else 1)
    found = Type(first.kinds, fixed.low + min(least, 0) * steps, fixed.high + max(most, 0) * steps)
    return found if found.is_bounded(_LIMITS[first.kinds]) else None


def _list_alternatives(expr: plan.Expr) -> Iterator[plan.Expr]:
    """The expressions of which the value is that of one."""
    match expr:
        case plan.If(then=then, otherwise=otherwise):
            for branch in (then, otherwise):
                yield from _list_alternatives(branch[-1])
        case plan.Call(function=plan.Function(name="min" | "max", builtin=True)) if choices := list_plan_choices(expr):
            for choice in choices:
                yield from _list_alternatives(choice)
        case _:
            yield expr


def _find_change(expr: plan.Expr, slot: Slot) -> tuple[float, float] | None:
    """What is added to the number at least and at most, where it is known to be a sum with it."""
    if slot.is_read_by(expr):
        return 0, 0
    match expr:
        case plan.Call(function=plan.Function(name="add", builtin=True), arguments=(left, right)):
            change, other = _find_change(left, slot), right.type
            if change is None:
                change, other = _find_change(right, slot), left.type
            if change is not None and other.low is not None and other.high is not None:
                return change[0] + other.low, change[1] + other.high
        case plan.Call(function=plan.Function(name="sub", builtin=True), arguments=(left, right)):
            change, other = _find_change(left, slot), right.type
            if change is not None and other.low is not None and other.high is not None:
                return change[0] - other.high, change[1] - other.low
    return None


# --- the options of CONNECT BY: their meaning for a search, and their contradictions
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
