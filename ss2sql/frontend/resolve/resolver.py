"""The resolver, from syntax tree to plan: names are bound, calls get their functions, expressions their types.

`resolve` is the stage; `resolve_eval` does the same for the string of an `eval`, in the scope that the plan kept for
it. Expressions are resolved here, queries in frontend/resolve/query_clauses.py. All errors are collected: an expression
that fails is replaced by a placeholder.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, assert_never

from ss2sql.errors import ResolveError, Span, combine_errors, suggest_names
from ss2sql.frontend.resolve.grouping import resolve_count
from ss2sql.frontend.resolve.scope import (
    Catalog,
    Scope,
    check_named_arguments,
    explain_method,
    explain_unknown_function,
    explain_unknown_name,
    find_first_source,
    is_name_resolution_final,
    list_names_in_scope,
    list_scopes,
    list_world_hints,
    resolve_bound_name,
    resolve_dotted_name,
    resolve_equality,
    resolve_open_source,
    resolve_source,
    resolve_source_column,
    resolve_this,
    resolve_world,
    resolve_world_call,
    suggest_row_query,
)
from ss2sql.frontend.resolve.search_clauses import FUNCTIONS as PATH_FUNCTIONS
from ss2sql.frontend.resolve.search_clauses import (
    RESULT_CLAUSES,
    is_path_function,
    resolve_path_function,
    suggest_in_search,
)
from ss2sql.frontend.syntax import ast
from ss2sql.frontend.syntax.tokenizer import shorten_query
from ss2sql.language import plan
from ss2sql.language.kinds import ANY, BOOL, NONE, Kind, Type, make_list_type, type_of, unite
from ss2sql.language.operations import GROUPS, OPERATIONS
from ss2sql.language.plan_traversal import is_volatile, walk

if TYPE_CHECKING:
    from ss2sql.frontend.inlining import Inliner

# What is written for a comparison with ALL rows of a query, or with ANY (False).
_SOME = "([] != ({{query}} AS list) AND {{x}} {{sign}} {0}({{query}} AS list))"  # of no rows ANY is false, ALL true
_EVERY = "([] == ({{query}} AS list) OR {{x}} {{sign}} {0}({{query}} AS list))"
QUANTIFIED = {
    ("eq", False): "{x} IN ({query})", ("ne", True): "{x} NOT IN ({query})",
    ("ne", False): "difference({query} AS list, [{x}]) != []", ("eq", True): "difference({query} AS list, [{x}]) == []",
    **dict.fromkeys((("lt", False), ("le", False)), _SOME.format("max")),
    **dict.fromkeys((("gt", False), ("ge", False)), _SOME.format("min")),
    **dict.fromkeys((("lt", True), ("le", True)), _EVERY.format("min")),
    **dict.fromkeys((("gt", True), ("ge", True)), _EVERY.format("max")),
}  # fmt: skip
AGGREGATE_HINT = "it works on a list: {query}, or on the groups of a GROUP BY"


def resolve(script: ast.Script, catalog: Catalog) -> plan.Program:
    """The plan of a script.

    Raises ResolveError with every unknown name, wrong call and misplaced construct that was found.
    """
    resolver = Resolver(catalog)
    statements = tuple(resolver.resolve_statement(statement) for statement in script.statements)
    resolver.raise_errors()
    return plan.Program(statements, tuple(resolver.parameters), resolver.parameters)


FIRST_EVAL_ID = 1_000_000  # the first number in strings of `eval`; scripts have smaller ones


def resolve_eval(script: ast.Script, scope: Scope | None, catalog: Catalog) -> tuple[plan.Expr, ...]:
    """The statements of a string given to `eval`, resolved in its place; they see a row, never its group."""
    levels = list(list_scopes(scope))
    around = [number for level in levels for number in (level.query, *(source.id for source in level.sources))]
    resolver, scope = Resolver(catalog, max(FIRST_EVAL_ID, *around, 0)), scope and replace(scope, grouped=False)
    expressions = tuple(resolver.resolve_statement(statement, scope).expr for statement in script.statements)
    resolver.raise_errors()
    return expressions


class Resolver:
    """The state of one resolution: the errors so far, and what the current statement relies on."""

    def __init__(self, catalog: Catalog, base: int = 0) -> None:
        self.catalog = catalog
        self.errors: list[ResolveError] = []
        self.parameters: dict[str, tuple[Span, tuple[str, ...]]] = {}  # see plan.Program.mentions
        self.assigned: dict[str, Type] = {}  # variables that earlier statements assign
        self.late = dict(catalog.late)
        self.reading: list[str] = []  # the late lists that are being resolved, outermost first
        self.reads: dict[str, Type] = {}
        self.tables: dict[int, plan.TableSource | plan.WorldSource] = {}
        self.tentative = False
        self.numbers = base

    @cached_property
    def inliner(self) -> Inliner:
        """What replaces calls of functions whose bodies are known; most scripts have none."""
        from ss2sql.frontend.inlining import Inliner

        return Inliner()

    def refine_call(self, call: plan.Call, scope: Scope | None = None) -> plan.Call:
        """The call with the type of the expression that its function computes, where that is known."""
        if call.function.body is None:
            return call
        for level in list_scopes(scope):
            self.inliner.sources.update((source.id, source) for source in level.sources)
        return self.inliner.refine_type(call)

    def make_number(self) -> int:
        """A new number for a source or query, larger than all that are visible."""
        self.numbers += 1
        return self.numbers

    def raise_errors(self) -> None:
        if self.errors:
            raise combine_errors(self.errors)

    def refuse(self, code: str, message: str, span: Span | None, *hints: str) -> None:
        """Records an error, after which the resolution goes on."""
        self.errors.append(ResolveError(code, message, span, hints))

    def record_errors(
        self, function: Callable[[ast.Expr, Scope | None], plan.Expr], tree: ast.Expr, scope: Scope | None
    ) -> plan.Expr:
        """`function(tree, scope)`; a ResolveError is recorded and a placeholder returned."""
        try:
            return function(tree, scope)
        except ResolveError as error:
            self.errors.append(error)
            return plan.Constant(None, ANY, span=tree.span)

    def resolve_statement(self, tree: ast.Expr, scope: Scope | None = None) -> plan.Statement:
        """The plan of a statement; later statements know what it assigns."""
        self.reads, self.tables, self.tentative = {}, {}, False
        nested = [node.name for node in _find_assignments(tree) if node is not tree]
        for name in nested:
            # Its value changes while the statement runs, so its type is unknown.
            self.assigned[name] = ANY
            self.late.pop(name, None)
        expr = self.record_errors(self.resolve_expr, tree, scope)
        if isinstance(expr, plan.Assign):
            self.assigned[expr.name] = ANY if expr.name in nested else expr.value.type
            self.late.pop(expr.name, None)
        return plan.Statement(
            expr, tuple(self.reads.items()), tuple(self.tables.values()), self.tentative, span=tree.span
        )

    # --- expressions -----------------------------------------------------------------------------------

    def resolve_expr(self, tree: ast.Expr, scope: Scope | None) -> plan.Expr:
        """The plan of an expression. Raises its first own ResolveError, records those of its parts."""
        span = tree.span
        match tree:
            case ast.Literal(value=value):
                return plan.Constant(value, type_of(value), span=span)
            case ast.Name(name=name):
                return self.resolve_name(name, scope, span)
            case ast.This():
                return self.resolve_this(tree, scope)
            case ast.Attribute(source=source, name=name):
                if source is not None and (row := resolve_dotted_name(scope, source, span)) is not None:
                    return self.make_call("item", (row, plan.Constant(name, type_of(name), span=span)), span, span)
                owner = find_first_source(scope, span) if source is None else self.find_source(tree, source, scope)
                return self.resolve_element_call(name, owner, scope, span) or resolve_source_column(owner, name, span)
            case ast.ListLiteral():
                return self.list_literal(tree, scope)
            case ast.Call():
                return self.call_tree(tree, scope)
            case ast.Index(value=value, index=index):
                return self.make_call("item", self.resolve_all((value, index), scope), span, index.span)
            case ast.Slice(value=value, lower=lower, upper=upper):
                bounds = (bound or ast.Literal(None, span=span) for bound in (lower, upper))
                return self.make_call("slice", self.resolve_all((value, *bounds), scope), span, span)
            case ast.Operator(function=function, operands=operands, place=place):
                if function in ("in", "not_in"):
                    arguments = self.resolve_values(operands[:1], scope) + self.resolve_operands(
                        (resolve_as_list(operands[1]),), scope
                    )
                else:
                    self._refuse_quantifier(tree)
                    arguments = self.resolve_values(operands, scope)
                compared = function in ("eq", "ne") and self.catalog.functions[function].builtin
                return self.make_call(
                    function, resolve_equality(arguments, scope) if compared else arguments, span, place
                )
            case ast.Between():
                return self.resolve_between(tree, scope)
            case ast.And(parts=parts):
                return plan.And(self.resolve_all(parts, scope), span=span)
            case ast.Or(parts=parts):
                return plan.Or(self.resolve_all(parts, scope), span=span)
            case ast.Xor(left=left, right=right):
                one, other = self.resolve_all((left, right), scope)
                return plan.Xor(one, other, span=span)
            case ast.Not(operand=operand):
                return plan.Not(self.record_errors(self.resolve_expr, operand, scope), span=span)
            case ast.If():
                return self.resolve_if(tree, scope)
            case ast.Assign():
                return self.resolve_assignment(tree, scope)
            case ast.TemporalAssign(name=name, keep=keep, value=value):
                kept, new = self.resolve_all((keep, value), scope)
                self.assigned[name] = ANY
                self.late.pop(name, None)
                return plan.TemporalAssign(name, kept, new, new.type, span=span)
            case ast.Temporal(name=name, when=when):
                return self.resolve_temporal(name, when, scope, span)
            case ast.Query():
                from ss2sql.frontend.resolve.query_clauses import resolve_query

                return resolve_query(self, tree, scope)
            case _:
                assert_never(tree)

    def resolve_all(self, trees: Iterable[ast.Expr], scope: Scope | None) -> tuple[plan.Expr, ...]:
        return tuple(self.record_errors(self.resolve_expr, tree, scope) for tree in trees)

    def resolve_operands(self, trees: Iterable[ast.Expr], scope: Scope | None) -> tuple[plan.Expr, ...]:
        """Operands, or the arguments of a call; an unknown name may be meant as a string without quotes."""
        return tuple(self.record_errors(self._resolve_operand, tree, scope) for tree in trees)

    def _resolve_operand(self, tree: ast.Expr, scope: Scope | None) -> plan.Expr:
        if isinstance(tree, ast.Name):
            return self.resolve_name(tree.name, scope, tree.span, operand=True)
        return self.resolve_expr(tree, scope)

    def resolve_values(self, trees: Sequence[ast.Expr], scope: Scope | None) -> tuple[plan.Expr, ...]:
        """Operands of an operator; a query without AS is one value, see `resolve_as_value`."""
        pairs = list(zip(trees, self.resolve_operands(map(resolve_as_value, trees), scope), strict=True))
        lists = any(value.type.kinds == Kind.LIST for tree, value in pairs if not is_value_syntax(tree))
        for tree in filter(is_value_syntax, trees if lists else ()):
            message = "this query is one value here, and it meets a list"
            self.refuse("R014", message, tree.span, f"write ({shorten_query(tree.span.text)} AS list)")
        return tuple(self.unwrap_single(value) if is_value_syntax(tree) else value for tree, value in pairs)

    def resolve_number(self, tree: ast.Expr, scope: Scope | None) -> plan.Expr:
        """What has to be a number, such as LIMIT: a query without AS is one value, see `resolve_as_value`."""
        return self.resolve_values((tree,), scope)[0] if is_value_syntax(tree) else self.resolve_expr(tree, scope)

    def _refuse_quantifier(self, tree: ast.Operator) -> None:
        """Raises ResolveError R014 for `x > ALL (SELECT ...)`: here `all` and `any` ask whether elements are true."""
        match tree.operands:
            case (left, ast.Call(function=name, arguments=(ast.Query(representation=None) as query,), owner=None)):
                function, word = self.catalog.functions.get(name), name.lower()
                form = QUANTIFIED.get((tree.function, word == "all")) if word in ("all", "any", "some") else None
                if form is not None and (function is None or function.builtin):
                    text = shorten_query(query.span.text)
                    sign = tree.place.text if tree.place else ""
                    message = f"there is no {sign} {name.upper()} in SelectScript"
                    hint = f"write {form.format(x=left.span.text, sign=sign, query=text)}"
                    raise ResolveError("R014", message, tree.span, (hint,))

    def unwrap_single(self, value: plan.Expr) -> plan.Expr:
        """A query's list as one value: its only element, None of an empty list."""
        if not isinstance(value, plan.Subquery) or value.query.representation.name == "value":
            return value
        row = OPERATIONS["single"]
        kind = row.result((value.type,))
        return plan.Call(row.make_function((value.type,)), (value,), kind, span=value.span, place=value.span)

    def resolve_name(self, name: str, scope: Scope | None, span: Span, operand: bool = False) -> plan.Expr:
        meaning = self.find_bound(name, scope, span) or self.find_variable(name, span)
        if meaning is not None:
            return meaning
        dynamic = resolve_open_source(scope, name, span)
        if dynamic is not None:
            return resolve_source_column(dynamic, name, span)
        if self.catalog.unknown == "parameter":
            known = (*list_names_in_scope(scope), *self.assigned, *self.catalog.variables)
            self.parameters.setdefault(name, (span, known))
            self.reads[name] = ANY
            return plan.Variable(name, ANY, span=span)
        known = (*list_names_in_scope(scope), *self.list_variables(), *self.parameters)
        error = explain_unknown_name(name, span, self.catalog, known, scope, operand)
        error.hints = suggest_in_search(name, span, scope) or error.hints
        raise error

    def find_bound(self, name: str, scope: Scope | None, span: Span) -> plan.Expr | None:
        """The START WITH variable or column that a bare name means, as far as columns are known."""
        found = resolve_bound_name(scope, name, span)
        if not is_name_resolution_final(scope, found):
            self.tentative = True
        return found

    def list_variables(self) -> list[str]:
        """The names of all script variables and attached sources."""
        return [*self.assigned, *self.catalog.variables]

    def find_variable(self, name: str, span: Span) -> plan.Variable | None:
        """The script variable of this name, if there is one."""
        if name in self.late:
            raise ResolveError(
                "R011",
                f"'{name}' is a list that mentions sources, so it has no value of its own",
                span,
                (f"use it as a source: FROM {name}, in a query inside one that has these sources",),
                ((self.late[name].span, "the list stands here"),),
            )
        if name in self.assigned:
            # A user's function may run a script that assigns it: the statement relies on its type.
            self.reads.setdefault(name, self.assigned[name])
            return plan.Variable(name, self.assigned[name], span=span)
        if name in self.catalog.variables:
            if name not in self.reads:
                self.reads[name] = self.catalog.variable_type(name)
            return plan.Variable(name, self.reads[name], span=span)
        return None

    def find_source(self, tree: ast.Attribute, name: str, scope: Scope | None) -> plan.Source:
        """The source that a column belongs to."""
        try:
            return resolve_source(scope, name, tree.span)
        except ResolveError as error:
            world = resolve_world(self, name)
            if world is not None:
                error.hints = list_world_hints(world, tree.name)
            elif scope is not None and (inner := _find_nameless_query(scope, name)) is not None:
                error.hints = (f"write {name} = {inner} to name the source",)
            elif name in self.list_variables():
                error.hints = (f'write {name}["{tree.name}"]', f"of a list: SELECT {tree.name} FROM {name} AS list")
            raise

    def resolve_this(self, tree: ast.This, scope: Scope | None) -> plan.Expr:
        if tree.source is not None:
            return resolve_this(resolve_source(scope, tree.source, tree.span), tree.span)
        return resolve_this(find_first_source(scope, tree.span), tree.span)

    def list_literal(self, tree: ast.ListLiteral, scope: Scope | None) -> plan.Expr:
        items = self.resolve_all(tree.items, scope)
        if all(isinstance(item, plan.Constant) for item in items):
            value = [item.value for item in items if isinstance(item, plan.Constant)]
            return plan.Constant(value, type_of(value), span=tree.span)
        return plan.MakeList(items, make_list_type([item.type for item in items]), span=tree.span)

    def resolve_between(self, tree: ast.Between, scope: Scope | None) -> plan.Expr:
        """`low <= value AND value <= high`; a value that must be evaluated once becomes the source of a query."""
        value, low, high = self.resolve_values((tree.value, tree.low, tree.high), scope)
        if not is_volatile(value) and not any(isinstance(node, plan.Query) for node in walk(value)):
            return self._make_range_test(value, low, high, tree)
        source, span = self.make_number(), tree.value.span
        items = plan.MakeList((value,), make_list_type([value.type]), span=span)
        one = plan.ValueSource(source, "value", items, value.type, (), span=span)
        column = plan.Output(
            "value", self._make_range_test(plan.Element(source, value.type, span=span), low, high, tree)
        )
        form = plan.Representation("value")
        return plan.Subquery(
            plan.Query(self.make_number(), (one,), (column,), representation=form, span=span), BOOL, span=span
        )

    def _make_range_test(self, value: plan.Expr, low: plan.Expr, high: plan.Expr, tree: ast.Between) -> plan.Expr:
        ends = ("ge", low), ("le", high)
        parts = tuple(self.make_call(name, (value, end), tree.span, tree.place) for name, end in ends)
        return plan.And(parts, span=tree.span)

    def resolve_if(self, tree: ast.If, scope: Scope | None) -> plan.Expr:
        condition = self.record_errors(self.resolve_expr, tree.condition, scope)
        default = {True: tree.then, False: tree.otherwise}
        branches = [
            self.resolve_all(default[value] or (ast.Literal(value, span=tree.span),), scope) for value in (True, False)
        ]
        kind = unite(branch[-1].type for branch in branches)
        return plan.If(condition, branches[0], branches[1], kind, span=tree.span)

    def resolve_assignment(self, tree: ast.Assign, scope: Scope | None) -> plan.Expr:
        for level in list_scopes(scope):
            if tree.name in level.states:
                raise ResolveError(
                    "R007",
                    f"'{tree.name}' is a variable of the search and changes in CONNECT BY only",
                    tree.name_span,
                    ("compare with ==, or move the assignment to CONNECT BY",),
                )
        if scope is None and isinstance(tree.value, ast.ListLiteral) and _mentions_source_syntax(tree.value):
            self.late[tree.name] = tree.value
            return plan.AssignLate(tree.name, tree.value, NONE, span=tree.span)
        value = self.record_errors(self.resolve_expr, tree.value, scope)
        return plan.Assign(tree.name, value, value.type, span=tree.span)

    def resolve_temporal(self, name: str, when: ast.Expr | None, scope: Scope | None, span: Span) -> plan.Expr:
        if self.find_variable(name, span) is None:
            known = [*self.assigned, *self.catalog.variables]
            hints = (*suggest_names(name, known), f"store a value with {name}{{5.0}} = ...")
            raise ResolveError("R001", f"unknown temporal variable '{name}'", span, hints)
        moment = None if when is None else self.record_errors(self.resolve_expr, when, scope)
        return plan.Temporal(name, moment, ANY, span=span)

    def resolve_times(self, reading: ast.Expr, scope: Scope | None, span: Span) -> plan.Expr:
        """`times(v{...})`: the reading that gives the times in place of the values."""
        found = self.resolve_expr(reading, scope)
        if not isinstance(found, plan.Temporal) or found.times:
            hint = "write times(v{}) for the times of v{}, which v{5.0} = ... stores"
            raise ResolveError("R014", "times takes a reading of a temporal variable", span, (hint,))
        return replace(found, times=True, span=span)

    # --- calls -----------------------------------------------------------------------------------------

    def call_tree(self, tree: ast.Call, scope: Scope | None) -> plan.Expr:
        name, span = tree.function, tree.span
        if tree.owner is not None:
            return self.call_of_world(tree, tree.owner, scope)
        if name in PATH_FUNCTIONS and is_path_function(self, tree):
            return resolve_path_function(self, tree, scope)
        function = self.catalog.functions.get(name)
        known: tuple[plan.Expr, ...] | None = None  # resolved once: nested calls would double the work with every level
        if name in self.catalog.world_functions and (function is None or function.builtin):
            known = self.resolve_operands(tree.arguments, scope)
            if function is None or any(
                a.type.may_be(Kind.OBJECT) or a.type.kinds == Kind.STR for a in known
            ):  # or its name
                return resolve_world_call(self, name, known, scope, span)
        if function is None:
            error = explain_unknown_function(tree, self.catalog, self.list_variables(), scope)
            error.hints = suggest_in_search(name, span, scope) or error.hints
            raise error
        if function.builtin and name == "to":
            hint = "write it around a whole column of SELECT, and the expression itself here"
            raise ResolveError("R014", "to(expr, name) names a column and stands in SELECT", span, (hint,))
        if function.builtin and name == "times":
            self.check_arity(function, len(tree.arguments), span)
            return self.resolve_times(tree.arguments[0], scope, span)
        if function.builtin and name == "join" and tree.arguments and is_value_syntax(tree.arguments[0]):
            query = tree.arguments[0].span
            hint = f"write {shorten_query(query.text)} AS list, with one column"
            message = "join joins the values of a list, and the rows of a query are dicts"
            raise ResolveError("R014", message, query, (hint,))
        grouped = scope is not None and scope.grouped
        if tree.star:
            return resolve_count(function, grouped, None, span)
        arguments = self.resolve_operands(tree.arguments, scope) if known is None else known
        if tree.distinct:
            return resolve_count(function, grouped, arguments[0], span)
        if function.builtin and name == "eval":
            self.check_arity(function, len(arguments), span)
            return self.resolve_eval(arguments[0], scope, span)
        of_a_list = len(arguments) == 1 or (function.collects and arguments)
        if is_resolved_aggregate(function) and of_a_list and not grouped and arguments[0].type.excludes(Kind.LIST):
            hints = [
                AGGREGATE_HINT.format(query=suggest_row_query(tree, scope, not arguments[0].type.excludes(Kind.NONE)))
            ]
            if scope is not None and scope.path_functions and scope.path_functions.clause in RESULT_CLAUSES:
                hints = [*suggest_in_search(name, span, scope)]
                hints.append(f"write {name}(path({tree.arguments[0].span.text})) for the steps of the path")
                hints.append(f"write SELECT LAST ... GROUP BY 1 for {name} of the last steps of all paths")
            raise ResolveError("R008", f"{name} needs a list, and this is not one", span, tuple(hints))
        return self.refine_call(self.make_call(name, arguments, span, span), scope)

    def resolve_element_call(self, name: str, source: plan.Source, scope: Scope | None, span: Span) -> plan.Expr | None:
        """`source.name`, where the elements are objects without columns, perhaps those of a world."""
        if source.columns or source.columns is None or name not in self.catalog.world_functions:
            return None
        element = resolve_this(source, span)
        return resolve_world_call(self, name, (element,), scope, span) if element.type.may_be(Kind.OBJECT) else None

    def call_of_world(self, tree: ast.Call, owner: str, scope: Scope | None) -> plan.Expr:
        """`owner.function(arguments)`."""
        world = self.catalog.worlds.get(owner)
        if world is None or tree.function not in world.names:
            raise explain_method(tree, self.catalog, [*list_names_in_scope(scope), *self.list_variables()])
        own = f"{owner}.{tree.function}"
        name = own if own in self.catalog.world_functions else tree.function
        return resolve_world_call(self, name, self.resolve_all(tree.arguments, scope), scope, tree.span)

    def make_call(self, name: str, arguments: tuple[plan.Expr, ...], span: Span, place: Span) -> plan.Call:
        """The call of a function that exists, with the type of its result."""
        function = self.catalog.functions[name]
        check_named_arguments(self.catalog, function, arguments)
        self.check_arity(function, len(arguments), place)
        kind = ANY
        if function.builtin:
            types = tuple(argument.type for argument in arguments)
            kind, function = OPERATIONS[name].result(types), OPERATIONS[name].make_function(types)
        return plan.Call(function, arguments, kind, span=span, place=place)

    def check_arity(self, function: plan.Function, number: int, span: Span) -> None:
        if number >= function.minimum and (function.maximum is None or number <= function.maximum):
            return
        low, high = function.minimum, function.maximum
        if low == high:
            wanted = f"{low} argument{'' if low == 1 else 's'}"
        else:
            wanted = f"{low} or more arguments" if high is None else f"{low} to {high} arguments"
        name = function.of_world or function.name
        hint = (f"help('{name}') shows how it is called",)
        if function.builtin:
            rows = ", or count(*) for the rows of a group" if name == "count" else ""
            hint = (f"it is called as {OPERATIONS[name].call}{rows}",)
        raise ResolveError("R005", f"'{name}' takes {wanted}, not {number}", span, hint)

    def resolve_eval(self, text: plan.Expr, scope: Scope | None, span: Span) -> plan.Expr:
        sources: list[int] = []
        states: list[tuple[int, str]] = []
        for level in list_scopes(scope):
            sources.extend(source.id for source in level.sources)
            states.extend((level.query, name) for name in level.states)
        kept = scope.copy_scopes() if scope else None
        return plan.Eval(text, kept, tuple(sources), tuple(states), ANY, span=span)


