"""Expressions as Python expressions, operations by their forms.

    Form("{0} + {1}", check=SIZE)        value if -1073741823 <= (value := a + b) <= 1073741823 else check(value)
    Form("{0} < {1}", check=NUMBERS)     a < b if type(a) is (kind := type(b)) and (kind is int or ...) else lt(a, b)
    Form("{0} % {1}", check="{1}")       a % b if b else mod(a, b)

A guard leaves what may be wrong to the function itself, which says so: `a + b` of two integers takes 0.02 us, the guard
as much, a call of `add` 0.15 us. Operands are evaluated once and in their order.

Values in generated code are plain values of the language; nobody changes them, so they are shared. Python's own
operators stand in where types prove that they do what the language says, else the operator's function is called.
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Callable, Hashable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeGuard, assert_never

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.conversion import CURES, check_arithmetic, read_column
from ss2sql.language.kinds import Kind, Type
from ss2sql.language.operations import OPERATIONS, PREDICATES, Check, Form
from ss2sql.language.operations.operators import SMALL
from ss2sql.language.plan_traversal import list_plan_choices
from ss2sql.language.values import SCALARS, make_hashable
from ss2sql.runtime.python.call_code import generate_memoized_call, is_memoized_call
from ss2sql.runtime.python.codegen_context import OWN_GROUP, CodegenContext, PythonScope
from ss2sql.runtime.python.located_code import AstBuilder, copy_tree, locate_in_script, parse_code
from ss2sql.runtime.python.source_lookups import bind_column_reader, bind_element_reader
from ss2sql.runtime.run.post_processing import make_group_aggregation
from ss2sql.runtime.run.run_state import Run
from ss2sql.runtime.run.value_sizes import SMALL_LENGTH

if TYPE_CHECKING:
    from ss2sql.runtime.python.native_query import QueryCompiler


MAX_SAFE = 9e18  # a number of unknown kind that is smaller is a value, whatever it is
_NUMBER = Kind.NONE | Kind.NUMBER


def generate_builtin_inline(
    node: plan.Call, arguments: list[ast.expr], codegen: CodegenContext, build: AstBuilder
) -> ast.expr | None:
    """The call of a built-in function as an expression of Python's; None where that is the call itself."""
    for form in OPERATIONS[node.function.name].python:
        operands = list_plan_choices(node) if form.spread else node.arguments
        test = form.only or (form.check if node.function.raises or form.check is Check.ROOM else None)
        if not operands or (test is None and node.function.raises) or not form.when([one.type for one in operands]):
            continue
        chosen = _generate_min_operands(node, arguments, len(operands)) if form.spread else arguments
        if chosen is None:
            return None
        if _does_evaluate_all(form, chosen):
            return InlineCall(node, form, chosen, codegen, build).write_call(test)
    return None


def _does_evaluate_all(form: Form, arguments: list[ast.expr]) -> bool:
    """Whether the text evaluates all arguments but constants and variables."""
    text = form.text
    if not isinstance(text, str) or "{*}" in text:
        return True
    named = [one for index, one in enumerate(arguments) if f"{{{index}}}" not in text]
    return all(isinstance(one, (ast.Name, ast.Constant)) for one in named)


def _generate_min_operands(node: plan.Call, values: list[ast.expr], count: int) -> list[ast.expr] | None:
    """What min and max choose from."""
    if isinstance(node.arguments[0], plan.MakeList) and len(values) == 1:
        values = values[0].elts if isinstance(values[0], ast.List) else []
    return values if len(values) == count else None


@dataclass(slots=True)
class PythonOperand:
    """An operand: what stands where it is evaluated, and what stands for it after that."""

    first: ast.expr
    again: ast.expr

    def take_expr(self) -> ast.expr:
        found, self.first = self.first, self.again
        return found


