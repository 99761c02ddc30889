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

from ss2sql import plan
from ss2sql.kinds import Kind
from ss2sql.language.operations import OPERATIONS, PREDICATES, Check, Form
from ss2sql.language.operations.arithmetic import SMALL
from ss2sql.records import dataclass
from ss2sql.runtime.messages import CURES, check
from ss2sql.runtime.native.pen import Pen
from ss2sql.runtime.native.unit import Unit
from ss2sql.walk import choices

SAFE = 9e18  # a number of unknown kind that is smaller is a value, whatever it is
_NUMBER = Kind.NONE | Kind.NUMBER


def inlined(node: plan.Call, arguments: list[ast.expr], unit: Unit, pen: Pen) -> ast.expr | None:
    """The call of a built-in function as an expression of Python's; None where that is the call itself."""
    for form in OPERATIONS[node.function.name].python:
        given = choices(node) if form.spread else node.arguments
        test = form.only or (form.check if node.function.raises or form.check is Check.ROOM else None)
        if not given or (test is None and node.function.raises) or not form.when([one.type for one in given]):
            continue
        chosen = _spread(node, arguments, len(given)) if form.spread else arguments
        if chosen is None:
            return None
        if _mentions(form, chosen):
            return Inline(node, form, chosen, unit, pen).written(test)
    return None


def _mentions(form: Form, arguments: list[ast.expr]) -> bool:
    """Whether the text evaluates all arguments but constants and variables."""
    text = form.text
    if not isinstance(text, str) or "{*}" in text:
        return True
    named = [one for index, one in enumerate(arguments) if f"{{{index}}}" not in text]
    return all(isinstance(one, (ast.Name, ast.Constant)) for one in named)


def _spread(node: plan.Call, values: list[ast.expr], count: int) -> list[ast.expr] | None:
    """What min and max choose from."""
    if isinstance(node.arguments[0], plan.MakeList) and len(values) == 1:
        values = values[0].elts if isinstance(values[0], ast.List) else []
    return values if len(values) == count else None


@dataclass(slots=True)
class Operand:
    """An operand: what stands where it is evaluated, and what stands for it after that."""

    first: ast.expr
    again: ast.expr

    def next(self) -> ast.expr:
        found, self.first = self.first, self.again
        return found


