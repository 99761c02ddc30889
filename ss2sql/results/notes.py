"""Notes: what a person should know of a result, why a search may have found too little, and the cure."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from math import prod
from typing import Any

from ss2sql.errors import join_words
from ss2sql.frontend.resolve.search_clauses import FUNCTIONS
from ss2sql.language import plan
from ss2sql.language.kinds import NOTHING, Kind
from ss2sql.language.plan_traversal import (
    can_vary_with,
    find_direct_assignments,
    find_growing_states,
    find_unnamed,
    is_structurally_equal,
    list_equal_sides,
    list_inside,
    list_sources,
    list_states,
    split_and,
    split_condition,
    split_stop_conditions,
    walk,
    walk_own,
    write_in_script,
)
from ss2sql.language.rows import Rows
from ss2sql.language.values import make_hashable
from ss2sql.runtime.run.run_state import Stats


def find_notes(query: plan.Query, dropped: bool = False) -> tuple[str, ...]:
    """What can be said of a query, and of those inside of it. `dropped`: it ran, and dropped steps as repeated."""
    nodes = list(walk(query))
    queries = [node for node in nodes if isinstance(node, plan.Query)]
    searches = [each for each in queries if each.search is not None]
    notes = [note for each in searches for note in _note_undetermined_states(each, dropped)]
    calls = (node.function for each in searches for node in walk(each) if isinstance(node, plan.Call))
    notes += [
        f"{write_in_script(shown)} gives a list of {rows}; with AS value it gives the value in it"
        for each in queries
        for output in each.columns
        for shown, rows in _find_shown_queries(output.expr)
    ]
    notes += [
        f"{call.name} is the function that was registered under this name; give it another name to ask for the path"
        for call in calls
        if call.name in FUNCTIONS and not call.builtin
    ]
    for each in searches:
        notes += [*_note_constant_cycle(each), *_note_futile_conditions(each), *_note_first_steps_without_prior(each)]
    notes += [node.hides for node in nodes if isinstance(node, plan.ValueSource) and node.hides]
    notes += _note_operands_of_sql(queries, nodes)
    notes += _note_unequal_kinds(nodes)
    notes += [note for node in nodes if isinstance(node, plan.Subquery) for note in _note_inner_elements(node.query)]
    return tuple(dict.fromkeys(notes))


def _note_constant_cycle(query: plan.Query) -> Iterator[str]:
    """That `cycle(k)` is False for every result of a search that drops the steps of which it would be true."""
    search = query.search
    assert search is not None
    if search.repeats not in ("unique", "no cycle") or len(search.key) != 1 or search.by == "row":
        return
    call = f"cycle({write_in_script(search.key[0])})"
    asked = (*(output.expr for output in query.columns), *split_and(query.where))
    if any(isinstance(node, plan.Call) and node.span.text == call for expr in asked for node in walk(expr)):
        dropping = f"{search.repeats.upper()} BY {write_in_script(search.key[0])}"
        yield (
            f"{call} is False, for {dropping} drops the steps of which it would be true; "
            f"to keep them write WHERE True and STOP WITH {call} in place of {dropping}"
        )


def _note_futile_conditions(query: plan.Query) -> Iterator[str]:
    """That a condition of CONNECT BY holds for no step, or asks nothing of the step before."""
    search, begins = query.search, set[str]()
    assert search is not None
    read = {name for node in (search.made, *query.sources) if node is not None for _, name in list_states(node)}
    linked = search.each or not read <= {"level()"} or any(name.isidentifier() for name, _ in search.start)
    for node in () if search.first is None else walk(search.first):
        begins |= {node.name} if isinstance(node, plan.Column) else set()
    for part, truth in split_condition(search.made, True):
        match part:
            case plan.Call(
                function=plan.Function(name="in" | "not_in" as name, builtin=True),
                arguments=(
                    item,
                    plan.Call(function=plan.Function(name="path values"), arguments=(plan.Call() as at,)),
                ),
            ) if truth == (name == "not_in") and is_structurally_equal(item, at.arguments[-1]):
                wrong = f"NOT ({write_in_script(part)})" if name == "in" else write_in_script(part)
                place = f"write NO CYCLE BY {write_in_script(item)} in its place"
                cure = place if search.repeats == "allowed" else "leave it out"
                yield f"{wrong} never holds, for the path has this step, too; {cure}"
            case plan.Call(function=plan.Function(name="eq", builtin=True), arguments=(one, other)) if (
                truth and not linked and isinstance(one, plan.Column) and isinstance(other, plan.Column)
            ):
                before, after = (other, one) if one.name in begins and other.name not in begins else (one, other)
                if one.source == other.source:
                    cure = f"PRIOR {write_in_script(before)} == {write_in_script(after)}"
                    yield f"{write_in_script(part)} in CONNECT BY asks nothing of the step before; write {cure}"


def _note_first_steps_without_prior(query: plan.Query) -> Iterator[str]:
    """That a condition with `prior` in CONNECT BY, which is that of first steps, too, asks for None in these."""
    assert query.search is not None
    own, search = {source.id for source in query.sources}, query.search
    for left, right in list_equal_sides(split_condition(search.made, True)) if search.first is None else ():
        if isinstance(left, plan.State) and left.name.startswith("prior(") and can_vary_with(right, own, None):
            yield (
                f"in first steps {left.name} is None, so {write_in_script(right)} == None in them; "
                "START WITH may have a condition of its own, such as START WITH True for every element"
            )


def _find_shown_queries(expr: plan.Expr) -> Iterator[tuple[plan.Expr, str]]:
    """The queries without AS and with one column that an expression gives, and how many rows each has."""
    match expr:
        case plan.Call(function=plan.Function(name="coalesce", builtin=True), arguments=parts):
            for part in parts:
                yield from _find_shown_queries(part)
        case plan.If(then=(*_, then), otherwise=(*_, otherwise)):
            yield from _find_shown_queries(then)
            yield from _find_shown_queries(otherwise)
        case plan.Subquery(query=query) if query.representation.span is None and query.representation.name == "dict":
            if len(query.columns) == 1 and not query.gives_paths and (query.aggregated or not query.group):
                yield expr, "one row" if query.aggregated and not query.group else "rows"


def explain_empty_result(
    query: plan.Query, rows: Rows, stats: Stats, before: tuple[int, int, int], get_variable: Callable[[str], Any]
) -> Iterator[str]:
    """Why a query has found nothing, where its search may be the reason.

    `before` it ran so many steps had been generated, expanded and pruned.
    """
    search = query.search
    if rows.rows or rows.paths or rows.groups:
        return
    generated, expanded, pruned = (now - then for now, then in zip(stats.steps, before, strict=True))
    if search is None:
        inner = _find_only_search(query)
        if inner is not None and not (expanded > _count_starts(inner) or pruned):
            yield from _note_ended_first_steps(inner, generated)
        return
    continued = expanded > _count_starts(query)
    if any(_note_futile_conditions(query)) or (not continued and any(_note_first_steps_without_prior(query))):
        return
    clause, condition = _get_condition_of_first_steps(search)
    read_first = [name for part in condition for _, name in sorted(list_states(part))]
    prior = next((name for name in read_first if name.startswith("prior(")), None)
    if prior is not None and not continued:
        form = "may have a condition of its own" if clause == "CONNECT BY" else "asks for columns of the first step"
        yield (
            f"in first steps {prior} is None, and nothing was found with it in the condition of {clause}; "
            f"START WITH {form}, such as START WITH True for every element"
        )
        return
    constant = _find_constant_state(search)
    if constant:
        yield f"CONNECT BY sets nothing, so every step leads back to where it began; set {constant} = ... in it"
        return
    yield from _note_closed_start(query, get_variable)
    if pruned:
        yield from _note_closed_starts(search)
    if rows.ended and search.maximum is not None and query.having is not None:
        most, having = write_in_script(search.maximum), write_in_script(query.having)
        yield (
            f"MAXIMUM {most} ended the search, and HAVING {having} dropped what it had found; "
            "a larger bound in MAXIMUM lets it go on"
        )
    if search.bound is not None and _is_graph_bounded(query, stats):
        most = write_in_script(search.bound)
        yield f"MEMORIZE {most} ended paths before any reached its goal; a larger bound in MEMORIZE lets it go on"
        return
    grown = {(query.id, name) for name in find_growing_states(query)}
    bounds = [("STOP WITH {}", stop) for stop in split_stop_conditions(query)]
    bounds += [("{} in CONNECT BY", part) for part in split_and(search.made) if continued]
    narrow = []
    for place, bound in bounds if generated else ():
        read = {state for state in list_states(bound) if state[0] == query.id}
        if read and read <= grown:
            narrow.append(place.format(write_in_script(bound)))
    for words in narrow:
        yield f"nothing was found before {words} ends a path; a wider bound in it may let paths go on"
    if generated and not narrow:
        yield from _note_states_of_steps(query)
    if not (narrow or continued or pruned):
        yield from _note_ended_first_steps(query, generated)


def _count_starts(query: plan.Query) -> int:
    """The number of starts, as far as it is known; at least 1."""
    assert query.search is not None
    return prod(source.value.type.size or 1 for source in query.search.each)


def _find_only_search(query: plan.Query) -> plan.Query | None:
    """The search in FROM of which all elements are expanded, if a query reads that and nothing else."""
    match query.sources:
        case (plan.QuerySource(query=plan.Query(search=plan.Search(stop=None, maximum=None), limit=None) as inner),):
            pass
        case _:
            return None
    searches = [node for node in walk(query) if isinstance(node, plan.Query) and node.search is not None]
    return None if query.limit is not None or query.offset is not None or len(searches) > 1 else inner


def has_dropped_steps(query: plan.Query, stats: Stats, pruned: int) -> bool:
    """Whether a search has met rows or keys again; `pruned` steps were dropped before."""
    memorizes = query.search is not None and query.search.repeats == "memorize"
    return stats.pruned > pruned or (memorizes and any(level.repeated for level in stats.levels))


def explain_overestimates(query: plan.Query) -> Iterator[str]:
    """That A* has found a path which costs less than its estimate of what remained."""
    for node in walk(query):
        if isinstance(node, plan.Query) and node.search and node.search.heuristic and node.search.weight:
            estimate = write_in_script(node.search.heuristic)
            yield (
                f"HEURISTIC {estimate} was more than what remained to be paid on a path, so others may be cheaper than "
                "the first that came; the least costs need an estimate that is never too high, or COST alone"
            )


def suggest_timeout_cure(query: plan.Query | None) -> str:
    """What a query lacks that took longer than its timeout: no option that it has already."""
    searches = [(node, node.search) for node in walk(query) if isinstance(node, plan.Query) and node.search]
    if not searches:
        return "raise the timeout, or narrow the query with WHERE or LIMIT"
    owner, search = searches[0]
    grown = sorted(find_growing_states(owner))
    constant = _find_constant_state(search)
    if constant:
        return f"raise the timeout, or let CONNECT BY change the state: {constant} = ..."
    lacks = ["MAXIMUM"] if search.maximum is None else []
    state = next((name for name, _ in search.connect if name.isidentifier()), "")
    lacks += [f"UNIQUE BY {state}" if state else "UNIQUE"] if search.repeats == "allowed" else []
    lacks += ["STOP WITH"] if search.stop is None and search.bound is None else []
    if grown and search.repeats != "allowed" and search.stop is None and search.made is None and search.bound is None:
        return f"raise the timeout, or bound {grown[0]} by a condition in CONNECT BY, such as {grown[0]} < 1000"
    if lacks:
        return f"raise the timeout, or bound the search with {' or '.join(lacks)}"
    if search.order == "cost" and search.heuristic is None:
        return "raise the timeout, or estimate what remains: COST ... HEURISTIC ..."
    return "raise the timeout, or let a condition in CONNECT BY drop steps that cannot lead to a goal"


def _find_constant_state(search: plan.Search) -> str:
    """A variable of START WITH that the condition of CONNECT BY reads, where no step changes anything."""
    read = {name for part in split_and(search.made) for _, name in list_states(part)}
    return "" if search.connect else next((name for name, _ in search.start if name in read), "")


_COMPARING = frozenset(("eq", "ne", "lt", "le", "gt", "ge", "like"))


def _note_operands_of_sql(queries: list[plan.Query], nodes: list[plan.Node]) -> Iterator[str]:
    """That a text in double quotes, where hardly any text is meant, is called as a column; that IN has one column."""
    names = {name for query in queries for source in query.sources for name, _ in source.columns or ()}
    texts = [out.expr for query in queries for out in query.columns if out.name == out.expr.span.text]
    texts += [key for query in queries for key in query.group]
    for node in nodes:
        if isinstance(node, plan.Aggregate) and node.argument is not None:
            texts.append(node.argument)
        if not isinstance(node, plan.Call) or not node.function.builtin or len(node.arguments) != 2:
            continue
        name, (left, right) = node.function.name, node.arguments
        if name in _COMPARING or (name in ("in", "not_in") and isinstance(right, plan.Constant)):
            texts.append(left)
        elif name in ("in", "not_in") and isinstance(left, plan.Column) and isinstance(right, plan.Column):
            one, other, sign = write_in_script(left), write_in_script(right), "==" if name == "in" else "!="
            if right.span.end < node.span.end and right.type.kinds in (Kind.STR, Kind.STR | Kind.NONE):
                yield f"IN ({other}) looks for a part of the text {other}; to compare write {one} {sign} {other}"
    for text in texts:
        if isinstance(text, plan.Constant) and text.span.text.startswith('"') and str(text.value) in names:
            column = text.value if text.value.isidentifier() else f"this[{text.span.text}]"
            yield f"{text.span.text} is a text; for the column of this name write {column}"


_EQUALITIES = {"eq": "==", "ne": "!=", "in": "IN", "not_in": "NOT IN"}
_PLAIN = Kind.STR | Kind.NUMBER


def _note_unequal_kinds(nodes: list[plan.Node]) -> Iterator[str]:
    """That an object, an element of a world or a time, is compared with a text or number, which it never equals."""
    worlds = {node.id: node for node in nodes if isinstance(node, plan.WorldSource)}
    for node in nodes:
        if not isinstance(node, plan.Call) or not node.function.builtin or node.function.name not in _EQUALITIES:
            continue
        sign, sides = _EQUALITIES[node.function.name], list(node.arguments)
        texts = [f"({side.span.text})" if isinstance(side, plan.Subquery) else write_in_script(side) for side in sides]
        types = [side.type for side in sides]
        listed = "IN" in sign
        if listed:
            types[1] = types[1].element or NOTHING
        kinds = [each.kinds & ~Kind.NONE for each in types]
        for number, side in enumerate(sides):
            if isinstance(side, plan.Column) and side.source in worlds and kinds[1 - number] == Kind.STR:
                named = _find_name_of_body(side, texts[number], worlds[side.source])
                if named:
                    what, texts[number] = texts[number], named
                    yield f"{what} is an id, and never equals a text; write {' '.join((texts[0], sign, texts[1]))}"
        place = 0 if kinds[0] == Kind.OBJECT else 1
        other = kinds[1 - place]
        if kinds[place] != Kind.OBJECT or not other or other & ~_PLAIN:
            continue
        words = "holds objects, which never equal" if listed and place else "is an object, and never equals"
        what = f"{texts[place]} {words}"
        thing = sides[place]
        if isinstance(thing, plan.Subquery) and len(thing.query.columns) == 1:
            thing = thing.query.columns[0].expr
        column = "name" if other == Kind.STR else "id"
        if isinstance(thing, (plan.Element, plan.Column)) and thing.source in worlds:
            known = isinstance(thing, plan.Column) or column in dict(worlds[thing.source].columns)
            texts[place] += f".{column}"
            cure = f"write {' '.join((texts[0], sign, texts[1]))}" if known else "compare one of its columns"
            cure = f"select {write_in_script(thing)}.{column}" if known and thing is not sides[place] else cure
        elif other == Kind.STR and not (listed and place == 0):
            texts[1 - place] = f"datetime({texts[1 - place]})"
            cure = f"for a time write {' '.join((texts[0], sign, texts[1]))}"
        else:
            cure = "compare values of one kind"
        yield f"{what} a {'text' if other == Kind.STR else 'number'}; {cure}"


def _find_name_of_body(column: plan.Column, shown: str, source: plan.WorldSource) -> str:
    """What gives the name of the body whose id a column of a simulator is; empty of other columns."""
    table = source.table
    if column.type.is_only(Kind.INT) and hasattr(table.world, "find_body"):
        if column.name in ("body", "idA", "idB"):
            return f"{table.world_name}.name({shown})"
        if column.name == "id" and "name" in table.schema.kinds:
            return f"{shown[:-2]}name"
    return ""


def _note_inner_elements(query: plan.Query) -> Iterator[str]:
    """That `this` in an inner query is its own element, where that has a name and is called by it, too."""
    if list_sources(query) - list_inside(query):
        return  # it calls elements around it by their names
    texts = {node.span.text for node in walk_own(query) if isinstance(node, plan.Element)}
    for source in query.sources:
        if {"this", f"{source.name}.this"} <= texts:
            yield (
                f"this is {source.name}.this in the inner query; for the element of the query around it name "
                "its source, FROM m = ..., and write m.this"
            )


def _note_states_of_steps(query: plan.Query) -> Iterator[str]:
    """That WHERE asks for the state before the step, or that steps leave the state as it was."""
    assert query.search is not None
    assigned, own = find_direct_assignments(query), {source.id for source in query.sources}
    goals = split_and(query.where)
    for condition in (*goals, *split_and(query.search.made)):
        match condition:
            case plan.Call(function=plan.Function(name="eq", builtin=True), arguments=(left, right)):
                pairs = ((left, right), (right, left))
            case _:
                continue
        for state, other in pairs:
            value = assigned.get(state.name) if isinstance(state, plan.State) else None
            if value is None or not can_vary_with(value, own, None):
                continue
            name, text = write_in_script(state), write_in_script(other)
            if condition in goals and not can_vary_with(other, own, query.id):
                yield f"{name} in WHERE is the state before the step; for that after it write next({name}) == {text}"
            elif is_structurally_equal(value, other):
                yield f"{name} = {text} leaves {name} as it was, where {text} == {name}; assign where the step leads"


def _get_condition_of_first_steps(search: plan.Search) -> tuple[str, tuple[plan.Expr, ...]]:
    """The clause that has it, and its parts."""
    return ("CONNECT BY", split_and(search.made)) if search.first is None else ("START WITH", split_and(search.first))


def _note_ended_first_steps(query: plan.Query, generated: int) -> Iterator[str]:
    """That no path goes beyond its first step, because of the start or STOP WITH."""
    search = query.search
    assert search is not None
    if query.offset or query.having or (query.limit and not generated) or search.order == "probability":
        return  # that may be why there is nothing
    if list_sources(query) - list_inside(query) or any(n != query.id for n, _ in list_states(query)):
        return  # it runs for each row around it
    lists = {source.id: f"EACH {source.name} IN {write_in_script(source.value)}" for source in search.each}
    values = [
        lists[value.source] if isinstance(value, plan.Element) else f"{name} = {write_in_script(value)}"
        for name, value in search.start
        if name.isidentifier()
    ]
    start = f"after START WITH {', '.join(values)} " if values else ""
    parts = _get_condition_of_first_steps(search)[1]
    condition = " AND ".join(
        f"({write_in_script(part)})" if isinstance(part, plan.Or) else write_in_script(part) for part in parts
    )
    if search.stop is not None and (condition or generated):
        stop = f"STOP WITH {write_in_script(search.stop)}"
        how = f"each first step fails {condition} or {stop} ends it" if condition else f"{stop} ends each first step"
        yield f"{start}{how}, and none is a goal; WHERE True shows the steps that end"
    elif search.stop is None and any(map(list_states, (*parts, *query.sources))):
        what = f"no element meets {condition}" if condition else "FROM has no element"
        yield f"{start}{what}, so no path begins; begin with a value that has first steps"


def _note_closed_start(query: plan.Query, get_variable: Callable[[str], Any]) -> Iterator[str]:
    """That WHERE asks for the state of the start, which counts as visited with a key of the state."""
    search = query.search
    assert search is not None
    if search.by != "state":
        return

    def read_value(expr: plan.Expr) -> Any:
        match expr:
            case plan.Constant(value=value):
                return make_hashable(value)
            case plan.Variable(name=name):
                return make_hashable(get_variable(name))
            case _:
                return expr

    reached, start = find_direct_assignments(query), dict(search.start)
    equal = list_equal_sides(split_condition(query.where, True))
    after = list[plan.Expr]()
    for key in search.key:
        if not isinstance(key, plan.State) or key.name not in reached:
            return
        sides = [other for one, other in equal if one == reached[key.name]]
        if not any(read_value(side) == read_value(start[key.name]) for side in sides):
            return
        after.append(reached[key.name])
    if any(map(list_sources, after)):
        word = search.repeats.upper()
        yield (
            f"{word} BY {_join_keys(search.key)} counts the start as visited, and WHERE asks for the start; "
            f"{word} BY {_join_keys(after)} lets a path come back to it"
        )


def _note_closed_starts(search: plan.Search) -> Iterator[str]:
    """That a search from each of many states reaches none of them, since all of them count as visited."""
    if search.repeats != "unique" or search.by != "state":
        return
    for each in search.each:
        first = f"first_{each.name}" if each.name in dict(search.connect) else each.name
        keys = [first, *map(write_in_script, search.key)]
        if first not in keys[1:]:
            own = "" if first == each.name else f", {each.name} = {first}"
            yield (
                f"every start counts as visited, and UNIQUE BY {_join_keys(search.key)} takes no step to one; to "
                f"search from each on its own write START WITH EACH {first} IN {write_in_script(each.value)}{own} "
                f"and UNIQUE BY ({', '.join(keys)})"
            )


def _join_keys(keys: Sequence[plan.Expr]) -> str:
    written = ", ".join(map(write_in_script, keys))
    return f"({written})" if len(keys) > 1 else written


def _is_graph_bounded(query: plan.Query, stats: Stats) -> bool:
    """Whether the graph of MEMORIZE could have grown further."""
    inner = [node for node in walk(query) if isinstance(node, plan.Query) and node.search is not None]
    levels = [*stats.levels, *stats.backward]
    return len(inner) == 1 and bool(levels) and levels[-1].rows > 0


def _note_undetermined_states(query: plan.Query, dropped: bool) -> Iterator[str]:
    """That a search compares rows which do not tell the state that its clauses read."""
    search = query.search
    assert search is not None
    if search.repeats == "allowed" or search.by != "row":
        return
    found = find_unnamed(query)
    counted = find_growing_states(query, evenly=True)
    read = {expr: clauses for expr, clauses in found.items() if not _is_step_count(expr, clauses, counted, search)}
    # Columns of an element often follow from each other, as a name and its key; then hardly a step is dropped.
    if not (read if dropped else any(isinstance(expr, plan.State) for expr in read)):
        return
    word, names = search.repeats.upper(), join_words(dict.fromkeys(map(write_in_script, read)), "and")
    clauses = join_words(dict.fromkeys(clause for several in read.values() for clause in several), "and")
    verb = "read" if " and " in clauses else "reads"
    lengths = all(isinstance(expr, plan.State) and expr.name in counted for expr in read)
    bounded = search.repeats == "memorize" and lengths
    cure = f"let MEMORIZE bound the paths in place of {names}" if bounded else f"name {names} in SELECT"
    yield (
        f"{word} compares rows, and {clauses} {verb} {names}, which SELECT does not name, "
        f"so paths may be missing or end elsewhere; {cure}"
    )


def _is_step_count(expr: plan.Expr, clauses: tuple[str, ...], counted: frozenset[str], search: plan.Search) -> bool:
    """Whether it only counts steps, where a row that comes again later is not worth more.

    So it is on a path with NO CYCLE, and in STOP WITH where UNIQUE reaches each row by the fewest steps.
    """
    if not isinstance(expr, plan.State) or expr.name not in counted:
        return False
    fewest = search.repeats == "unique" and search.order == "breadth first" and "WHERE" not in clauses
    return search.repeats == "no cycle" or fewest


def note_unread_arguments(arguments: Iterable[str], statements: Sequence[plan.Statement]) -> Iterator[str]:
    """That the script never reads an argument of the run, perhaps because a column has its name."""
    read = {name for statement in statements for name, _ in statement.reads}
    unread = [name for name in arguments if name not in read]
    nodes = [node for statement in statements for node in walk(statement.expr)] if unread else []
    late = (isinstance(node, plan.Call) and node.function.name == "var" for node in nodes)
    if any(late) or any(isinstance(node, (plan.Eval, plan.AssignLate)) for node in nodes):
        return  # these may read anything
    named = (plan.Variable, plan.Temporal, plan.Assign, plan.TemporalAssign, plan.AssignLate)
    read.update(node.name for node in nodes if isinstance(node, named))
    owners = {column: source.name for source in nodes if isinstance(source, plan.SOURCES)
              for column, _ in source.columns or ()}  # fmt: skip
    for name in unread:
        if name in owners and name not in read:
            yield f"{name} is the column of {owners[name]}, not the argument {name}=...; give that another name"
        elif name not in read:
            yield f"the script never reads the argument {name}=..."
