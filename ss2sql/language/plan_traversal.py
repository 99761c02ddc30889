"""Traversal of plans: the parts of an expression or query, what it depends on, and whether equal rows mean equal steps.

UNIQUE, NO CYCLE and MEMORIZE identify steps by their rows. Their results are the promised ones where equal rows have
equal stops, goals and next states; the plan can prove that.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from itertools import chain
from typing import Any, TypeAlias, TypeGuard, TypeVar

from ss2sql.errors import Span
from ss2sql.language import plan
from ss2sql.language.kinds import Kind, Type

# --- traversal of plans: the parts of an expression or query, what it depends on, and its text as a tree
Node: TypeAlias = Any  # an expression, or any plan dataclass that holds expressions
E = TypeVar("E")

_fields: dict[type, tuple[str, ...]] = {}
_kinds: dict[type, bool] = {}  # whether the values of a class are nodes: compiling needs this 1,000 times for a query

# Fields that never hold expressions.
_PLAIN = frozenset({"span", "place", "type", "scope", "literal", "name", "element"})


def list_parts(node: Node) -> Iterator[Node]:
    """The plan nodes directly inside a node, in the order of its fields; nested queries are nodes, too."""
    found: list[Node] = []
    for name in _list_plan_fields(type(node)):
        _collect_nodes(getattr(node, name), found)
    return iter(found)


def _list_plan_fields(kind: Any) -> tuple[str, ...]:
    """The fields of a class that may hold nodes; cached by class."""
    names = _fields.get(kind)
    if names is None:
        names = () if kind is plan.Constant else tuple(f.name for f in fields(kind) if f.name not in _PLAIN)
        _fields[kind] = names
    return names


def _collect_nodes(value: Any, found: list[Node]) -> None:
    if isinstance(value, tuple):
        for item in value:
            _collect_nodes(item, found)
    elif _is_plan_node(value):
        found.append(value)


def _is_plan_node(value: Any) -> bool:
    kind = type(value)
    known = _kinds.get(kind)
    if known is None:
        known = _kinds[kind] = is_dataclass(kind) and not issubclass(kind, (plan.Function, Type))
    return known


def walk(node: Node) -> Iterator[Node]:
    """The node and everything below it, parents first; iterative, so that depth does not matter."""
    stack = [node]
    while stack:
        current = stack.pop()
        yield current
        stack.extend(reversed(list(list_parts(current))))


def walk_own(node: Node) -> Iterator[Node]:
    """Like `walk`, without the queries below the node."""
    stack = [node]
    while stack:
        current = stack.pop()
        yield current
        stack.extend(part for part in reversed(list(list_parts(current))) if not isinstance(part, plan.Query))


def rebuild_node(expr: E, change: Callable[[Node], Node]) -> E:
    """The same node with `change` applied to every node directly inside it."""
    changed = {}
    for name in _list_plan_fields(type(expr)):
        before = getattr(expr, name)
        after = _map_value(before, change)
        if after is not before:
            changed[name] = after
    return replace(expr, **changed) if changed else expr  # type: ignore[type-var]


def _map_value(value: Any, change: Callable[[Node], Node]) -> Any:
    if isinstance(value, tuple):
        items = tuple(_map_value(item, change) for item in value)
        return items if any(a is not b for a, b in zip(items, value, strict=True)) else value
    return change(value) if _is_plan_node(value) else value


def is_structurally_equal(one: plan.Expr, other: plan.Expr) -> bool:
    """Whether both are equal once the queries and sources inside have the same numbers."""
    if type(one) is not type(other) or one == other:
        return one == other
    ones, others = _collect_structural_ids(one), _collect_structural_ids(other)
    return 0 < len(ones) == len(others) and renumber_node(other, dict(zip(others, ones, strict=True))) == one


def _collect_structural_ids(node: plan.Expr) -> list[int]:
    """The numbers of the queries and sources inside, in the order of the plan; they are unique in a script."""
    return [part.id for part in walk(node) if isinstance(part, (plan.Query, *plan.SOURCES))]


def renumber_node(node: Any, numbers: Mapping[int, int]) -> Any:
    """The node with the numbers of queries and sources replaced by `numbers`, as far as that names them."""
    node = rebuild_node(node, lambda part: renumber_node(part, numbers))
    match node:
        case plan.Element(source=number) | plan.Column(source=number):
            return replace(node, source=numbers.get(number, number))
        case plan.State(query=number) | plan.GroupKey(query=number):
            return replace(node, query=numbers.get(number, number))
        case plan.Eval(sources=sources, states=states):
            renamed = tuple((numbers.get(query, query), name) for query, name in states)
            return replace(node, sources=tuple(numbers.get(each, each) for each in sources), states=renamed)
        case _:
            own = isinstance(node, (plan.Query, *plan.SOURCES)) and node.id in numbers
            return replace(node, id=numbers[node.id]) if own else node


def split_and(condition: plan.Expr | None) -> tuple[plan.Expr, ...]:
    """The parts of a conjunction, in the order of their evaluation; none for a missing condition."""
    return condition.parts if isinstance(condition, plan.And) else () if condition is None else (condition,)


def join_conditions(kind: type[plan.And | plan.Or], parts: Sequence[plan.Expr], span: Span) -> plan.Expr:
    """The parts, at least one, as one condition; a single part is itself the condition."""
    return parts[0] if len(parts) == 1 else kind(tuple(parts), span=span)


def is_column_query(query: plan.Query) -> bool:
    """Whether a query gives the list of one column of all rows that its conditions hold for."""
    if query.representation.name != "list" or len(query.columns) > 1 or query.columns[0].star:
        return False
    return not (query.search or query.grouped or query.limit)


def is_exists(query: plan.Query) -> bool:
    """Whether a query only tests for a row: True, or None without one, see lowering/rewrites/unnest_subqueries.py."""
    constants = [output.expr for output in query.columns] + [query.limit]
    known = [constant.value for constant in constants if isinstance(constant, plan.Constant)]
    return query.representation.name == "value" and known == [True, 1] and not (query.search or query.order)


def can_end_early(query: plan.Query) -> bool:
    """Whether LIMIT may end a flat query early, so that the rows that call functions can be observed."""
    return query.limit is not None and not (query.search or query.order or query.group or is_exists(query))


def has_constant_source(query: plan.Query) -> bool:
    """Whether some source of the query is the same for all rows around it."""
    inside = list_inside(query)
    return any(list_sources(source) <= inside and not list_states(source) for source in query.sources)


def list_sources(node: Node) -> frozenset[int]:
    """The numbers of all sources whose element or columns the node reads, sources inside it included."""
    found: set[int] = set()
    for part in walk(node):
        match part:
            case plan.Element(source=source) | plan.Column(source=source):
                found.add(source)
            case plan.Eval(sources=sources):
                found.update(sources)
    return frozenset(found)


def list_inside(node: Node) -> frozenset[int]:
    """The numbers of the sources that the queries in a node bring along."""
    return frozenset(part.id for part in walk(node) if isinstance(part, plan.SOURCES))


def reads_outside(query: plan.Query) -> bool:
    """Whether a query reads rows or states around it."""
    return bool(list_sources(query) - list_inside(query) or list_states(query))


def list_columns_read(
    nodes: Iterable[Node], source: int, columns: tuple[str, ...], whole: tuple[str, ...] | None = None
) -> tuple[str, ...]:
    """Those of a source's columns that the nodes read; `whole`, by default all, where they read its elements."""
    read: set[str] = set()
    for node in chain.from_iterable(map(walk, nodes)):
        match node:
            case plan.Eval():
                return columns if whole is None else whole
            case plan.Element(source=number) if number == source:
                return columns if whole is None else whole
            case plan.Column(source=number, name=name) if number == source:
                read.add(name)
    return tuple(name for name in columns if name in read)


