"""The forms of operations as Python: texts of language/operations, parsed once, with the operands in their places.

    Form("{0} + {1}", check=SIZE)        value if -1073741823 <= (value := a + b) <= 1073741823 else check(value)
    Form("{0} < {1}", check=NUMBERS)     a < b if type(a) is (kind := type(b)) and (kind is int or ...) else lt(a, b)
    Form("{0} % {1}", check="{1}")       a % b if b else mod(a, b)

A guard leaves what may be wrong to the function itself, which says so: `a + b` of two integers takes 0.02 us, the guard
as much, a call of `add` 0.15 us. Operands are evaluated once and in their order.
"""

from __future__ import annotations

import ast
import re
import sys
from functools import cache
from typing import Any

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.kinds import Kind
from ss2sql.language.operations import OPERATIONS, PREDICATES, Check, Form
from ss2sql.language.operations.arithmetic import SMALL
from ss2sql.language.plan_traversal import list_choices
from ss2sql.language.value_messages import CURES, check_arithmetic
from ss2sql.runtime.python.ast_builder import AstBuilder
from ss2sql.runtime.python.codegen_context import CodegenContext

MAX_SAFE = 9e18  # a number of unknown kind that is smaller is a value, whatever it is
_NUMBER = Kind.NONE | Kind.NUMBER


def inline_builtin_call(
    node: plan.Call, arguments: list[ast.expr], codegen: CodegenContext, build: AstBuilder
) -> ast.expr | None:
    """The call of a built-in function as an expression of Python's; None where that is the call itself."""
    for form in OPERATIONS[node.function.name].python:
        operands = list_choices(node) if form.spread else node.arguments
        test = form.only or (form.check if node.function.raises or form.check is Check.ROOM else None)
        if not operands or (test is None and node.function.raises) or not form.when([one.type for one in operands]):
            continue
        chosen = _spread_values(node, arguments, len(operands)) if form.spread else arguments
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


def _spread_values(node: plan.Call, values: list[ast.expr], count: int) -> list[ast.expr] | None:
    """What min and max choose from."""
    if isinstance(node.arguments[0], plan.MakeList) and len(values) == 1:
        values = values[0].elts if isinstance(values[0], ast.List) else []
    return values if len(values) == count else None


