"""What is visible at a place of a script: the catalog, references to worlds, and suggestions for unknown names.

A query opens one scope. While its clauses are resolved, its sources become visible from left to right, then its START
WITH variables one by one.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import field
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from ss2sql.errors import ResolveError, Span, suggest_names, suggest_similar
from ss2sql.fast_dataclasses import dataclass
from ss2sql.frontend.syntax import ast
from ss2sql.language import plan
from ss2sql.language.conversion import SCALARS, format_value
from ss2sql.language.kinds import ANY, Kind, Type
from ss2sql.language.plan_traversal import walk

if TYPE_CHECKING:
    from inspect import Parameter, Signature

    from ss2sql.frontend.resolve.resolver import Resolver
    from ss2sql.frontend.resolve.search_clauses import PathFunctions


# What an unknown name is: an error R001; a parameter of a script that is compiled; or one of those without a value,
# which is R009, once the run has given the others.
UnknownNames: TypeAlias = Literal["wrong", "parameter", "missing"]


# --- the catalog: functions, variables with their types, tables and representations that scripts can name
@dataclass(slots=True)
class Catalog:
    """All names that a script can refer to."""

    functions: Mapping[str, plan.Function]  # built-in and registered ones
    representations: Iterable[str] = ("dict", "list", "rows", "value", "set", "void")
    variables: Iterable[str] = ()
    variable_type: Callable[[str], Type] = lambda name: Type()  # the type of the present value of one of `variables`
    table: Callable[[str | None, str], plan.TableSource | None] = lambda schema, name: None
    list_tables: Callable[[], Iterable[str]] = tuple  # of the databases, for hints
    other_table: Callable[[str], str | None] = lambda name: None  # of the engine's database -> its variable
    late: Mapping[str, ast.ListLiteral] = field(default_factory=dict)  # resolved where they are used
    unknown: UnknownNames = "wrong"
    worlds: Mapping[str, Any] = field(default_factory=dict)  # name -> the attached world
    world_functions: Mapping[str, plan.Function] = field(default_factory=dict)  # for arguments that may be elements
    frames: Collection[str] = ()  # variables that are data frames
    files: Collection[str] = ()  # names of attached SQLite files
    hidden_columns: Mapping[str, str] = field(default_factory=dict)  # representation -> "elements" or "calls"
    signature: Callable[[str], Signature | None] = lambda name: None  # of a function that is not built in


# --- what is visible at a place of a script; references to worlds: tables, and their columns and methods as functions
# --- lexical scopes: what a name means in the place where it stands
@dataclass(slots=True)
class Scope:
    """The names of one query, inside those of the queries around it."""

    parent: Scope | None
    query: int
    sources: list[plan.Source] = field(default_factory=list)
    states: dict[str, Type] = field(default_factory=dict)
    grouped: bool = False  # whether rows can be aggregated: in SELECT, HAVING and ORDER BY of a GROUP BY
    # The columns of SELECT by their names: in ORDER BY and HAVING; `later`, after all else, in GROUP BY.
    columns: dict[str, plan.Expr] = field(default_factory=dict)
    later: Callable[[str], plan.Expr | None] | None = None
    shown: dict[str, str] = field(default_factory=dict)  # the texts of these columns
    path_functions: PathFunctions | None = None  # of a search: its path functions
    written: ast.Query | None = None

    def enter_clause(self, clause: str) -> str:
        """Sets the clause of a search that is resolved next, for the path functions; gives the one before."""
        if self.path_functions is None:
            return ""
        before, self.path_functions.clause = self.path_functions.clause, clause
        return before

    def copy_scopes(self) -> Scope:
        """A copy of the scope and those around it, which `eval` keeps for its string."""
        parent = None if self.parent is None else self.parent.copy_scopes()
        found = Scope(parent, self.query, list(self.sources), dict(self.states), self.grouped, dict(self.columns))
        found.path_functions = self.path_functions
        return found

    @property
    def depth(self) -> int:
        return sum(1 for _ in list_scopes(self))


def list_scopes(scope: Scope | None) -> Iterator[Scope]:
    """The scope and those around it, innermost first; nothing outside of queries."""
    while scope is not None:
        yield scope
        scope = scope.parent


def resolve_this(source: plan.Source, span: Span) -> plan.Element:
    """`this` of a source."""
    if isinstance(source, plan.TableSource):
        row = Type(Kind.DICT, columns=source.columns)
        return plan.Element(source.id, row, span=span)
    return plan.Element(source.id, source.element, span=span)


def find_first_source(scope: Scope | None, span: Span) -> plan.Source:
    """The source that `this` belongs to: the first one of the innermost query that has any."""
    for level in list_scopes(scope):
        if level.sources:
            return level.sources[0]
    raise ResolveError("R014", "'this' has a meaning inside a query only", span, ("write SELECT ... FROM ...",))


def resolve_source(scope: Scope | None, name: str, span: Span) -> plan.Source:
    """The innermost source with this name."""
    known: list[str] = []
    for level in list_scopes(scope):
        for source in level.sources:
            if source.name == name:
                return source
            known.append(source.name)
    hints = suggest_names(name, known) or (f"name a source in FROM: FROM {name} = ...",)
    raise ResolveError("R003", f"there is no source named '{name}' here", span, hints)


def resolve_source_column(source: plan.Source, name: str, span: Span) -> plan.Column:
    """`source.name`."""
    if source.columns is None:  # a column of a missing row is None, as is one that a row lacks
        missing = isinstance(source, plan.QuerySource) and source.optional
        return plan.Column(source.id, name, declared=missing, span=span)
    for column, kind in source.columns:
        if column == name:
            return plan.Column(source.id, name, kind, span=span)
    known = [column for column, _ in source.columns]
    hints = suggest_names(name, known) or (
        (f"its columns: {', '.join(known)}",) if known else (f"its elements have no columns; write {source.name}.this",)
    )
    if isinstance(source, plan.ValueSource) and source.hides:
        hints = (source.hides,)
    raise ResolveError("R001", f"the source '{source.name}' has no column '{name}'", span, hints)


def resolve_bound_name(scope: Scope | None, name: str, span: Span) -> plan.Expr | None:
    """The START WITH variable, column or column of SELECT that a bare name means, from the innermost query outwards."""
    for level in list_scopes(scope):
        if name in level.columns:
            return level.columns[name]
        if name in level.states:
            return plan.State(level.query, name, level.states[name], span=span)
        owners = [source for source in level.sources if source.columns and name in dict(source.columns)]
        if len(owners) > 1:
            choices = " or ".join(f"{source.name}.{name}" for source in owners)
            raise ResolveError(
                "R004", f"the column '{name}' belongs to {len(owners)} sources", span, (f"write {choices}",)
            )
        if owners:
            return resolve_source_column(owners[0], name, span)
        if level.later is not None and (found := level.later(name)) is not None:
            return found
    return None


def resolve_dotted_name(scope: Scope | None, name: str, span: Span) -> plan.Expr | None:
    """The column or search variable before a dot, where it is no source: `address` in `address.city`."""
    levels = list_scopes(scope)
    if any(source.name == name for level in levels for source in level.sources):
        return None
    return resolve_bound_name(scope, name, span)


def resolve_open_source(scope: Scope | None, name: str, span: Span) -> plan.Source | None:
    """The source that a name must be a column of if it is nothing else: the innermost one whose columns are unknown.

    Raises ResolveError R004 where there are several that no variable can distinguish.
    """
    for level in list_scopes(scope):
        candidates = [source for source in level.sources if source.columns is None]
        if len(candidates) > 1 and not any(map(_reads_variable, candidates)):
            choices = " or ".join(f"{source.name}.{name}" for source in candidates)
            message = f"'{name}' may be a column of {len(candidates)} sources"
            raise ResolveError("R004", message, span, (f"write {choices}",))
        if candidates:
            return candidates[0]
    return None


def is_name_resolution_final(scope: Scope | None, found: plan.Expr | None) -> bool:
    """Whether the meaning of a bare name is final.

    A source whose columns depend on a variable may have one of this name at run time, and then that one comes first.
    """
    for level in list_scopes(scope):
        if found is not None and any(found is column for column in level.columns.values()):
            return True
        if isinstance(found, plan.State) and found.query == level.query:
            return True
        if any(source.columns is None and _reads_variable(source) for source in level.sources):
            return False
        if isinstance(found, plan.Column) and any(source.id == found.source for source in level.sources):
            return True
    return True


def _reads_variable(source: plan.Source) -> bool:
    return any(isinstance(node, plan.Variable) for node in walk(source))


def list_names_in_scope(scope: Scope | None) -> list[str]:
    """All names that a bare name could mean here, for suggestions."""
    names: list[str] = []
    for level in list_scopes(scope):
        names.extend((*level.columns, *filter(str.isidentifier, level.states)))
        for source in level.sources:
            names.extend(column for column, _ in source.columns or ())
    return names


# --- references to worlds: their tables in FROM, their columns and methods as functions of elements
def resolve_world(resolver: Resolver, name: str) -> Any:
    """The attached world of this name, unless the script has given the name another meaning."""
    if name in resolver.assigned or name in resolver.late:
        return None
    return resolver.catalog.worlds.get(name)


def resolve_world_source(
    resolver: Resolver, table: Any, name: str, arguments: tuple[plan.Expr, ...], span: Span
) -> plan.WorldSource:
    source = plan.WorldSource(resolver.make_number(), name, table, arguments, table.element, table.columns, span=span)
    resolver.tables[source.id] = source
    return source


def resolve_world_table(resolver: Resolver, world: Any, word: str, name: str, span: Span) -> plan.WorldSource:
    """`world.table` in FROM."""
    table = _find_table(world, word, span)
    if table.schema.required:
        _refuse_table_call(table, (), span)
    return resolve_world_source(resolver, table, name, (), span)


def resolve_function_source(resolver: Resolver, tree: ast.Call, name: str, scope: Scope) -> plan.Source:
    """`world.function(arguments)` in FROM: a table function, or a function whose value is walked."""
    from ss2sql.frontend.resolve.from_clause import order_arguments, resolve_value_source

    world = resolve_world(resolver, tree.owner or "")
    if world is None or (tree.function not in world.tables and tree.function in world.functions):
        return resolve_value_source(resolver, name, resolver.resolve_expr(tree, scope), tree.span)
    table = _find_table(world, tree.function, tree.span)
    arguments = order_arguments(tree, table.schema.parameters)
    if not table.schema.required <= len(arguments) <= len(table.schema.parameters):
        _refuse_table_call(table, arguments, tree.span)
    return resolve_world_source(resolver, table, name, resolver.resolve_all(arguments, scope), tree.span)


def _find_table(world: Any, word: str, span: Span) -> Any:
    table = world.tables.get(word)
    if table is None:
        hints = suggest_names(word, world.tables) or (f"its tables: {', '.join(world.tables)}",)
        raise ResolveError("R003", f"the world '{world.name}' has no table '{word}'", span, hints)
    return table


def _refuse_table_call(table: Any, arguments: tuple[ast.Expr, ...], span: Span) -> None:
    schema = table.schema
    if not schema.parameters:
        raise ResolveError("R005", f"'{table.title}' takes no arguments", span, (f"write FROM {table.title}",))
    missing = schema.parameters[len(arguments) : schema.required]
    what = f"lacks {' and '.join(missing)}" if missing else f"takes at most {len(schema.parameters)} arguments"
    hint = f"it is called as {table.world_name}.{schema.signature}"
    raise ResolveError("R005", f"'{table.title}' {what}", span, (hint,))


def resolve_world_call(
    resolver: Resolver, name: str, arguments: tuple[plan.Expr, ...], scope: Scope | None, span: Span
) -> plan.Expr:
    """A call of a world's function; for the current element of a source the column itself, or an item of it."""
    source = _resolve_walked_source(arguments[0], scope) if arguments else None
    if source is not None and any(column == name for column, _ in source.columns):
        if len(arguments) == 1:
            return resolve_source_column(source, name, span)
        if _is_item(resolver, source, name, arguments[1:]):
            return resolver.make_call("item", (resolve_source_column(source, name, span), arguments[1]), span, span)
    function = resolver.catalog.world_functions[name]
    check_named_arguments(resolver.catalog, function, arguments)
    resolver.check_arity(function, len(arguments), span)
    return plan.Call(function, arguments, ANY, span=span, place=span)