def list_states(node: Node) -> frozenset[tuple[int, str]]:
    """The START WITH variables that the node reads, as (query, name)."""
    found: set[tuple[int, str]] = set()
    for part in walk(node):
        match part:
            case plan.State(query=query, name=name):
                found.add((query, name))
            case plan.Eval(states=states):
                found.update(states)
    return frozenset(found)


def can_vary_with(node: Node, sources: Collection[int], search: int | None) -> bool:
    """Whether the node's value may change with the rows of these sources or the states of this query's search."""
    return not list_sources(node).isdisjoint(sources) or any(query == search for query, _ in list_states(node))


def find_direct_assignments(query: plan.Query) -> dict[str, plan.Expr]:
    """The variables that CONNECT BY sets from the state before the step, with their new values.

    Variables that are set twice, or from a variable that is already set, are left out.
    """
    assert query.search is not None
    moved: set[tuple[int, str]] = set()
    values: dict[str, plan.Expr] = {}
    for name, expr in query.search.connect:
        again = (query.id, name) in moved
        values.pop(name, None)
        if not again and not list_states(expr) & moved:
            values[name] = expr
        moved.add((query.id, name))
    return values


def has_query(node: Node) -> bool:
    """Whether a node evaluates a query."""
    return any(isinstance(part, plan.Subquery) for part in walk(node))