class InlineCall:
    """One call to be written by a form; `arguments` are its arguments as Python's."""

    def __init__(
        self, node: plan.Call, form: Form, arguments: list[ast.expr], codegen: CodegenContext, build: AstBuilder
    ) -> None:
        self.node = node
        self.name = node.function.name
        self.form = form
        self.types = [argument.type for argument in node.arguments]
        self.codegen = codegen
        self.build = build
        self.operands = [PythonOperand(one, one) for one in arguments]

    def write_call(self, test: str | Check | None) -> ast.expr:
        match test:
            case Check.ROOM:
                return self._write_sum()
            case None | Check.ITSELF:
                return self._fill_text()
            case Check.SIZE:
                return self._write_size_checked()
            case Check.NUMBERS:
                return self._write_guarded_numbers()
            case str():
                return self._write_tested(test)
            case _:
                raise AssertionError(f"Python has no {test}")

    # --- the text of the form --------------------------------------------------------------------------

    def _fill_text(self) -> ast.expr:
        """The text with the operands in it; of a function: its call."""
        text = self.form.text
        if not isinstance(text, str):
            return self.build.call(self.codegen.use(text), *(operand.take_expr() for operand in self.operands))
        for index, operand in enumerate(self.operands):
            if text.count(f"{{{index}}}") > 1:
                self._name_operand(operand)
        return self._fill_template_text(text)

    def _fill_template_text(self, text: str, value: PythonOperand | None = None) -> ast.expr:
        words = FormWords({f"argument_{index}": operand for index, operand in enumerate(self.operands)})
        if value is not None:
            words["argument_value"] = value
        text = text.replace("{*}", ", ".join(words))
        (line,) = parse_code(re.sub(r"\{(\w+)\}", r"argument_\1", text))
        assert isinstance(line, ast.Expr)
        return copy_tree(line.value, words, self.build.at)

    def _write_tested(self, test: str) -> ast.expr:
        """The value where the test holds, else the call.

        The operands are evaluated first, in their order, by tests that always hold: the test may end early.
        """
        for operand in self.operands:
            self._name_operand(operand)
        held = [operand for operand in self.operands if operand.first is not operand.again]
        tests = [self.build.compare(operand.take_expr(), ast.Is(), operand.again) for operand in held]
        value = self.hold_value(self._fill_text()) if "{value}" in test else None
        tests.append(self._fill_template_text(test, value))
        condition = self.build.join_conditions(ast.And(), tests) if held else tests[0]
        return self.build.if_else(condition, value.again if value else self._fill_text(), self._write_plain_call())

    # --- checks ----------------------------------------------------------------------------------------

    def _write_sum(self) -> ast.expr:
        """A sum of texts, or of lists, that is measured where it is long."""
        build, known = self.build, self.types[0]
        if known.is_only(Kind.LIST) and not all(
            t.element is not None and t.element.is_only(_NUMBER) for t in self.types
        ):
            add = self.codegen.read_sizes("add_values", build)
            return build.call(add, *(operand.take_expr() for operand in self.operands))
        value = self.hold_value(self._fill_text())
        return build.express(
            "again if len(value) <= most else check(again)",
            value=value.first,
            again=value.again,
            most=self.codegen.read_sizes("plain" if known.is_only(Kind.STR) else "cells", build),
            check=self.codegen.read_sizes("check_value", build),
        )

    def _write_size_checked(self) -> ast.expr:
        """A number, left to `check` where it may be beyond all values; its type says on which side that can be."""
        build, kind = self.build, self.node.type
        near: float = MAX_SAFE
        if kind.kinds == Kind.INT:
            near = SMALL
        elif kind.kinds == Kind.FLOAT:
            near = sys.float_info.max
        value = self.hold_value(self._fill_text())
        test: list[ast.expr] = [value.first]
        if kind.low is None:
            test.insert(0, build.constant(-near))
        if kind.high is None or len(test) == 1:
            test.append(build.constant(near))
        inside = ast.Compare(test[0], [ast.LtE() for _ in test[1:]], test[1:], **build.at)
        cure = [build.constant(CURES[self.name])] if self.name in CURES else []
        return build.if_else(inside, value.again, build.call(self.codegen.use(check_arithmetic), value.again, *cure))

    def _write_guarded_numbers(self) -> ast.expr:
        """Operands of kinds that are not known, as numbers if that is what they are."""
        build = self.build
        for operand in self.operands:
            self._name_operand(operand)
        left, right = self.operands
        kind = self.codegen.new_name("kind")
        known = [one.is_only(Kind.NUMBER) for one in self.types]
        odd, other = (left, right) if known[1] else (right, left)
        if any(known) and other.first is other.again:
            test = build.express("(kind := type(odd)) is int or kind is float", kind=kind, odd=odd.take_expr())
        else:
            text = "type(left) is (kind := type(right)) and (kind is int or kind is float)"
            test = build.express(text, kind=kind, left=left.take_expr(), right=right.take_expr())
        result = self._fill_text()
        if self.name not in PREDICATES:
            value = self.hold_value(result)
            text = f"test and {-SMALL} <= value <= {SMALL}"
            test, result = build.express(text, test=test, value=value.first), value.again
        return build.if_else(test, result, self._write_plain_call())

    # --- operands --------------------------------------------------------------------------------------

    def _name_operand(self, operand: PythonOperand) -> None:
        """Gives an operand that is needed more than once a name."""
        held = self.hold_value(operand.first)
        operand.first, operand.again = held.first, held.again

    def hold_value(self, value: ast.expr) -> PythonOperand:
        if isinstance(value, (ast.Name, ast.Constant)):
            return PythonOperand(value, value)
        if isinstance(value, ast.NamedExpr):
            return PythonOperand(value, self.build.name(value.target.id))
        name = self.codegen.new_name("value")
        return PythonOperand(self.build.bind(name, value), self.build.name(name))

    def _write_plain_call(self) -> ast.expr:
        """The call of the function itself, for what the guard does not let through."""
        arguments = [operand.first for operand in self.operands]
        return self.build.call(self.codegen.name_function(self.node.function, self.build), *arguments)