def check_named_arguments(catalog: Catalog, function: plan.Function, arguments: tuple[plan.Expr, ...]) -> None:
    """Raises ResolveError R005 for `name = expr` where the function has the parameter at another place.

    It is an assignment, whose value is the argument at its own place.
    """
    named = {place: one for place, one in enumerate(arguments) if isinstance(one, plan.Assign)}
    signature = catalog.signature(function.name) if named and not function.builtin else None
    if signature is None:
        return
    parameters = signature.parameters
    places = [name for name, one in parameters.items() if one.kind in (one.POSITIONAL_ONLY, one.POSITIONAL_OR_KEYWORD)]
    by_name = {name for name, one in parameters.items() if one.kind in (one.POSITIONAL_OR_KEYWORD, one.KEYWORD_ONLY)}
    moved = [one for place, one in named.items() if one.name in by_name and places[place : place + 1] != [one.name]]
    if not moved:
        return
    name, wrong = function.of_world or function.name, moved[0]
    if any(one.name not in places for one in moved):
        message = f"'{name}' takes '{wrong.name}' by its name alone, which a script cannot give"
        hint = f"register a function in which '{wrong.name}' has a place"
    else:
        message = f"'{name}' has '{wrong.name}' at place {places.index(wrong.name) + 1}, and arguments go by place"
        texts = {place: one.span.text for place, one in enumerate(arguments) if one not in moved}
        texts |= {places.index(one.name): one.value.span.text for one in moved}
        filled = (texts.get(place) or _write_default(parameters[places[place]]) for place in range(max(texts) + 1))
        hint = f"write {name}({', '.join(filled)})"
    cures = (hint, f"to set the variable as well, write {wrong.span.text}; before it")
    raise ResolveError("R005", message, wrong.span, cures)