class Inline:
    """One call to be written by a form; `arguments` are its arguments as Python's."""

    def __init__(self, node: plan.Call, form: Form, arguments: list[ast.expr], unit: Unit, pen: Pen) -> None:
        self.node = node
        self.name = node.function.name
        self.form = form
        self.types = [argument.type for argument in node.arguments]
        self.unit = unit
        self.pen = pen
        self.operands = [Operand(one, one) for one in arguments]

    def written(self, test: str | Check | None) -> ast.expr:
        match test:
            case Check.ROOM:
                return self._joined()
            case None | Check.ITSELF:
                return self._value()
            case Check.SIZE:
                return self._sized()
            case Check.NUMBERS:
                return self._guessed()
            case str():
                return self._tested(test)
            case _:
                raise AssertionError(f"Python has no {test}")

    # --- the text of the form --------------------------------------------------------------------------

    def _value(self) -> ast.expr:
        """The text with the operands in it; of a function: its call."""
        text = self.form.text
        if not isinstance(text, str):
            return self.pen.call(self.unit.helper(text), *(operand.next() for operand in self.operands))
        for index, operand in enumerate(self.operands):
            if text.count(f"{{{index}}}") > 1:
                self._hold(operand)
        return self._filled(text)

    def _filled(self, text: str, value: Operand | None = None) -> ast.expr:
        tree: ast.expr = _copied(parsed(text), self, value)
        return tree

    def _tested(self, test: str) -> ast.expr:
        """The value where the test holds, else the call."""
        for operand in self.operands:
            self._hold(operand)
        before = self._out_of_order(test)
        value = None
        if "{value}" in test:
            # What stands in front of the value in the test is evaluated before it.
            front = test.partition("{value}")[0]
            value = self._held_value(front)
        condition = self._filled(test, value)
        if before:
            condition = self.pen.both(ast.And(), [*before, condition])
        called = self._called()  # with the operands that the test has not evaluated
        return self.pen.either(condition, value.again if value else self._value(), called)

    def _held_value(self, front: str) -> Operand:
        """The value of the form, to be evaluated where a test first mentions it, behind the operands in `front`."""
        later = {index: operand.first for index, operand in enumerate(self.operands) if f"{{{index}}}" in front}
        for index in later:
            self.operands[index].first = self.operands[index].again
        value = self.held(self._value())
        for index, first in later.items():
            self.operands[index].first = first
        return value

    def _out_of_order(self, test: str) -> list[ast.expr]:
        """Tests that always hold, and evaluate operands that the test would evaluate too late."""
        text = test.replace("{value}", str(self.form.text)) + str(self.form.text)
        order = list(dict.fromkeys(int(index) for index in re.findall(r"\{(\d)\}", text)))
        held = [operand.first for operand in self.operands if operand.first is not operand.again]
        names = {one.target.id for one in held if isinstance(one, ast.NamedExpr) and isinstance(one.target, ast.Name)}
        shared = any(isinstance(operand.first, ast.Name) and operand.first.id in names for operand in self.operands)
        if order == sorted(order) or (len(held) < 2 and not shared):
            return []
        early = self.operands[: max(order)]
        return [self.pen.compare(one.next(), ast.Is(), one.again) for one in early if one.first is not one.again]

    # --- checks ----------------------------------------------------------------------------------------

    def _joined(self) -> ast.expr:
        """A sum of texts, or of lists, that is measured where it is long."""
        pen, known = self.pen, self.types[0]
        if known.only(Kind.LIST) and not all(t.item is not None and t.item.only(_NUMBER) for t in self.types):
            return pen.call(self.unit.sizes("added", pen), *(operand.next() for operand in self.operands))
        value = self.held(self._value())
        most = self.unit.sizes("plain" if known.only(Kind.STR) else "cells", pen)
        small = pen.compare(pen.call("len", value.first), ast.LtE(), most)
        return pen.either(small, value.again, pen.call(self.unit.sizes("checked", pen), value.again))

    def _sized(self) -> ast.expr:
        """A number, left to `check` where it may be beyond all values; its type says on which side that can be."""
        pen, kind = self.pen, self.node.type
        near: float = SAFE
        if kind.kinds == Kind.INT:
            near = SMALL
        elif kind.kinds == Kind.FLOAT:
            near = sys.float_info.max
        value = self.held(self._value())
        test: list[ast.expr] = [value.first]
        if kind.low is None:
            test.insert(0, pen.constant(-near))
        if kind.high is None or len(test) == 1:
            test.append(pen.constant(near))
        inside = ast.Compare(test[0], [ast.LtE() for _ in test[1:]], test[1:], **pen.at)
        cure = [pen.constant(CURES[self.name])] if self.name in CURES else []
        return pen.either(inside, value.again, pen.call(self.unit.helper(check), value.again, *cure))

    def _guessed(self) -> ast.expr:
        """Operands of kinds that are not known, as numbers if that is what they are."""
        pen = self.pen
        for operand in self.operands:
            self._hold(operand)
        left, right = self.operands
        kind = self.unit.local("kind")
        known = [one.only(Kind.NUMBER) for one in self.types]
        odd, other = (left, right) if known[1] else (right, left)
        if any(known) and other.first is other.again:
            asked = pen.bind(kind, pen.call("type", odd.next()))
            words = [(asked, "int"), (pen.name(kind), "float")]
            tests = [pen.both(ast.Or(), [pen.compare(one, ast.Is(), pen.name(word)) for one, word in words])]
        else:
            asked = pen.call("type", left.next())
            same = pen.compare(asked, ast.Is(), pen.bind(kind, pen.call("type", right.next())))
            numeric = [pen.compare(pen.name(kind), ast.Is(), pen.name(word)) for word in ("int", "float")]
            tests = [same, pen.both(ast.Or(), numeric)]
        result = self._value()
        if self.name not in PREDICATES:
            value = self.held(result)
            within = [value.first, pen.constant(SMALL)]
            tests.append(ast.Compare(pen.constant(-SMALL), [ast.LtE(), ast.LtE()], within, **pen.at))
            result = value.again
        return pen.either(pen.both(ast.And(), tests) if len(tests) > 1 else tests[0], result, self._called())

    # --- operands --------------------------------------------------------------------------------------

    def _hold(self, operand: Operand) -> None:
        """Gives an operand that is needed more than once a name."""
        held = self.held(operand.first)
        operand.first, operand.again = held.first, held.again

    def held(self, value: ast.expr) -> Operand:
        if isinstance(value, (ast.Name, ast.Constant)):
            return Operand(value, value)
        if isinstance(value, ast.NamedExpr):
            return Operand(value, self.pen.name(value.target.id))
        name = self.unit.local("value")
        return Operand(self.pen.bind(name, value), self.pen.name(name))

    def _called(self) -> ast.expr:
        """The call of the function itself, for what the guard does not let through."""
        given = [operand.first for operand in self.operands]
        return self.pen.call(self.unit.function(self.node.function, self.pen), *given)


def _copied(node: Any, inline: Inline, value: Operand | None) -> Any:
    """A text with operands in it: each where it is evaluated first, then its name; an IfExp has its test first."""
    pen = inline.pen
    match node:
        case ast.Name(id="argument_value"):
            assert value is not None
            return value.next()
        case ast.Name(id=name) if name.startswith("argument_"):
            return inline.operands[int(name[-1])].next()
        case ast.Name(id=name):
            return pen.name(name)
        case ast.Call(func=ast.Name(id=name), args=[ast.Starred()]):
            return pen.call(name, *(operand.next() for operand in inline.operands))
        case ast.expr():
            parts = {field: _copied(part, inline, value) for field, part in ast.iter_fields(node)}
            if isinstance(node, ast.Compare) and isinstance(node.ops[0], ast.IsNot) and _is_literal(parts["left"]):
                return pen.constant(True)  # a literal is no None, and Python warns of `1 is not None`
            return type(node)(**parts, **pen.at)
        case list():
            return [_copied(part, inline, value) for part in node]
    return node


def _is_literal(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and node.value is not None


@cache
def parsed(text: str) -> ast.expr:
    """The tree of a text. Read it, and copy what you take."""
    return ast.parse(re.sub(r"\{(\w+)\}", r"argument_\1", text.replace("{*}", "*arguments")), mode="eval").body