class FormWords(dict[str, PythonOperand]):
    """The operands of a form: each where it is evaluated first, then its name; an IfExp has its test first."""

    def get(self, word: str, default: Any = None) -> Any:
        operand = super().get(word)
        return default if operand is None else operand.take_expr()


# --- expressions as Python expressions
SCALAR_KINDS = Kind.NONE | Kind.NUMBER | Kind.STR  # values that stand for themselves where values are compared

_MEMBERSHIP: dict[str, type[ast.cmpop]] = {"in": ast.In, "not_in": ast.NotIn}


def generate_expression(builder: QueryCompiler, node: plan.Expr, body: PythonScope) -> ast.expr:
    """The Python expression with the node's value, to be evaluated in the innermost open loop of `body`."""
    facts, build = builder.codegen.analysis.facts(node), builder.codegen.build_at(node.span)
    name = body.name_of(facts)
    if name is not None:
        return build.name(name)
    value = _generate_computed(builder, node, body, build)
    if isinstance(node, (plan.Column, plan.MakeList, plan.Aggregate)) or _is_builtin(node):
        return body.name_if_repeated(facts, value, build, _choose_generated_name(node)) if facts.steady else value
    return value


def _is_builtin(node: plan.Expr) -> TypeGuard[plan.Call]:
    return isinstance(node, plan.Call) and node.function.builtin


def _choose_generated_name(node: plan.Column | plan.MakeList | plan.Aggregate | plan.Call) -> str:
    match node:
        case plan.Aggregate(function=name):
            return name
        case plan.Column(name=name):
            return name
        case plan.Call(function=function):
            return function.name
        case _:
            return "list"