def _write_default(parameter: Parameter) -> str:
    """The default of a parameter as a script writes it, or its name."""
    value = list(parameter.default) if isinstance(parameter.default, tuple) else parameter.default
    return format_value(value, 1000) if type(value) in (*SCALARS, list) else parameter.name


def _is_item(resolver: Resolver, source: plan.WorldSource, name: str, following: tuple[plan.Expr, ...]) -> bool:
    """Whether a function is declared to give the item of the column of its name at the second argument."""
    note = resolver.catalog.worlds[source.table.world_name].get_declaration(name)
    length = dict(source.columns)[name].size
    match following:
        case (plan.Constant(value=int(index), type=kind),):
            return note.indexed and length is not None and kind.is_only(Kind.INT) and 0 <= index < length
        case _:
            return False


def _resolve_walked_source(expr: plan.Expr, scope: Scope | None) -> plan.WorldSource | None:
    """The source whose current element the expression is, if that is one of a world."""
    if not isinstance(expr, plan.Element):
        return None
    source = next((one for level in list_scopes(scope) for one in level.sources if one.id == expr.source), None)
    return source if isinstance(source, plan.WorldSource) else None


def resolve_equality(arguments: tuple[plan.Expr, ...], scope: Scope | None) -> tuple[plan.Expr, ...]:
    """The operands of `==` and `!=`: two elements of one table are replaced by keys that are numbers or strings."""
    sources = [_resolve_walked_source(argument, scope) for argument in arguments]
    match sources:
        case [plan.WorldSource(table=one) as first, plan.WorldSource(table=other) as second]:
            same_table = one.schema.keyed is not None and one.schema.keyed is other.schema.keyed
            if same_table and one.key and dict(first.columns)[one.key].kinds in (Kind.INT, Kind.STR):
                pairs = zip((first, second), arguments, strict=True)
                return tuple(resolve_source_column(source, one.key, argument.span) for source, argument in pairs)
    return arguments