def is_resolved_aggregate(function: plan.Function) -> bool:
    """Whether the function aggregates when it is called on the rows of a group."""
    return function.collects or (function.builtin and function.name in GROUPS)


def _find_nameless_query(scope: Scope, name: str) -> str | None:
    """The text of a query in FROM that has no name and reads this source."""
    for level in list_scopes(scope):
        for part in level.written.sources if level.written is not None else ():
            if part.name is None and isinstance(part.expr, ast.Query):
                read = {source.name or source.expr.span.text for source in part.expr.sources}
                if name in read:
                    return f"({shorten_query(part.expr.span.text)})"
    return None


def _find_assignments(tree: Any) -> list[ast.Assign]:
    """Every assignment to a script variable inside a syntax tree, without those of START WITH and CONNECT BY."""
    nodes = list(ast.walk_syntax(tree))
    own = {id(part) for node in nodes if isinstance(node, ast.Query) for part in (*node.start, *node.connect)}
    return [node for node in nodes if isinstance(node, ast.Assign) and id(node) not in own]


def _mentions_source_syntax(tree: ast.Expr) -> bool:
    """Whether a list literal outside any query mentions `this` or `source.column`, outside of nested queries."""
    parts = ast.walk_syntax(tree, lambda part: isinstance(part, ast.Query))
    return any(isinstance(part, ast.This | ast.Attribute) for part in parts)