def list_plan_functions(node: Node) -> Iterator[plan.Function]:
    """The functions that the node calls, in the order of its text."""
    for part in walk(node):
        if isinstance(part, plan.Call):
            yield part.function


def is_volatile(node: Node) -> bool:
    """Whether evaluating the node again, or earlier, has an effect: volatile calls, assignments, `eval`."""
    return any(
        isinstance(part, (plan.Assign, plan.TemporalAssign, plan.AssignLate, plan.Eval))
        or (isinstance(part, plan.Call) and part.function.volatility == "volatile")
        for part in walk(node)
    )


def can_fail(node: Node) -> bool:
    """Whether evaluating the expression can raise or has an effect, so that its place in the order matters."""
    return is_volatile(node) or any(
        (isinstance(part, plan.Call) and part.function.raises)
        or isinstance(part, plan.Subquery)
        or (isinstance(part, plan.Column) and not part.declared)
        for part in walk(node)
    )


def is_array_call(node: Any) -> TypeGuard[plan.Call]:
    return isinstance(node, plan.Call) and node.function.vectorized


def has_array_calls(*nodes: Any) -> bool:
    """Whether functions that take arrays are called in parts of a plan."""
    return any(is_array_call(part) for node in nodes for part in walk(node))


def list_plan_choices(call: plan.Call) -> tuple[plan.Expr, ...]:
    """The candidates of `min` or `max`: its arguments or the items of a list literal; none for another list."""
    match call.arguments:
        case (plan.MakeList(items=items),):
            return items
        case (_,):
            return ()
        case several:
            return several


def may_run_foreign_code(root: Node) -> bool:
    """Whether it calls functions of the user, or may call some, or reads a world, whose columns they are."""
    foreign = (plan.Eval, plan.AssignLate, plan.WorldSource)
    return any(isinstance(n, foreign) or (isinstance(n, plan.Call) and not n.function.builtin) for n in walk(root))


def can_move_world(root: Any) -> bool:
    """Whether a part of a plan calls what may move a world: volatile functions of the user or of the world, or eval."""
    return any(
        isinstance(node, plan.Eval)
        or (isinstance(node, plan.Call) and not node.function.builtin and node.function.volatility == "volatile")
        for node in walk(root)
    )


def list_plan_calls(*roots: Node) -> dict[str, frozenset[tuple[int, int]]]:
    """Where each function of the user is called; empty where that is not known before the script runs."""
    found: dict[str, set[tuple[int, int]]] = {}
    for root in roots:
        for node in walk(root):
            if isinstance(node, (plan.Eval, plan.AssignLate)):
                return {}
            if isinstance(node, plan.Call) and not node.function.builtin:
                found.setdefault(node.function.name, set()).add((node.place.start, node.place.end))
    return {name: frozenset(places) for name, places in found.items()}