def is_function_of_this(resolver: Resolver, name: str, scope: Scope) -> bool:
    """Whether a bare name may be a function that is applied to `this`.

    Where the columns of a source are known only at run time, the name of a column is read as one.
    """
    assert scope.sources, "a query has a source, and one that is unknown ends it"
    if name in resolver.catalog.functions:
        return True
    if name not in resolver.catalog.world_functions:
        return False
    return not any(source.columns is None for level in list_scopes(scope) for source in level.sources)


# --- suggestions for unknown names: functions of SQL and Python, methods, strings without quotes
_HIDDEN = frozenset({"item", "slice", "like"})  # functions that are written as operators
_MEAN = "did you mean '{0}'?"

# Functions that other languages have, and what is written here; {0} and {1} are the arguments of the call.
FOREIGN_FUNCTIONS: dict[str, str] = {
    **dict.fromkeys(("ifnull", "nvl", "isnull"), "write coalesce({0}, {1})"),
    "nullif": "write IF({0} == {1}; None; {0})",
    "iif": "write IF({0}; {1}; {2})", "decode": "write CASE WHEN {0} == {1} THEN {2} ELSE {3} END",
    "concat": "write {sum}",
    **dict.fromkeys(("substr", "substring", "mid"), "write {0}[{slice}]"),
    "left": "write {0}[:{1}]", "right": "write {0}[-{1}:]", "to_char": "write str({0})",
    **dict.fromkeys(("to_char/2", "date_format"), "{parts} datetime({0})"), "date_part": "{parts} datetime({1})",
    **dict.fromkeys(("strftime", "date_trunc"), "{parts} datetime({1})"),
    "trunc": "write int({0})", "truncate": "write int({0})",
    "trunc/2": "write int({0} * 10 ^ {1}) / 10 ^ {1}", "truncate/2": "write int({0} * 10 ^ {1}) / 10 ^ {1}",
    "sign": "write CASE WHEN {0} > 0 THEN 1 WHEN {0} < 0 THEN -1 ELSE 0 END", "total": "write sum({0})",
    "initcap": "session.function('initcap', str.title) registers Python's",
    "mode": "session.function('mode', statistics.mode) registers Python's",
    **dict.fromkeys(("rollup", "cube"), "run a query for each GROUP BY, and join their lists with +"),
    "array_agg": "write ({rows})", "rpad": "format('{{:<20}}', {0}) puts blanks behind until there are 20 characters",
    "to_number": "write float({0})", "connect_by_root": "write root({0})", "group_concat/1": "write join({rows}, ',')",
    **dict.fromkeys(("lpad/blank", "rpad/blank"), "write join(SELECT ' ' FROM range({1}) AS list, '')"),
    "length": "write len({0})", "size": "write len({0})", "avg": "write average({0})", "mean": "write average({0})",
    "distinct": "write uniq({0})", "unique": "write uniq({0})", "set": "write uniq({0})",
    "power": "write {0} ^ {1}", "exists": "write [] != ({list})",
    "sys_connect_by_path": "write path({0}, {1})", "append": "a list is not changed, a new one is made: {0} + [{1}]",
    "cast": "write int({0}), float({0}) or str({0})",
    "extend": "a list is not changed, a new one is made: {0} + {1}",
    **dict.fromkeys(("ucase", "toupper"), "write upper({0})"),
    **dict.fromkeys(("lcase", "tolower"), "write lower({0})"),
    "trim": "write strip({0})", "startswith": "write starts({0}, {1})", "endswith": "write ends({0}, {1})",
    **dict.fromkeys(("instr", "strpos"), "write find({0}, {1}) + 1"), "charindex": "write find({1}, {0}) + 1",
    **dict.fromkeys(("group_concat", "string_agg", "listagg"), "write join({rows}, {1})"),
    "least": "write min({all})", "greatest": "write max({all})", "position": "write find(text, part) + 1",
    **dict.fromkeys(("char_length", "character_length"), "write len({0})"), "contains": "write {1} IN {0}",
    "lpad": "format('{{:>20}}', {0}) puts blanks in front until there are 20 characters",
    "ceiling": "write ceil({0})", "ln": "write log({0})", "log2": "write log({0}, 2)", "log10": "write log({0}, 10)",
    "atan": "write atan2({0}, 1)", "radians": "write {0} * pi() / 180", "degrees": "write {0} * 180 / pi()",
    "hypot": "write norm([{0}, {1}])", "std": "write stddev({0})", "stdev": "write stddev({0})",
    "var_samp": "write variance({0})", "stddev_samp": "write stddev({0})", "typeof": "write type({0})",
    "strptime": "write datetime('2024-05-31 12:30')", "current_timestamp": "write now()", "today": "write date(now())",
    **dict.fromkeys(("rand", "random"), "session.function('random', random.random) registers Python's"),
    "gcd": "session.function('gcd', math.gcd) registers Python's", "current_date": "write date(now())",
    "enumerate": "write zip(range(len({0})), {0})", "values": "write [{all}]",
}  # fmt: skip
CHOOSE_LEAVES = "SELECT * FROM (SELECT LAST ..., leaf() AS end ...) WHERE end"
# Names of Oracle.
_ORACLE = {
    "LEVEL": "level()", "CONNECT_BY_ISLEAF": "leaf()", "CONNECT_BY_ISCYCLE": "cycle({key})",
    "ROWNUM": "LIMIT n after the other clauses",
    "CURRENT_DATE": "date(now())", "SYSDATE": "now()", "CURRENT_TIMESTAMP": "now()",
}  # fmt: skip