def _generate_computed(builder: QueryCompiler, node: plan.Expr, body: PythonScope, build: AstBuilder) -> ast.expr:
    """The expression, whose value has no name yet."""
    codegen = builder.codegen

    def write_part(part: plan.Expr) -> ast.expr:
        return generate_expression(builder, part, body)

    def build_maybe(parts: Sequence[plan.Expr]) -> list[ast.expr]:
        with body.write_skippable():
            return [write_part(part) for part in parts]

    match node:
        case plan.Constant(value=value):
            return _generate_constant(builder, value, build)
        case plan.Variable(name=name, frame=frame):
            return codegen.read_frame(name, build) if frame else codegen.read_variable(name, build)
        case plan.Element(source=source):
            return generate_element(body, source, build)
        case plan.Column():
            return _generate_column(body, node, build)
        case plan.State(query=query, name=name):
            return build.name(body.moved.get((query, name)) or codegen.states[query, name])
        case plan.Call():
            return _generate_call(builder, node, body)
        case plan.And(parts=parts) | plan.Or(parts=parts):
            operator = ast.And() if isinstance(node, plan.And) else ast.Or()
            tested = build.join_conditions(operator, [write_part(parts[0]), *build_maybe(parts[1:])])
            return tested if all(part.type.is_only(Kind.BOOL) for part in parts) else build.truth(tested)
        case plan.Xor(left=left, right=right):
            return build.express("(not left) != (not right)", left=write_part(left), right=write_part(right))
        case plan.Not(operand=operand):
            return build.negate(write_part(operand))
        case plan.If(condition=condition, then=then, otherwise=otherwise):
            tested = write_part(condition)
            return build.if_else(
                tested, *(_generate_sequence(build_maybe(branch), build) for branch in (then, otherwise))
            )
        case plan.MakeList(items=items):
            made = build.array(*(write_part(item) for item in items))
            return made if _is_small_list_in_code(items) else build.call(codegen.read_sizes("check_value", build), made)
        case plan.GroupKey():
            return build.name(body.list_visible_groups[get_group_key(node)])
        case plan.Aggregate(function=function):  # not before it is needed: HAVING may drop what it fails on
            aggregate = make_group_aggregation(node)
            if id(node.argument) in codegen.guarded_arguments:
                aggregate = raise_failed_arguments(aggregate)
            return build.call(
                codegen.embed(aggregate, function),
                build.name(body.list_visible_groups[get_group_key(node)]),
            )
        case plan.Subquery():
            return builder.write_subquery(node, body)
        case plan.Eval():
            return builder.write_eval(node, body)
        case plan.Temporal() | plan.Assign() | plan.TemporalAssign() | plan.AssignLate():
            return _generate_variable_access(builder, node, write_part, build)
        case _:
            assert_never(node)


def _is_small_list_in_code(items: Sequence[plan.Expr]) -> bool:
    """Whether a list of the values is small whatever they are: it holds numbers, or few values.

    Without the look at numbers a search over the steps of water jugs takes four times as long.
    """
    types = [item.type for item in items]
    return all(map(_are_numbers_in_code, types)) or sum(map(_count_nested_values, types)) <= SMALL_LENGTH


def _are_numbers_in_code(known: Type) -> bool:
    """Whether the values are numbers or None, or lists of a known length of such values."""
    if known.is_only(Kind.NONE | Kind.NUMBER):
        return True
    return known.is_only(Kind.LIST) and known.positions is not None and all(map(_are_numbers_in_code, known.positions))


def _count_nested_values(known: Type) -> int:
    """The number of values that one of them is, with those inside of it; more than there may be if nobody knows."""
    if known.is_only(SCALAR_KINDS):
        return 1
    if known.is_only(Kind.LIST) and known.positions is not None:
        return 1 + sum(map(_count_nested_values, known.positions))
    return SMALL_LENGTH + 1


def get_group_key(node: plan.GroupKey | plan.Aggregate) -> tuple[int, int]:
    """What a body's `groups` know the value of a group by: its query, and the position or the node."""
    return (node.query, node.index) if isinstance(node, plan.GroupKey) else (OWN_GROUP, id(node))


class FailedArgument:
    """What stands among the values of an aggregate for one that fails: the exception that is being handled."""

    __slots__ = ("error",)

    def __init__(self) -> None:
        error = sys.exception()
        assert isinstance(error, Exception)
        self.error = locate_in_script(error)  # now, since it looks at the values of the row


def raise_failed_arguments(aggregate: Callable[[list[Any]], Any]) -> Callable[[list[Any]], Any]:
    """The aggregate, which raises the first failure among its values."""

    def aggregate_values(values: list[Any]) -> Any:
        if FailedArgument in map(type, values):
            raise next(value.error for value in values if type(value) is FailedArgument)
        return aggregate(values)

    return aggregate_values