# --- the plan as an indented tree, for people: `ss2sql sql --stage plan` and golden cases


def format_plan(program: plan.Program) -> str:
    """A program as text: one node per line, its parts below it, each expression with its type."""
    lines: list[str] = []
    if program.parameters:
        lines.append(f"parameters {', '.join(program.parameters)}")
    for statement in program.statements:
        lines.extend(_format_plan_lines(statement.expr, 0))
    return "\n".join(lines) + "\n"


def format_type(kind: Type, bounds: bool = True) -> str:
    """A type in a few words: `int 1..7`, `str or none`, `list of int`, `any`."""
    if kind.kinds == Kind.ANY:
        return "any"
    names = [(member.name or "").lower() for member in Kind if kind.may_be(member)]
    text = " or ".join(names) or "nothing"
    if kind.element is not None and kind.kinds == Kind.LIST:
        text += f" of {format_type(kind.element, bounds)}"
    if bounds and kind.low is not None and kind.high is not None and kind.kinds != Kind.BOOL:
        text += f" {kind.low}..{kind.high}"
    return text


def _format_plan_lines(node: Any, depth: int, role: str = "") -> Iterator[str]:
    """The line of a node, then those of its parts, each under the name of its field."""
    yield f"{'  ' * depth}{role + ': ' if role else ''}{_format_plan_node(node)}"
    for name in _list_plan_fields(type(node)):
        value = getattr(node, name)
        for item in value if isinstance(value, tuple) else (value,):
            word, part = item if isinstance(item, tuple) and len(item) == 2 else ("", item)
            shown = next(list_parts(part), None) if name == "representation" else part
            if _is_plan_node(part) and shown is not None:
                yield from _format_plan_lines(part, depth + 1, f"{name} {word}".rstrip())


# What is written of a node; others are called by their class, with their name if they have one.
_FORMS = {
    "Constant": "constant {0.value!r}",
    "Element": "this of source {0.source}",
    "Column": "column {0.name} of source {0.source}",
    "TableSource": "table {0.id} {0.name}",
    "WorldSource": "world {0.id} {0.name}",
    "QuerySource": "query source {0.id} {0.name}",
    "ValueSource": "source {0.id} {0.name}",
    "Query": "query {0.id} as {0.representation.name}",
    "Search": "search {0.order}, rows {0.repeats}",
    "Aggregate": "aggregate {0.function}",
    "MakeList": "list",
    "Output": "column {0.name}",
}
_UNTYPED = (plan.Subquery, plan.Constant, plan.OrderKey)


def _format_plan_node(node: Any) -> str:
    match node:
        case plan.Call(function=function):
            text = f"{function.name}(){'' if function.builtin else ' ' + function.volatility}"
        case plan.OrderKey(descending=descending):
            text = "descending" if descending else "ascending"
        case plan.GroupKey(index=index):
            text = f"group value {index + 1}"
        case _:
            kind, name = type(node).__name__, getattr(node, "name", "")
            text = _FORMS.get(kind, kind.lower() + (" {0.name}" if name else "")).format(node)
    known = node.element if isinstance(node, plan.ValueSource) else getattr(node, "type", None)
    return f"{text} [{format_type(known)}]" if isinstance(known, Type) and not isinstance(node, _UNTYPED) else text


# --- whether equal rows of a search mean equal steps
UnnamedRead: TypeAlias = dict[plan.Expr, tuple[str, ...]]
Condition: TypeAlias = tuple[plan.Expr, bool]  # with the truth that it has

_SIGNS = {"eq": ("eq", True), "ne": ("eq", False), "lt": ("lt", True), "ge": ("lt", False), "gt": ("gt", True),
          "le": ("gt", False)}  # fmt: skip