def explain_unknown_function(
    tree: ast.Call, catalog: Catalog, variables: Collection[str], scope: Scope | None
) -> ResolveError:
    """The error for a call of an unknown function."""
    name = tree.function
    every = (*catalog.functions, *catalog.world_functions)
    known = [one for one in every if one not in _HIDDEN and one.isidentifier()]
    if name in variables:
        hints: Sequence[str] = (f"'{name}' is a variable: write it without parentheses",)
    elif same := [one for one in known if one.lower() == name.lower()]:
        hints = (_MEAN.format(same[0]),)
    else:
        rows = f"{_suggest_rows(tree, scope, name.lower() != 'array_agg', grouped=True)} AS list"
        hints = _suggest_equivalent(name, tree.arguments, f"uniq({rows})" if tree.distinct else rows)
        hints = hints or suggest_names(name, known)
    hints = hints or ("register it with session.function, or by --functions FILE.py; help() lists the known ones",)
    return ResolveError("R002", f"unknown function '{name}'", read_leading_name(tree.span, name), hints)


def _suggest_equivalent(name: str, arguments: Sequence[ast.Expr], rows: str = "SELECT ... AS list") -> tuple[str, ...]:
    """The equivalent of a function of another language. `rows` is the query for what an aggregate takes."""
    lowered = name.lower()
    if lowered not in FOREIGN_FUNCTIONS:
        return ()
    whole = [argument.span.text for argument in arguments[:4]]
    shape = "blank" if len(whole) == 2 and whole[0] in ("' '", '" "') else len(arguments)
    form = FOREIGN_FUNCTIONS.get(f"{lowered}/{shape}", FOREIGN_FUNCTIONS[lowered])
    texts = [text if len(text) <= 40 else "..." for text in whole]
    bare = bool(arguments) and isinstance(arguments[0], ast.Query) and arguments[0].representation is None
    listed = f"{texts[0]} AS list" if bare else "SELECT ... AS list"
    texts += ["..."] * (4 - len(texts))
    every = [argument.span.text for argument in arguments] or ["..."]
    named = {"list": listed, "rows": rows, "all": ", ".join(every), "sum": " + ".join(every)}
    named |= {"slice": _write_slice(whole[1:3]), "parts": "year(d), month(d), ... hour(d) are the parts of a time d ="}
    return (form.format(*texts, **named),)