def generate_element(body: PythonScope, source: int, build: AstBuilder) -> ast.expr:
    """The current element of a source; that of rows kept as tuples is made a dict."""
    codegen = body.codegen
    name = codegen.names[source]
    if source in codegen.worlds:
        return build.call(bind_element_reader(codegen, source, build), build.name(name))
    columns = codegen.tuples.get(source)
    if columns is None:
        return build.name(name)
    return build.record(columns, tuple(build.item(build.name(name), index) for index in range(len(columns))))


def _generate_sequence(values: Sequence[ast.expr], build: AstBuilder) -> ast.expr:
    """All values one after the other; the last one is the value."""
    return values[0] if len(values) == 1 else build.item(build.pack(*values), len(values) - 1)


def _generate_constant(builder: QueryCompiler, value: Any, build: AstBuilder) -> ast.expr:
    return build.name(builder.codegen.embed(value)) if isinstance(value, list) else build.constant(value)


def _generate_column(body: PythonScope, node: plan.Column, build: AstBuilder) -> ast.expr:
    codegen = body.codegen
    current = build.name(codegen.names[node.source])
    if node.source in codegen.worlds:
        return build.call(bind_column_reader(codegen, node.source, node.name, build), current)
    if node.source in codegen.single_column_queries:
        return current
    columns = codegen.tuples.get(node.source)
    if columns is not None:
        return build.item(current, columns.index(node.name))
    codegen.page.note_call(node.span, node.name)  # a field may be computed by code of the user's
    text = "read(current, name, None)" if node.declared else "read(current, name)"
    if node.declared and codegen.elements[node.source].is_only(Kind.DICT):
        text = "current.get(name)" if node.type.may_be(Kind.NONE) else "current[name]"
    return build.express(text, read=read_column, current=current, name=build.constant(node.name))


# --- calls ---------------------------------------------------------------------------------------------


def _generate_call(builder: QueryCompiler, node: plan.Call, body: PythonScope) -> ast.expr:
    """A call; what a built-in function makes of a list that stays the same in a loop is computed once."""
    facts, value = builder.codegen.analysis.facts(node), _generate_call_each_time(builder, node, body)
    of_list = node.function.builtin and any(argument.type.may_be(Kind.LIST) for argument in node.arguments)
    if of_list and facts.steady and not _is_item_access(node) and body.find_home(facts) != (body, body.level):
        return body.compute_once(facts, value, builder.codegen.build_at(node.span), node.function.name)
    return value


def _generate_call_each_time(builder: QueryCompiler, node: plan.Call, body: PythonScope) -> ast.expr:
    codegen, function = builder.codegen, node.function
    facts, build = codegen.analysis.facts(node), codegen.build_at(node.place)
    if is_memoized_call(node):
        value = generate_memoized_call(builder, node, body)
        return body.compute_once(facts, value, codegen.build_at(node.span), function.name) if facts.steady else value
    reduced = builder.write_reduction(node, body) if function.builtin else None
    if reduced is not None:
        return reduced
    arguments = [generate_expression(builder, argument, body) for argument in node.arguments]
    if function.builtin:
        members = _generate_membership(builder, node, arguments, body)
        if members is not None:
            return members
        if _is_item_access(node) and (not function.raises or (facts.steady and not facts.calls)):
            if function.raises:
                codegen.page.note_index(node.place, build.pack(*arguments))
            return build.item(arguments[0], arguments[1])
        inline = generate_builtin_inline(node, arguments, codegen, build)
        if inline is not None:
            if isinstance(inline, ast.IfExp):
                body.forget_names(inline.body)
                body.forget_names(inline.orelse)
            return inline
    codegen.page.note_call(node.place, function.name)
    called = build.name(codegen.name_function(function, build))
    given = body.find_arguments(node) if function.vectorized else None
    if given is not None:
        called, arguments = build.part(called, "call_ahead"), [build.name(given), *arguments]
    call = build.call(called, *arguments)
    if function.builtin or not facts.steady:
        return call
    return body.compute_once(facts, call, codegen.build_at(node.span), function.name)