def find_unnamed(query: plan.Query) -> UnnamedRead:
    """What the clauses of a search read beside its rows, each with the names of the clauses that read it.

    Empty: equal rows are proved to have equal stops, goals and next states, so the steps after them have equal costs.

    Steps that stop and are no goals leave no trace. For all others more is known than their rows: the condition of
    CONNECT BY is true; without WHERE no goal stops; with `src != town` in STOP WITH and `src == town` in WHERE, `town`
    is `src`. The variables that a search carries for `level()` and its like are left out, but for a `prior` that
    decides which steps there are.
    """
    search = query.search
    assert search is not None
    substitute = list(split_condition(search.made, True)) if search.first is None else []
    going, goals = [*substitute, *split_condition(search.stop, False)], list(split_condition(query.where, True))
    tests = {_normalize_plan_condition(*goal) for goal in (*goals, *substitute)}
    sure = going if query.where is None else [one for one in going if _normalize_plan_condition(*one) in tests]
    known = {_normalize_plan_condition(*one) for one in sure}
    shown = query.rows if query.aggregated else tuple(out.expr for out in query.columns)
    known_values = _add_equal_values(_list_told_values(search.key or shown), sure)
    reader = _StepIdentityReads(query)
    reader.collect_reads(
        "STOP WITH",
        (expr for expr, truth in going if _normalize_plan_condition(expr, truth) not in known),
        known_values,
    )
    reader.collect_reads(
        "WHERE", (expr for expr, truth in goals if _normalize_plan_condition(expr, truth) not in known), known_values
    )
    known_values = _add_equal_values(known_values, going)  # a step that stops has no next state
    asked = {state for part in split_and(search.made) for state in list_states(part) if state[1].startswith("prior(")}
    for name, expr in search.connect:
        if name.isidentifier() or (query.id, name) in asked:
            reader.collect_reads("CONNECT BY", [expr], known_values)
        reader.moved.discard(name)  # later assignments see its new value, which has been read
    return {expr: tuple(clauses) for expr, clauses in reader.found.items()}


def describe_unnamed(query: plan.Query) -> tuple[str, ...]:
    """The same, as expressions in a script's notation."""
    return tuple(dict.fromkeys(map(write_in_script, find_unnamed(query))))


def write_in_script(expr: plan.Expr) -> str:
    """An expression in a script's notation."""
    return expr.name if isinstance(expr, plan.State) else " ".join(expr.span.text.split())


def write_test_for_none(root: Node, place: Span | None) -> tuple[str, ...]:
    """The hint for a comparison of None at a place, in the script's own words; nothing where it is not found.

    In the first steps of a search `prior` is None: who leaves these out finds nothing.
    """
    calls = [node for node in walk(root) if isinstance(node, plan.Call) and node.place == place]
    operands = [side for call in calls for side in call.arguments if not side.type.excludes(Kind.NONE)]
    if not operands or len(text := " ".join(calls[0].span.text.split())) > 60:
        return ()
    prior = {side.name for side in operands if isinstance(side, plan.State) and side.name.startswith("prior(")}
    for name in sorted(prior):
        text = f"({name} == None OR {text})"
    others = dict.fromkeys(
        f"{write_in_script(side)} != None" for side in operands if write_in_script(side) not in prior
    )
    text = f"({' AND '.join((*others, text))})" if others else text
    return (f"None has no order: write {text}",)


def find_growing_states(query: plan.Query, evenly: bool = False) -> frozenset[str]:
    """The variables to which CONNECT BY adds or subtracts something; `evenly`: a constant."""
    assert query.search is not None
    found: set[str] = set()
    for name, expr in query.search.connect:
        match expr:
            case plan.Call(function=plan.Function(name="add" | "sub", builtin=True), arguments=(left, right)):
                for own, other in ((left, right), (right, left)):
                    state = isinstance(own, plan.State) and (own.query, own.name) == (query.id, name)
                    if state and (not evenly or isinstance(other, plan.Constant)):
                        found.add(name)
    return frozenset(found)


def split_stop_conditions(query: plan.Query) -> Iterator[plan.Expr]:
    """The conditions in STOP WITH that each end a path."""
    assert query.search is not None
    return (expr for expr, truth in split_condition(query.search.stop, False) if not truth)