def _write_slice(bounds: Sequence[str]) -> str:
    """The slice for the first character, from 1, or from -1 at the end, and the number of characters, if written."""
    first, *length = bounds or ["1"]
    begin = first if first.startswith("-") else str(int(first) - 1) if first.isdigit() else f"{first} - 1"
    if not length:
        return f"{begin}:"
    if begin.lstrip("-").isdigit() and length[0].isdigit():
        end = int(begin) + int(length[0])
        return f"{begin}:{end if end or begin == '0' else ''}"
    return f"{begin}:{begin} + {length[0]}"


def explain_method(tree: ast.Call, catalog: Catalog, variables: Collection[str]) -> ResolveError:
    """The error for `owner.function(...)` where the owner is no world or lacks the function."""
    owner, name = tree.owner or "", tree.function
    place = read_leading_name(tree.span, f"{owner}.{name}")
    world = catalog.worlds.get(owner)
    if world is not None:
        message = f"the world '{owner}' has no function '{name}'"
        return ResolveError("R002", message, place, list_world_hints(world, name))
    hints: tuple[str, ...]
    if owner in variables:
        return ResolveError(
            "R002", f"values have no methods, and '{owner}' is no world", place, _suggest_call(tree, catalog)
        )
    message = f"there is no world '{owner}' with a function '{name}'"
    if suggest_similar(owner, catalog.worlds):
        hints = suggest_names(owner, catalog.worlds)
    elif name in catalog.functions:
        hints = (f"'{name}' is a function by itself: write {name}(...)",)
    else:
        hints = _suggest_equivalent(name, tree.arguments) or ("help() lists the functions there are",)
    return ResolveError("R002", message, place, hints)