def _is_item_access(node: plan.Call) -> bool:
    """Whether the call takes an element of a list by a whole number, so that nothing can be wrong but the number."""
    if node.function.name != "item":
        return False
    container, index = node.arguments
    return container.type.is_only(Kind.LIST) and index.type.is_only(Kind.INT)


def _generate_membership(
    builder: QueryCompiler, node: plan.Call, arguments: list[ast.expr], body: PythonScope
) -> ast.expr | None:
    """Membership in a list that stays the same for long, by a set of its elements, which is made once."""
    if node.function.name not in _MEMBERSHIP or body.parent is None:
        return None
    item, container = node.arguments
    facts = builder.codegen.analysis.facts(container)
    moves = (
        any(map(body.is_source_visible, facts.sources)) or any(map(body.is_state_visible, facts.states)) or facts.groups
    )
    if not container.type.is_only(Kind.LIST) or not facts.steady or moves:
        return None
    short = isinstance(container, plan.Constant) and len(container.value) <= 8
    known = facts.key is not None or isinstance(container, plan.Subquery)
    if short or isinstance(container, plan.MakeList) or not known:
        return None
    codegen, build = builder.codegen, builder.codegen.build_at(container.span)
    if (
        can_generate_tuple(item.type)
        and container.type.element is not None
        and can_generate_tuple(container.type.element)
    ):
        function, sought = make_list_member_set, generate_tuple(arguments[0], body, build)
    else:
        function, sought = make_member_set, arguments[0]
        if not item.type.is_only(SCALAR_KINDS):
            sought = build.call(codegen.use(make_hashable), sought)
    members = build.call(codegen.use(function), arguments[1])
    key = None if facts.key is None else -1 - facts.key
    kept = body.compute_once(replace(facts, key=key), members, build, "members")
    return build.compare(sought, _MEMBERSHIP[node.function.name](), kept)


def make_member_set(items: list[Any]) -> frozenset[Hashable]:
    """The elements of a list, to ask for quickly."""
    return frozenset(items if SCALARS.issuperset(map(type, items)) else map(make_hashable, items))


def make_list_member_set(items: list[Any]) -> frozenset[Hashable]:
    """The same where they are lists of plain values."""
    return frozenset(map(tuple, items))


def can_generate_tuple(known: Type) -> bool:
    """Whether the values are short lists of plain values, so that tuples stand for them: 0.06 us instead of 0.45."""
    return (
        known.is_only(Kind.LIST)
        and known.positions is not None
        and all(part.is_only(SCALAR_KINDS) for part in known.positions)
    )


def generate_tuple(value: ast.expr, body: PythonScope, build: AstBuilder) -> ast.expr:
    return body.pack(value.elts, build) if isinstance(value, ast.List) else build.call("tuple", value)


# --- script variables ----------------------------------------------------------------------------------


def _generate_variable_access(
    builder: QueryCompiler,
    node: plan.Temporal | plan.Assign | plan.TemporalAssign | plan.AssignLate,
    write_part: Callable[[plan.Expr], ast.expr],
    build: AstBuilder,
) -> ast.expr:
    """Access to variables beyond reading their value."""
    codegen = builder.codegen
    name = build.constant(node.name)
    match node:
        case plan.Assign(value=value):
            return build.express("run.assign_variable(name, value)", name=name, value=write_part(value))
        case plan.Temporal(when=when):
            read = build.constant(None) if when is None else write_part(when)
            text = "run.host.read_temporal(name, read, times)"
            return build.express(text, name=name, read=read, times=node.times)
        case plan.TemporalAssign(keep=keep, value=value):
            parts = [build.name("run"), name, write_part(keep), write_part(value)]
            return build.call(codegen.use(store_run_temporal), *parts)
        case plan.AssignLate(literal=literal):
            return build.express("run.host.bind_late(name, literal)", name=name, literal=codegen.embed(literal))
        case _:
            assert_never(node)


def store_run_temporal(run: Run, name: str, keep: Any, value: Any) -> Any:
    run.host.store_temporal(name, keep, run.copy_for_keeping(value))
    return value