class _StepIdentityReads:
    """Collects what clauses read of the elements and of variables that change."""

    def __init__(self, query: plan.Query) -> None:
        assert query.search is not None
        self.query = query.id
        self.own = frozenset(source.id for source in query.sources)
        self.moved = {name for name, _ in query.search.connect if name.isidentifier()}
        self.found: dict[plan.Expr, dict[str, None]] = {}

    def collect_reads(self, clause: str, exprs: Iterable[plan.Expr], known_values: Sequence[plan.Expr]) -> None:
        for expr in exprs:
            for found in self._find_missing(expr, known_values):
                self.found.setdefault(found, {})[clause] = None

    def _find_missing(self, expr: plan.Expr, known_values: Sequence[plan.Expr]) -> Iterator[plan.Expr]:
        if expr in known_values:
            return
        match expr:
            case plan.State(query=query, name=name) if query == self.query:
                if name in self.moved:
                    yield expr
            case plan.Column(source=source) if source in self.own:
                if not any(isinstance(known, plan.Element) and known.source == source for known in known_values):
                    yield expr
            case plan.Element(source=source) if source in self.own:
                yield expr
            case plan.Eval():
                yield expr
            case _:
                for part in list_parts(expr):
                    yield from self._find_missing(part, known_values)


def split_condition(condition: plan.Expr | None, truth: bool) -> Iterator[Condition]:
    """The conditions that all hold where this one has that truth; none for a missing condition."""
    match condition:
        case None:
            return
        case plan.Not(operand=operand):
            yield from split_condition(operand, not truth)
        case plan.And(parts=several) if truth:
            for part in several:
                yield from split_condition(part, True)
        case plan.Or(parts=several) if not truth:
            for part in several:
                yield from split_condition(part, False)
        case _:
            yield condition, truth


def _normalize_plan_condition(condition: plan.Expr, truth: bool) -> Hashable:
    """A canonical form: equal for `a == b` and for the opposite of `b != a`."""
    if is_volatile(condition):
        return id(condition)
    match condition:
        case plan.Call(function=plan.Function(name=name, builtin=True), arguments=(left, right)) if name in _SIGNS:
            sign, positive = _SIGNS[name]
            sides: Collection[plan.Expr] = frozenset((left, right)) if sign == "eq" else (left, right)
            if sign == "gt":
                sign, sides = "lt", (right, left)
            return sign, sides, truth == positive
        case _:
            return condition, truth


def _list_told_values(columns: Iterable[plan.Expr]) -> list[plan.Expr]:
    """What the values of some columns determine: these, and the items of list literals in them."""
    found: list[plan.Expr] = []
    for expr in columns:
        found.append(expr)
        if isinstance(expr, plan.MakeList):
            found.extend(_list_told_values(expr.items))
    return found


def _add_equal_values(known_values: list[plan.Expr], conditions: Sequence[Condition]) -> list[plan.Expr]:
    """`known_values`, and what equals one of them or a constant where the conditions hold."""
    known, pairs = list(known_values), list_equal_sides(conditions)
    size = -1
    while size < len(known):
        size = len(known)
        for one, other in pairs:
            if other not in known and (one in known or isinstance(one, plan.Constant)):
                known.append(other)
    return known


# A comparison with its sides exchanged.
MIRRORED = {"lt": "gt", "le": "ge", "gt": "lt", "ge": "le"}


def list_equal_sides(conditions: Iterable[Condition]) -> list[tuple[plan.Expr, plan.Expr]]:
    """What is equal where the conditions hold, each pair in both orders."""
    pairs: list[tuple[plan.Expr, plan.Expr]] = []
    for condition, truth in conditions:
        match condition:
            case plan.Call(function=plan.Function(name="eq" | "ne" as name, builtin=True), arguments=(left, right)):
                if truth == (name == "eq") and not is_volatile(condition):
                    pairs += [(left, right), (right, left)]
    return pairs