def list_world_hints(world: Any, name: str) -> tuple[str, ...]:
    """How a script uses what a world has of this name, or what it has in its place."""
    if name in world.functions:
        return (f"'{name}' is a function: write {world.name}.{name}(...)",)
    for word, table in world.tables.items():
        written = f"FROM {table.title}{'(...)' if table.schema.parameters else ''}"
        if word == name:
            return (f"'{name}' is a table: write {written}",)
        if name in table.schema.kinds:
            return (f"'{name}' is a column: write SELECT {name} {written}",)
    return suggest_names(name, (*world.tables, *world.names)) or (f"help({world.name}) lists what it has",)


def _suggest_call(tree: ast.Call, catalog: Catalog) -> tuple[str, ...]:
    """The call that replaces a method of a value."""
    owner, name = tree.owner or "", tree.function
    subject = ast.Name(owner, span=read_leading_name(tree.span, owner))
    there = _suggest_equivalent(name, (subject, *tree.arguments))
    if name.lower() in FOREIGN_FUNCTIONS:
        return there
    call = f"write {name}({owner}{', ...' if tree.arguments else ''})"
    return (call,) if name in catalog.functions else (f"{call}, with a function that is registered", *there)


def explain_unknown_name(
    name: str, span: Span, catalog: Catalog, known: Sequence[str], scope: Scope | None, operand: bool
) -> ResolveError:
    """The error for an unknown bare name; as an operand it may be meant as a string."""
    sources = [source for level in list_scopes(scope) for source in level.sources]
    shown = next((level.shown[name] for level in list_scopes(scope) if name in level.shown), None)
    holding = [one for one in sources if not isinstance(one, plan.TableSource) and one.element.may_be(Kind.OBJECT)]
    hints: tuple[str, ...]
    if shown is not None:
        hints = (f"'{name}' is a column that SELECT makes; write {shown} here",)
    elif name in catalog.functions:
        takes = "this" if scope else "..."
        hints = (f"'{name}' is a function: write {name}({takes if catalog.functions[name].maximum != 0 else ''})",)
        hints += (f"its name as a text is '{name}'",) if operand and not scope else ()
    elif name in catalog.world_functions and holding and catalog.unknown != "missing":
        this = "this" if len(sources) == 1 else f"{holding[0].name}.this"
        hints = (f"'{name}' is a function of elements, too: write {name}({this})",)
    elif any(source.name == name for source in sources):
        hints = (f"'{name}' is a source: write {name}.this",)
    elif name.upper() in _ORACLE:
        hints = (f"write {_ORACLE[name.upper()]}".format(key=_write_search_key(scope)),)
        hints += (f"to choose by it write {CHOOSE_LEAVES}",) if name.upper() == "CONNECT_BY_ISLEAF" else ()
    elif name.upper() in ("NULL", "NIL"):
        hints = ("write None",)
    elif catalog.unknown == "missing":
        hints = (f"run(..., {name}=...)", *suggest_names(name, known))
        return ResolveError("R009", f"unknown name '{name}', so the script needs a value for it", span, hints)
    else:
        cure = f"assign it before, or give it a value: run(script, {name}=...), on a command line -p {name} VALUE"
        hints = suggest_names(name, known)
        hints += tuple(one.hides for one in sources if isinstance(one, plan.ValueSource) and one.hides)
        alone = [source.name for source in sources if _is_object_variable(source)]
        hints += tuple(f"'{one}' is one object; of a data frame let a function return to_dict('list')" for one in alone)
        if operand and not alone and not suggest_similar(name, known):
            hints += (f"a text stands in quotes: '{name}'",)
        if not alone and (operand or not hints):
            hints += (cure,)
    return ResolveError("R001", f"unknown name '{name}'", span, hints)