@dataclass(slots=True)
class Operand:
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
        self.operands = [Operand(one, one) for one in arguments]

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

    def _fill_template_text(self, text: str, value: Operand | None = None) -> ast.expr:
        tree: ast.expr = _fill_template(parse_python(text), self, value)
        return tree

    def _write_tested(self, test: str) -> ast.expr:
        """The value where the test holds, else the call."""
        for operand in self.operands:
            self._name_operand(operand)
        before = self._list_early_tests(test)
        value = None
        if "{value}" in test:
            # What stands in front of the value in the test is evaluated before it.
            front = test.partition("{value}")[0]
            value = self._write_named_value(front)
        condition = self._fill_template_text(test, value)
        if before:
            condition = self.build.join_conditions(ast.And(), [*before, condition])
        called = self._write_plain_call()  # with the operands that the test has not evaluated
        return self.build.if_else(condition, value.again if value else self._fill_text(), called)

    def _write_named_value(self, front: str) -> Operand:
        """The value of the form, to be evaluated where a test first mentions it, behind the operands in `front`."""
        later = {index: operand.first for index, operand in enumerate(self.operands) if f"{{{index}}}" in front}
        for index in later:
            self.operands[index].first = self.operands[index].again
        value = self.hold_value(self._fill_text())
        for index, first in later.items():
            self.operands[index].first = first
        return value

    def _list_early_tests(self, test: str) -> list[ast.expr]:
        """Tests that always hold, and evaluate operands that the test would evaluate too late."""
        text = test.replace("{value}", str(self.form.text)) + str(self.form.text)
        order = list(dict.fromkeys(int(index) for index in re.findall(r"\{(\d)\}", text)))
        held = [operand.first for operand in self.operands if operand.first is not operand.again]
        names = {one.target.id for one in held if isinstance(one, ast.NamedExpr) and isinstance(one.target, ast.Name)}
        shared = any(isinstance(operand.first, ast.Name) and operand.first.id in names for operand in self.operands)
        if order == sorted(order) or (len(held) < 2 and not shared):
            return []
        early = self.operands[: max(order)]
        return [self.build.compare(one.take_expr(), ast.Is(), one.again) for one in early if one.first is not one.again]

    # --- checks ----------------------------------------------------------------------------------------

    def _write_sum(self) -> ast.expr:
        """A sum of texts, or of lists, that is measured where it is long."""
        build, known = self.build, self.types[0]
        if known.is_only(Kind.LIST) and not all(t.item is not None and t.item.is_only(_NUMBER) for t in self.types):
            return build.call(
                self.codegen.read_sizes("add_values", build), *(operand.take_expr() for operand in self.operands)
            )
        value = self.hold_value(self._fill_text())
        most = self.codegen.read_sizes("plain" if known.is_only(Kind.STR) else "cells", build)
        small = build.compare(build.call("len", value.first), ast.LtE(), most)
        return build.if_else(small, value.again, build.call(self.codegen.read_sizes("check_value", build), value.again))

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
            tested = build.bind(kind, build.call("type", odd.take_expr()))
            words = [(tested, "int"), (build.name(kind), "float")]
            tests = [build.join_conditions(ast.Or(), [build.compare(one, ast.Is(), build.name(w)) for one, w in words])]
        else:
            tested = build.call("type", left.take_expr())
            same = build.compare(tested, ast.Is(), build.bind(kind, build.call("type", right.take_expr())))
            numeric = [build.compare(build.name(kind), ast.Is(), build.name(word)) for word in ("int", "float")]
            tests = [same, build.join_conditions(ast.Or(), numeric)]
        result = self._fill_text()
        if self.name not in PREDICATES:
            value = self.hold_value(result)
            within = [value.first, build.constant(SMALL)]
            tests.append(ast.Compare(build.constant(-SMALL), [ast.LtE(), ast.LtE()], within, **build.at))
            result = value.again
        return build.if_else(
            build.join_conditions(ast.And(), tests) if len(tests) > 1 else tests[0], result, self._write_plain_call()
        )

    # --- operands --------------------------------------------------------------------------------------

    def _name_operand(self, operand: Operand) -> None:
        """Gives an operand that is needed more than once a name."""
        held = self.hold_value(operand.first)
        operand.first, operand.again = held.first, held.again

    def hold_value(self, value: ast.expr) -> Operand:
        if isinstance(value, (ast.Name, ast.Constant)):
            return Operand(value, value)
        if isinstance(value, ast.NamedExpr):
            return Operand(value, self.build.name(value.target.id))
        name = self.codegen.new_name("value")
        return Operand(self.build.bind(name, value), self.build.name(name))

    def _write_plain_call(self) -> ast.expr:
        """The call of the function itself, for what the guard does not let through."""
        arguments = [operand.first for operand in self.operands]
        return self.build.call(self.codegen.name_function(self.node.function, self.build), *arguments)


def _fill_template(node: Any, inline: InlineCall, value: Operand | None) -> Any:
    """A text with operands in it: each where it is evaluated first, then its name; an IfExp has its test first."""
    build = inline.build
    match node:
        case ast.Name(id="argument_value"):
            assert value is not None
            return value.take_expr()
        case ast.Name(id=name) if name.startswith("argument_"):
            return inline.operands[int(name[-1])].take_expr()
        case ast.Name(id=name):
            return build.name(name)
        case ast.Call(func=ast.Name(id=name), args=[ast.Starred()]):
            return build.call(name, *(operand.take_expr() for operand in inline.operands))
        case ast.expr():
            parts = {field: _fill_template(part, inline, value) for field, part in ast.iter_fields(node)}
            if isinstance(node, ast.Compare) and isinstance(node.ops[0], ast.IsNot) and _is_literal(parts["left"]):
                return build.constant(True)  # a literal is no None, and Python warns of `1 is not None`
            return type(node)(**parts, **build.at)
        case list():
            return [_fill_template(part, inline, value) for part in node]
    return node


def _is_literal(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and node.value is not None


@cache
def parse_python(text: str) -> ast.expr:
    """The tree of a text. Read it, and copy what you take."""
    return ast.parse(re.sub(r"\{(\w+)\}", r"argument_\1", text.replace("{*}", "*arguments")), mode="eval").body
