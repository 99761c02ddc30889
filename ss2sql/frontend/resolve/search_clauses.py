"""The clauses of a search: its options, its path functions, and the types of its variables.

All but `next` and `leaf` read hidden variables that the search carries beside those of START WITH. They are assigned
before CONNECT BY changes anything else:

    level()    START WITH "level()" = 1              CONNECT BY "level()" = "level()" + 1
    prior(e)   START WITH "prior(e)" = None          CONNECT BY "prior(e)" = e
    root(e)    START WITH "root(e)" = None           CONNECT BY "root(e)" = IF("level()" == 1; e; "root(e)")
    path(e)    START WITH "path(e)" = None           CONNECT BY "path(e)" = a cell of "path(e)" and e

An assignment of the script reads their values before the step, which `"level() before"` keeps: it is assigned first of
all. `path(e)` is a linked list, so that a step costs the same on paths of any length. `next(e)` is e with the
assignments of CONNECT BY in place of the variables, `leaf()` is a query for the next elements.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import field, replace
from itertools import combinations
from typing import TYPE_CHECKING, Any, NamedTuple, get_args

from ss2sql.errors import ResolveError, Span
from ss2sql.fast_dataclasses import dataclass
from ss2sql.frontend.resolve.from_clause import resolve_sources
from ss2sql.frontend.resolve.scope import CHOOSE_LEAVES, Scope, list_scopes
from ss2sql.frontend.syntax import ast
from ss2sql.language import plan
from ss2sql.language.kinds import ANY, BOOL, Kind, Type, drop_bounds, is_supertype, make_list_type, unite
from ss2sql.language.plan_traversal import (
    is_volatile,
    list_plan_choices,
    list_plan_functions,
    list_sources,
    rebuild_node,
    renumber_node,
    walk,
)
from ss2sql.language.rows import make_unique_name

if TYPE_CHECKING:
    from ss2sql.frontend.resolve.resolver import Resolver


# --- path functions: `level() prior(e) root(e) path(e) next(e) cycle(e) leaf()`
# The functions with the least and the greatest number of their arguments.
FUNCTIONS = {"level": (0, 0), "prior": (1, 1), "root": (1, 1), "path": (1, 2), "next": (1, 1), "cycle": (1, 1),
             "leaf": (0, 0)}  # fmt: skip
USAGE = {"level": "level()", "path": 'path(x) or path(x, "/")', "leaf": "leaf()"}
FORBIDDEN_CLAUSES = ("FROM", "START WITH", "BY")
RESULT_CLAUSES = ("SELECT", "GROUP BY", "HAVING", "ORDER BY")


@dataclass(slots=True)
class PathFunctions:
    """The path functions in the clauses of one search. `clause` is the one that is being resolved.

    `variables` are the names of the hidden variables, by the function and its argument, `before` those that keep their
    values before the step, for the assignments of CONNECT BY; `search` is the search as it is known after CONNECT BY.
    """

    variables: dict[tuple[str, ast.Expr | None], str] = field(default_factory=dict)
    before: dict[str, str] = field(default_factory=dict)
    clause: str = ""
    sources: tuple[plan.Source, ...] = ()
    search: plan.Search | None = None


def is_path_function(resolver: Resolver, tree: Any) -> bool:
    """Whether a call is one of these; a function that the user has registered comes first."""
    if not isinstance(tree, ast.Call) or tree.function not in FUNCTIONS or tree.owner is not None or tree.star:
        return False
    registered = resolver.catalog.functions.get(tree.function)
    return registered is None or registered.builtin


def add_path_variables(resolver: Resolver, tree: ast.Query) -> tuple[ast.Query, PathFunctions]:
    """The query with the hidden variables, and their names."""
    found = PathFunctions()
    calls = [node for node in ast.walk_syntax(tree, _is_other_search) if is_path_function(resolver, node)]
    # An outer call is assigned first, because it reads the inner one as it was before the step.
    calls.sort(key=lambda call: -_measure_prior_nesting(resolver, call))
    start: list[ast.Assign] = []
    connect: list[ast.Assign] = []
    for call in calls:
        argument = call.arguments[0] if call.arguments else None
        word = {"cycle": "path"}.get(call.function, call.function)
        key = (word, argument)
        if word not in ("prior", "root", "path") or argument is None or key in found.variables:
            continue
        _refuse_next_inside(resolver, word, argument)
        short = " ".join(argument.span.text.split())
        name = found.variables[key] = make_unique_name(f"{word}({short})", found.variables.values())
        itself, span = ast.Name(name, span=call.span), argument.span
        start.append(_make_assignment_syntax(name, ast.Literal(None, span=span)))
        value: ast.Expr = argument
        if word == "root":
            value = _make_first_step_syntax(argument, itself)
        elif word == "path":
            value = ast.Call("path cell", (itself, argument), span=span)
        connect.append(_make_assignment_syntax(name, value))
    if any(call.function in ("level", "root") for call in calls):
        call = next(call for call in calls if call.function in ("level", "root"))
        found.variables["level", None] = "level()"
        one = ast.Literal(1, span=call.span)
        count = ast.Operator("add", (ast.Name("level()", span=call.span), one), span=call.span, place=call.span)
        start.append(_make_assignment_syntax("level()", one))
        connect.append(_make_assignment_syntax("level()", count))
    if any(calls_path_function(resolver, assign.value) for assign in tree.connect):
        found.before = {assign.name: f"{assign.name} before" for assign in start}
        kept = [_make_assignment_syntax(found.before[a.name], ast.Name(a.name, span=a.span)) for a in start]
        start += [replace(assign, name=found.before[assign.name]) for assign in start]
        connect = [*kept, *connect]
    tree = replace(tree, start=(*tree.start, *start), connect=(*connect, *tree.connect))
    return tree, found


def _get_variable(said: PathFunctions, name: str) -> str:
    """The variable to read in the clause that is being resolved."""
    return said.before.get(name, name) if said.clause == "CONNECT BY" else name


def _refuse_next_inside(resolver: Resolver, word: str, argument: ast.Expr) -> None:
    """Raises ResolveError R014 for `path(next(x))`: what a path carries is assigned before CONNECT BY changes x."""
    for call in ast.walk_syntax(argument, _is_other_search):
        if is_path_function(resolver, call) and call.function == "next":
            hint = f"write what CONNECT BY assigns in place of {' '.join(call.span.text.split())}"
            raise ResolveError("R014", f"next does not stand in {word}(...)", call.span, (hint,))


def resolve_path_function(resolver: Resolver, tree: ast.Call, scope: Scope | None) -> plan.Expr:
    """The plan of a call of one of these functions."""
    own = next((level for level in list_scopes(scope) if level.path_functions is not None), None)
    usage = USAGE.get(tree.function, f"{tree.function}(x)")
    if own is None or own.path_functions is None:
        hint = "write it in a clause of a step of a query with CONNECT BY"
        raise ResolveError("R014", f"{usage} is said of a step of a search", tree.span, (hint,))
    least, most = FUNCTIONS[tree.function]
    if not least <= len(tree.arguments) <= most:
        message = f"'{tree.function}' takes {least if least == most else '1 or 2'} argument{'s' * (most != 1)}, "
        raise ResolveError("R005", message + f"not {len(tree.arguments)}", tree.span, (f"it is called as {usage}",))
    said = own.path_functions
    _check_path_clause(tree, said)
    key = ({"cycle": "path"}.get(tree.function, tree.function), tree.arguments[0] if tree.arguments else None)
    name = _get_variable(said, said.variables.get(key, ""))
    if not name and tree.function not in ("next", "leaf"):
        hint = f"write {usage} outside of eval"
        raise ResolveError("R014", "a text that eval reads cannot ask for the path", tree.span, (hint,))
    state: plan.Expr = plan.State(own.query, name, own.states.get(name, Type(Kind.ANY)), span=tree.span)
    if tree.function in ("level", "prior"):
        return state
    if tree.function == "leaf":
        return _resolve_leaf(resolver, tree.span, own)
    argument = _resolve_argument(resolver, tree, own)
    match tree.function:
        case "root":
            itself, level = ast.Name(name, span=tree.span), _get_variable(said, "level()")
            return replace(
                resolver.resolve_expr(_make_first_step_syntax(tree.arguments[0], itself, level), own), span=tree.span
            )
        case "next":
            after: plan.Expr = replace(resolve_next_call(own, argument), span=tree.span)
            return after
        case "cycle":
            reached = argument
            if not list_sources(argument):
                state, reached = (
                    _resolve_path_cell(resolver, state, argument, tree.span),
                    resolve_next_call(own, argument),
                )
            values = resolver.make_call("path values", (state,), tree.span, tree.span)
            return resolver.make_call("in", (reached, values), tree.span, tree.span)
        case _:
            more = resolver.resolve_all(tree.arguments[1:], own)
            cell = _resolve_path_cell(resolver, state, argument, tree.span)
            if more:
                return resolver.make_call("path text", (cell, *more), tree.span, tree.span)
            values = resolver.make_call("path values", (cell,), tree.span, tree.span)
            item = argument.type
            columns = item.columns if item.is_only(Kind.DICT) else None
            return replace(values, type=Type(Kind.LIST, element=item, columns=columns))


def resolve_next_call(scope: Scope, expr: plan.Expr) -> Any:
    """The expression in the state after a step: the assignments of CONNECT BY in place of the variables."""
    assert scope.path_functions is not None
    assert scope.path_functions.search is not None, "sources and assignments have no path functions"
    values: dict[str, plan.Expr] = {}

    def substitute(node: Any) -> Any:
        if isinstance(node, plan.State) and node.query == scope.query:
            return values.get(node.name, node)
        return rebuild_node(node, substitute)

    for name, value in scope.path_functions.search.connect:
        values[name] = substitute(value)
    return substitute(expr)


def calls_path_function(resolver: Resolver, tree: ast.Expr | ast.Named | ast.Star) -> bool:
    """Whether an expression calls a path function."""
    return any(is_path_function(resolver, node) for node in ast.walk_syntax(tree, _is_other_search))


def _check_path_clause(tree: ast.Call, said: PathFunctions) -> None:
    clause, function = said.clause, tree.function
    wrong = clause in FORBIDDEN_CLAUSES or (function == "leaf" and clause not in RESULT_CLAUSES)
    if clause == "CONNECT BY" and function in ("next", "cycle"):
        wrong = True
    if not wrong:
        return
    where = f"the key after {clause}" if clause == "BY" else clause if clause != "CONNECT BY" else "an assignment"
    hint = "write it in the condition of CONNECT BY, in STOP WITH, WHERE or SELECT"
    if clause == "BY" and function == "next" and tree.arguments and isinstance(tree.arguments[0], ast.Name):
        hint = f"write {tree.arguments[0].name} for the state after the step"
    if function == "leaf":
        hint = f"write {CHOOSE_LEAVES}"
    raise ResolveError("R014", f"{function} does not stand in {where}", tree.span, (hint,))


def _resolve_argument(resolver: Resolver, tree: ast.Call, own: Scope) -> plan.Expr:
    """The argument, resolved in the search, even inside an inner query."""
    argument = resolver.resolve_expr(tree.arguments[0], own)
    if is_volatile(argument):
        hint = "assign what it gives to a variable of START WITH in CONNECT BY"
        raise ResolveError("R014", f"{tree.function} does not go with what changes or is volatile", tree.span, (hint,))
    return argument


def _resolve_leaf(resolver: Resolver, span: Span, own: Scope) -> plan.Expr:
    """The expression of `leaf()`: the step stops, or no element meets CONNECT BY in the state after it."""
    assert own.path_functions is not None
    assert own.path_functions.search is not None
    search = own.path_functions.search
    numbers: dict[int, int] = {}
    sources = tuple(resolve_next_call(own, _renumber_copy(resolver, s, numbers)) for s in own.path_functions.sources)
    where = None if search.made is None else resolve_next_call(own, _renumber_copy(resolver, search.made, numbers))
    one = plan.Constant(1, Type(Kind.INT, 1, 1), span=span)
    shown = (plan.Output("1", one),)
    form = plan.Representation("list")
    query = plan.Query(resolver.make_number(), sources, shown, where, limit=one, representation=form, span=span)
    found = plan.Subquery(query, make_list_type([one.type]), span=span)
    nothing = plan.Constant([], Type(Kind.LIST), span=span)
    none = resolver.make_call("eq", (replace(found, type=Type(Kind.LIST, element=one.type)), nothing), span, span)
    return none if search.stop is None else plan.Or((search.stop, none), BOOL, span=span)


def _renumber_copy(resolver: Resolver, node: Any, numbers: dict[int, int]) -> Any:
    """A copy of sources, or of what reads them, with numbers of its own for sources and queries inside."""
    for part in walk(node):
        if isinstance(part, (*plan.SOURCES, plan.Query)) and part.id not in numbers:
            numbers[part.id] = resolver.make_number()

    return renumber_node(node, numbers)


def _resolve_path_cell(resolver: Resolver, state: plan.Expr, argument: plan.Expr, span: Span) -> plan.Expr:
    return resolver.make_call("path cell", (state, argument), argument.span, span)


def _make_assignment_syntax(name: str, value: ast.Expr) -> ast.Assign:
    return ast.Assign(name, value, span=value.span, name_span=value.span)


def _make_first_step_syntax(then: ast.Expr, otherwise: ast.Expr, level: str = "level()") -> ast.Expr:
    span = then.span
    operands = (ast.Name(level, span=span), ast.Literal(1, span=span))
    return ast.If(ast.Operator("eq", operands, span=span, place=span), (then,), (otherwise,), span=span)


def _is_other_search(tree: Any) -> bool:
    """Whether it is a search inside of this one, which has calls of its own."""
    return isinstance(tree, ast.Query) and tree.searches


def _measure_prior_nesting(resolver: Resolver, tree: Any) -> int:
    """The depth of nesting of these calls."""
    parts = (part for part in ast.list_syntax_children(tree) if not _is_other_search(part))
    inside = max((_measure_prior_nesting(resolver, part) for part in parts), default=0)
    return inside + is_path_function(resolver, tree)


def suggest_in_search(name: str, span: Span, scope: Scope | None) -> tuple[str, ...]:
    """What a search has in place of `LAST (x)`, read as a call, of `cost` and `path`; nothing for other names."""
    query = None if scope is None else scope.written
    if query is None or not query.searches:
        return ()
    cost = next((option.argument for option in query.options if option.keyword == "COST"), None)
    if name.upper() == "COST" and cost is not None:
        return (f"write sum(path({cost.span.text})) for the cost of the path",)
    if name.lower() in FUNCTIONS and span.text != name:
        return (f"write {name.lower()}{span.text[len(name) :]}",)
    if name.lower() in FUNCTIONS:
        assigned = [assign.value.span.text for assign in query.connect if isinstance(assign.value, ast.Name)]
        return (f"write {name.lower()}({'' if name.lower() in ('level', 'leaf') else (*assigned, 'this')[0]})",)
    first = query.columns[0]
    if name.upper() == "LAST" and first.span.start == span.start:
        column, label = (first.expr, first.name) if isinstance(first, ast.Named) else (first, "x")
        texts = [column.span.text[len(name) :].strip()]
        if isinstance(column, ast.Call):
            texts = [argument.span.text for argument in column.arguments] or ["..."]
        columns = ", ".join((f"to({texts[0]}, '{label}')", *texts[1:]))
        return (f"write LAST {columns}", "next to LAST stands a name, a literal or this, never a parenthesis")
    return ()


# --- the options of CONNECT BY: their meaning for a search, and their contradictions
ORDERS = tuple(order.upper() for order in get_args(plan.Order) if order != "greedy")
WEIGHTS = ("COST", "PROBABILITY")
REPEATS = tuple(rule.upper() for rule in get_args(plan.Repeats) if rule != "allowed")


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
        return resolver.record_errors(resolver.resolve_number, option.argument, visible)

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
    for rule in get_args(plan.Repeats):
        if rule.upper() in options:
            repeats, by = rule, options[rule.upper()].by
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
        word = search.repeats.upper()
        message, hint = f"{word} compares rows, and every column of SELECT asks for the path", f"write {word} BY key"
        resolver.refuse("R010", message, query.columns[0].expr.span, hint)
    return replace(query, search=replace(search, key=left))


def _check_memorize(resolver: Resolver, tree: ast.Query) -> None:
    """Refuses path functions beside MEMORIZE outside the result: a step belongs to many paths."""
    evaluated = [tree.made, tree.first, tree.stop, tree.where, *(option.argument for option in tree.options)]
    evaluated += [*(assign.value for assign in tree.connect), *(key.expr for key in tree.siblings)]
    for expr in evaluated:
        if expr is not None and calls_path_function(resolver, expr):
            message = "with MEMORIZE a step belongs to many paths, so only what is shown can ask for its path"
            hint = "write it in SELECT, GROUP BY, HAVING or ORDER BY, or write NO CYCLE in place of MEMORIZE"
            resolver.refuse("R014", message, expr.span, hint)


def resolve_outside(resolver: Resolver, tree: ast.Expr, outer: Scope | None, what: str) -> plan.Expr:
    """An expression that is evaluated once for the query, such as LIMIT; it sees none of its elements and columns."""
    before = len(resolver.errors)
    found = resolver.record_errors(resolver.resolve_number, tree, outer)
    for error in resolver.errors[before:]:
        once = f"{what} is read once, before there is an element"
        if error.code == "R014":
            error.hints = (once,)
        elif error.code == "R001":
            error.with_hint(once)
    return found


def _check_search_clauses(resolver: Resolver, options: dict[str, ast.Option]) -> None:
    """A search has one order, and one rule for repeated rows; MEMORIZE has its own order."""
    for one, other in combinations(options.values(), 2):
        words = {one.keyword, other.keyword}
        memorizes = "MEMORIZE" in words and words & {*REPEATS, *ORDERS} - {"MEMORIZE", *WEIGHTS}
        alone = "HEURISTIC" in words and "COST" not in options and words & {*ORDERS, "MEMORIZE"}
        if words <= {*ORDERS} or memorizes or alone:
            hint = "keep one of them"
            if alone and "MEMORIZE" in words:
                hint = "leave HEURISTIC out, or add COST expr, the cost of one step"
            _contradict(resolver, other, one, f"{one.keyword} and {other.keyword} do not go together", hint)


def _contradict(resolver: Resolver, option: ast.Option, other: ast.Option, reason: str, hint: str) -> None:
    resolver.errors.append(ResolveError("R010", reason, option.span, (hint,), ((other.span, "the other one"),)))


# --- the types of START WITH variables, valid in the first state and in every one that CONNECT BY makes
# They are a fixpoint: CONNECT BY is resolved with assumed types, which grow until its values stay within them or lose
# their bounds. In `x = x + dx` a number grows with every step, by a bounded amount, so its size follows from the number
# of steps; types alone could not prove it, for each step would widen the bounds of the last one.
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
            types[name] = unite((types[name], kind if counting or number < patience else drop_bounds(value.type)))
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
    """CONNECT BY with these types of variables. Nothing else is remembered."""
    attempt = scope.copy_scopes()
    attempt.states.update(types)
    errors = len(resolver.errors)
    stable = (dict(resolver.parameters), dict(resolver.tables), resolver.tentative, resolver.numbers)
    resolve_sources(resolver, tree, attempt)
    before = attempt.enter_clause("CONNECT BY")
    connect: list[tuple[str, plan.Expr]] = []
    for assign in tree.connect:
        value = resolver.record_errors(resolver.resolve_expr, assign.value, attempt)
        if any(function.body is not None for function in list_plan_functions(value)):
            value = resolver.inliner.inline_calls(value)  # a proof sees through the user's functions
        connect.append((assign.name, value))
    attempt.enter_clause(before)
    del resolver.errors[errors:]
    resolver.parameters, resolver.tables, resolver.tentative, resolver.numbers = stable
    return connect


# --- the size of numbers that steps change by bounded amounts
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