def _write_search_key(scope: Scope | None) -> str:
    """What the search around a place compares, if it has a key."""
    searches = (level.path_functions.search for level in list_scopes(scope) if level.path_functions is not None)
    return next((search.key[0].span.text for search in searches if search is not None and search.key), "key")


def _is_object_variable(source: plan.Source) -> bool:
    """Whether a source is a variable that holds an object of Python, which stands in FROM as one row."""
    value = source.value if isinstance(source, plan.ValueSource) else None
    return isinstance(value, plan.Variable) and value.type.is_only(Kind.OBJECT)


def read_leading_name(span: Span, name: str) -> Span:
    """The span of `name`, if `span` begins with it."""
    return Span(span.source, span.start, span.start + len(name)) if span.text.startswith(name) else span


def suggest_row_query(tree: ast.Call, scope: Scope | None, skips_none: bool) -> str:
    """The query that gives an aggregate the rows that are left by the WHERE around it, if short."""
    return f"{tree.function}({_suggest_rows(tree, scope, skips_none)} AS list)"


def _suggest_rows(tree: ast.Call, scope: Scope | None, skips_none: bool, grouped: bool = False) -> str:
    """The rows that are left by the WHERE around a call; `grouped`: those of its group; perhaps without None."""
    query, sources = (scope.written, scope.sources) if scope else (None, [])
    simple = query is not None and not query.searches and len(sources) == 1 and bool(tree.arguments)
    if query is None or not simple or sources[0].name != sources[0].span.text:
        return "SELECT ..."
    rows, where, keys = sources[0].name, query.where, query.group if grouped else ()
    conditions: list[str] = []
    if where is not None and not where.span.start <= tree.span.start < where.span.end:
        conditions.append(f"({where.span.text})" if isinstance(where, ast.Or) else where.span.text)
    if keys and (not all(isinstance(key, ast.Name) for key in keys) or f"{rows}." in " ".join(conditions)):
        return "SELECT ..."
    conditions += [f"{key.span.text} == {rows}.{key.span.text}" for key in keys]
    conditions += [f"{tree.arguments[0].span.text} != None"] * skips_none
    behind = f" WHERE {' AND '.join(conditions)}" if conditions else ""
    text = " ".join(f"SELECT {tree.arguments[0].span.text} FROM {'x = ' * bool(keys)}{rows}{behind}".split())
    return text if len(text) <= 100 else "SELECT ..."