# --- a query without AS among values
def is_value_syntax(tree: ast.Expr) -> bool:
    return isinstance(tree, ast.Query) and tree.representation is None


def resolve_as_value(tree: ast.Expr) -> ast.Expr:
    """An operand: a query without AS is the value of its single column, None without a row; two rows are an error.

    Raises ResolveError where it has several columns, or is a search.
    """
    if not isinstance(tree, ast.Query) or tree.representation is not None:
        return tree
    _check_single_column(
        tree,
        ("a value is meant here", "write SELECT LAST for the value of a last step"),
        ("a query that is one value has one column", "write AS list to compare with a list"),
    )
    one = (ast.is_row_count_syntax(tree.columns) and not tree.group) or tree.limit == ast.Literal(1, span=tree.span)
    two = ast.Literal(2, span=tree.span) if tree.limit is None and not one else tree.limit
    form = ast.Representation("value" if one else "list", (), (), span=tree.span)
    return replace(tree, limit=two, representation=form)


def resolve_as_list(tree: ast.Expr) -> ast.Expr:
    """The right operand of IN: a query without AS is the list of its single column."""
    if not isinstance(tree, ast.Query) or tree.representation is not None:
        return tree
    _check_single_column(
        tree,
        ("right of IN stands a list of values", "write SELECT LAST for the values of the last steps"),
        (
            "right of IN a query without AS has one column",
            "write AS rows to look for a list of values in a list of rows",
        ),
    )
    return replace(tree, representation=ast.Representation("list", (), (), span=tree.span))


def _check_single_column(tree: ast.Query, of_search: tuple[str, str], of_columns: tuple[str, str]) -> None:
    """Raises ResolveError R014 where a query gives paths or several columns; what is meant there, and the cure."""
    if tree.searches and not tree.last:
        meant, cure = of_search
        hint = f"{cure}, or add AS list to compare with whole paths"
        raise ResolveError("R014", f"{meant}, and a search gives paths", tree.span, (hint,))
    if len(tree.columns) > 1 or isinstance(tree.columns[0], ast.Star):
        message, cure = of_columns
        raise ResolveError("R014", message, tree.span, (f"name one column, or {cure}",))
