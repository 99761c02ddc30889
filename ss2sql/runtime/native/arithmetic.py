"""Built-in functions as Python's own operators and functions.

Where the types do not rule an error out, a guard in front of the operator, or behind it, leaves what may be wrong to
the function itself, which says so: `a + b` of two integers takes 0.02 us, the guard as much, a call of `add` 0.15 us.
Operands are evaluated once and in their order.
"""

from __future__ import annotations

import ast
import math
import operator
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain

from ss2sql import plan
from ss2sql.kinds import INT_MAX, INT_MIN, NOTHING, Kind, Type
from ss2sql.runtime import operator_types
from ss2sql.runtime.library import total_of_floats, total_of_integers
from ss2sql.runtime.messages import CURES, check
from ss2sql.runtime.native.pen import Pen
from ss2sql.runtime.native.unit import Unit
from ss2sql.walk import choices

_INTEGER = operator_types.INTEGER
_NUMBER = Kind.NONE | Kind.NUMBER
_PLAIN = Kind.NONE | Kind.NUMBER | Kind.STR

_SMALL = 2**30 - 1  # integers up to here are compared in half the time; larger ones are left to `check`
_SAFE = 9e18  # a number of unknown kind that is smaller is a value, whatever it is
_MOST_FACTORS = 8  # of a power that is worth a guard

_EQUALITY: dict[str, type[ast.cmpop]] = {"eq": ast.Eq, "ne": ast.NotEq}
_ORDER: dict[str, type[ast.cmpop]] = {"lt": ast.Lt, "le": ast.LtE, "gt": ast.Gt, "ge": ast.GtE}
_MEMBERSHIP: dict[str, type[ast.cmpop]] = {"in": ast.In, "not_in": ast.NotIn}
_SIGNS: dict[str, type[ast.operator]] = {
    "add": ast.Add,
    "sub": ast.Sub,
    "mul": ast.Mult,
    "div": ast.Div,
    "mod": ast.Mod,
    "pow": ast.Pow,
}
_BOUNDED: dict[str, operator_types.Operation] = {"add": operator.add, "sub": operator.sub, "mul": operator.mul}

# Functions that do what Python's of this name does to arguments of these kinds, where they cannot fail.
_SAME: dict[str, tuple[str, Kind]] = {
    "abs": ("abs", Kind.NUMBER),
    "int": ("int", Kind.NUMBER),
    "float": ("float", Kind.NUMBER),
    "str": ("str", _PLAIN),
    "len": ("len", Kind.LIST | Kind.STR | Kind.DICT),
    "count": ("len", Kind.LIST),
}


def inlined(node: plan.Call, arguments: list[ast.expr], unit: Unit, pen: Pen) -> ast.expr | None:
    """The call of a built-in function as an expression of Python's; None where that is the call itself."""
    return Inline(node, arguments, unit, pen).written()


@dataclass(slots=True)
class Operand:
    """An operand: what stands where it is evaluated, and what stands for it after that."""

    first: ast.expr
    again: ast.expr


class Inline:
    """One call to be written; `arguments` are its arguments as Python's."""

    def __init__(self, node: plan.Call, arguments: list[ast.expr], unit: Unit, pen: Pen) -> None:
        self.node = node
        self.name = node.function.name
        self.arguments = arguments
        self.types = [argument.type for argument in node.arguments]
        self.unit = unit
        self.pen = pen

    def written(self) -> ast.expr | None:
        name = self.name
        if name in _EQUALITY:
            return self._compared(_EQUALITY[name])
        if name in _ORDER:
            known = self._are(Kind.NUMBER) or self._are(Kind.STR)
            return self._compared(_ORDER[name]) if known else self._guessed()
        if name in _MEMBERSHIP and (self.types[1].only(Kind.LIST) or self._are(Kind.STR)):
            return self._compared(_MEMBERSHIP[name])
        if name == "item":
            return self._item()
        if name in ("min", "max"):
            return self._extreme()
        if name == "sqrt" and self._are(Kind.NUMBER):
            return self._square_root()
        if name == "distance" and self._are_points():
            return self._distance()
        if name == "sum" and self.types[0].only(Kind.LIST):
            return self._total()
        if not self.node.function.raises:
            return self._certain()
        if self._are(Kind.NUMBER):
            return self._guarded()
        return self._guessed() if name in _BOUNDED else None

    def _are(self, kinds: Kind) -> bool:
        """Whether all arguments are of these kinds."""
        return all(kind.only(kinds) for kind in self.types)

    def _compared(self, sign: type[ast.cmpop]) -> ast.expr:
        return self.pen.compare(self.arguments[0], sign(), self.arguments[1])

    def _certain(self) -> ast.expr | None:
        """A call that cannot fail."""
        name, pen = self.name, self.pen
        if name == "add" and (self._are(Kind.STR) or self._are(Kind.LIST)):
            return self._joined()
        if name == "pow" and self._are(_INTEGER) and _is_two(self.node.arguments[1]):
            base = self._held(self.arguments[0])
            return pen.binary(base.first, ast.Mult(), base.again)
        if name in _SIGNS and self._are(Kind.NUMBER):
            return pen.binary(self.arguments[0], _SIGNS[name](), self.arguments[1])
        if name == "neg" and self._are(Kind.NUMBER):
            return pen.unary(ast.USub(), self.arguments[0])
        same = _SAME.get(name)
        if same is not None and self._are(same[1]):
            return pen.call(same[0], *self.arguments)
        return None

    def _joined(self) -> ast.expr:
        """A sum of texts, or of lists, that is measured where it is long."""
        pen, known = self.pen, self.types[0]
        if known.only(Kind.LIST) and not all(t.item is not None and t.item.only(_NUMBER) for t in self.types):
            return pen.call(self.unit.sizes("added", pen), *self.arguments)
        value = self._held(pen.binary(self.arguments[0], ast.Add(), self.arguments[1]))
        most = self.unit.sizes("plain" if known.only(Kind.STR) else "cells", pen)
        small = pen.compare(pen.call("len", value.first), ast.LtE(), most)
        return pen.either(small, value.again, pen.call(self.unit.sizes("checked", pen), value.again))

    # --- guards ----------------------------------------------------------------------------------------

    def _guarded(self) -> ast.expr | None:
        """A call with numbers that may fail."""
        name, pen = self.name, self.pen
        if name in _BOUNDED:
            results = operator_types.results(_BOUNDED[name], self.types)
            raw = pen.binary(self.arguments[0], _SIGNS[name](), self.arguments[1])
            return self._checked(raw, results)
        if name == "neg":
            return self._checked(pen.unary(ast.USub(), self.arguments[0]), None)
        if name == "abs":
            return self._checked(pen.call("abs", self.arguments[0]), None)
        if name == "int":
            return self._checked(pen.call("int", self.arguments[0]), [(Kind.INT, [-math.inf, math.inf])])
        if name == "pow":
            return self._power()
        return self._divided() if name in ("div", "mod") else None

    def _checked(self, raw: ast.expr, results: list[tuple[Kind, list[float]]] | None) -> ast.expr:
        """A result, left to `check` where it may be beyond all values; the bounds say on which side that can be."""
        pen = self.pen
        kinds = {kind for kind, _ in results or ()}
        corners = [corner for _, corners in results or () for corner in corners]
        least: float = -_SAFE
        most: float = _SAFE
        near: float = _SAFE
        if kinds == {Kind.INT}:
            least, most, near = INT_MIN, INT_MAX, _SMALL
        elif kinds == {Kind.FLOAT}:
            least, most, near = -sys.float_info.max, sys.float_info.max, sys.float_info.max
        value = self._held(raw)
        test: list[ast.expr] = []
        if not corners or min(corners) < least:
            test.append(pen.constant(-near))
        test.append(value.first)
        if not corners or max(corners) > most or len(test) == 1:
            test.append(pen.constant(near))
        inside = ast.Compare(test[0], [ast.LtE() for _ in test[1:]], test[1:], **pen.at)
        cure = [pen.constant(CURES[self.name])] if self.name in CURES else []
        return pen.either(inside, value.again, pen.call(self.unit.helper(check), value.again, *cure))

    def _guessed(self) -> ast.expr | None:
        """Operands of kinds that are not known, as numbers if that is what they are."""
        pen = self.pen
        if not all(kind.may(Kind.INT | Kind.FLOAT) for kind in self.types):
            return None
        left, right = map(self._held, self.arguments)
        kind = self.unit.local("kind")
        known = [one.only(Kind.NUMBER) for one in self.types]
        odd, other = (left, right) if known[1] else (right, left)
        if any(known) and other.first is other.again:
            asked = pen.bind(kind, pen.call("type", odd.first))
            words = [(asked, "int"), (pen.name(kind), "float")]
            tests = [pen.both(ast.Or(), [pen.compare(one, ast.Is(), pen.name(word)) for one, word in words])]
        else:
            same = pen.compare(pen.call("type", left.first), ast.Is(), pen.bind(kind, pen.call("type", right.first)))
            numeric = [pen.compare(pen.name(kind), ast.Is(), pen.name(word)) for word in ("int", "float")]
            tests = [same, pen.both(ast.Or(), numeric)]
        if self.name in _ORDER:
            result = pen.compare(left.again, _ORDER[self.name](), right.again)
        else:
            value = self._held(pen.binary(left.again, _SIGNS[self.name](), right.again))
            tests.append(self._between(pen.constant(-_SMALL), value.first, pen.constant(_SMALL), ast.LtE()))
            result = value.again
        test = self._all(tests)
        return pen.either(test, result, self._called(left.again, right.again))

    def _power(self) -> ast.expr | None:
        """A small power that is known."""
        exponent, pen = self.node.arguments[1], self.pen
        match exponent:
            case plan.Constant(value=int() as times) if 1 < times <= _MOST_FACTORS:
                limit: float = min(int(INT_MAX ** (1 / times)) - 1, _SMALL)
            case _:
                return None
        if self.types[0].only(Kind.FLOAT):
            limit = float(limit)
        base = self._held(self.arguments[0])
        small = self._between(pen.constant(-limit), base.first, pen.constant(limit), ast.Lt())
        if self.types[0].only(_INTEGER) and times == 2:
            power = pen.binary(base.again, ast.Mult(), base.again)  # a third of the time of `** 2`
        else:
            power = pen.binary(base.again, ast.Pow(), self.arguments[1])
        return pen.either(small, power, self._called(base.again, self.arguments[1]))

    def _divided(self) -> ast.expr:
        """A quotient or remainder: the divisor may be zero, and the quotient of floats beyond all floats."""
        pen = self.pen
        left, right = self._held(self.arguments[0]), self._held(self.arguments[1])
        tests = [right.first]
        if left.first is not left.again:  # a number is not None; so it is evaluated before the divisor
            tests.insert(0, pen.compare(left.first, ast.IsNot(), pen.constant(None)))
        result = pen.binary(left.again, _SIGNS[self.name](), right.again)
        if self.name == "div" and not self._are(_INTEGER):
            quotient = self._held(result)
            most = sys.float_info.max
            tests.append(self._between(pen.constant(-most), quotient.first, pen.constant(most), ast.LtE()))
            result = quotient.again
        test = self._all(tests)
        return pen.either(test, result, self._called(left.again, right.again))

    def _square_root(self) -> ast.expr:
        pen, root = self.pen, self.unit.helper(math.sqrt)
        if not self.node.function.raises:
            return pen.call(root, self.arguments[0])
        value = self._held(self.arguments[0])
        test = pen.compare(value.first, ast.GtE(), pen.constant(0))
        return pen.either(test, pen.call(root, value.again), self._called(value.again))

    def _are_points(self) -> bool:
        """Whether all arguments are lists of numbers, equally long."""
        parts = [kind.positions or () for kind in self.types if kind.only(Kind.LIST)]
        if len(parts) < len(self.types) or len(set(map(len, parts))) != 1:
            return False
        return all(part.only(Kind.NUMBER) for part in chain.from_iterable(parts)) and bool(parts[0])

    def _distance(self) -> ast.expr:
        pen, dist = self.pen, self.unit.helper(math.dist)
        if not self.node.function.raises:
            return pen.call(dist, *self.arguments)
        one, other = map(self._held, self.arguments)
        value = self._held(pen.call(dist, one.first, other.first))
        test = pen.compare(value.first, ast.LtE(), pen.constant(sys.float_info.max))
        return pen.either(test, value.again, self._called(one.again, other.again))

    # --- lists -----------------------------------------------------------------------------------------

    def _item(self) -> ast.expr | None:
        """An element of a list, or the value of a dict's key; a negative index that is not known is left to `item`."""
        pen, (container, index) = self.pen, self.types
        if index.only(Kind.STR) and container.may(Kind.DICT):
            kind, word = Kind.DICT, "dict"
        elif index.only(Kind.INT) and container.may(Kind.LIST):
            kind, word = Kind.LIST, "list"
        else:
            return None
        whole, part = self._held(self.arguments[0]), self._held(self.arguments[1])
        tests: list[ast.expr] = []
        value = whole.first
        if part.first is not part.again:  # what an element is taken of is not its place; so it is evaluated before it
            tests.append(pen.compare(whole.first, ast.IsNot(), part.first))
            value = whole.again
        if not container.only(kind):
            tests.append(pen.compare(pen.call("type", value), ast.Is(), pen.name(word)))
            value = whole.again
        tests.append(self._is_inside(part.again, value, kind))
        test = self._all(tests)
        found = pen.item(whole.again, part.again)
        return pen.either(test, found, self._called(whole.again, part.again))

    def _is_inside(self, part: ast.expr, value: ast.expr, kind: Kind) -> ast.expr:
        pen, position = self.pen, self.node.arguments[1]
        if kind is Kind.DICT:
            return pen.compare(part, ast.In(), value)
        length = pen.call("len", value)
        match position:
            case plan.Constant(value=int() as known) if known < 0:
                return pen.compare(length, ast.GtE(), pen.constant(-known))
            case plan.Constant():
                return pen.compare(length, ast.Gt(), part)
        return self._between(length, part, pen.constant(-1), ast.Gt())

    def _extreme(self) -> ast.expr | None:
        """The least or the greatest of several numbers: of two by a comparison."""
        pen, chosen, values = self.pen, choices(self.node), self.arguments
        if isinstance(self.node.arguments[0], plan.MakeList) and len(values) == 1:
            values = values[0].elts if isinstance(values[0], ast.List) else []
        elif len(values) == 1:
            return self._extreme_of_list()
        types = [value.type for value in chosen]
        if not values or len(values) != len(chosen):
            return None
        if not _are_alike(types):
            return None
        if len(values) == 1:
            return values[0]
        if len(values) > 2:
            return pen.call(self.name, *values)
        one, other = map(self._held, values)
        sign = ast.LtE() if self.name == "min" else ast.GtE()
        return pen.either(pen.compare(one.first, sign, other.first), one.again, other.again)

    def _extreme_of_list(self) -> ast.expr | None:
        known = self.types[0]
        if not known.only(Kind.LIST) or known.item is None or not _are_alike([known.item]):
            return None
        items = self._held(self.arguments[0])
        return self.pen.either(items.first, self.pen.call(self.name, items.again), self.pen.constant(None))

    def _total(self) -> ast.expr | None:
        """A sum of integers, or of floats; of no floats it would be an integer."""
        known = self.types[0]
        if known.item is None or known.item == NOTHING:
            return None
        if known.item.only(_INTEGER):
            return self.pen.call(self.unit.helper(total_of_integers), self.arguments[0])
        if known.item.only(Kind.FLOAT) and known.positions:
            return self.pen.call(self.unit.helper(total_of_floats), self.arguments[0])
        return None

    # --- operands --------------------------------------------------------------------------------------

    def _held(self, value: ast.expr) -> Operand:
        """An operand that is needed more than once."""
        if isinstance(value, (ast.Name, ast.Constant)):
            return Operand(value, value)
        if isinstance(value, ast.NamedExpr):
            return Operand(value, self.pen.name(value.target.id))
        name = self.unit.local("value")
        return Operand(self.pen.bind(name, value), self.pen.name(name))

    def _all(self, tests: list[ast.expr]) -> ast.expr:
        return tests[0] if len(tests) == 1 else self.pen.both(ast.And(), tests)

    def _between(self, low: ast.expr, value: ast.expr, high: ast.expr, sign: ast.cmpop) -> ast.expr:
        return ast.Compare(low, [sign, sign], [value, high], **self.pen.at)

    def _called(self, *arguments: ast.expr) -> ast.expr:
        """The call of the function itself, for what the guard does not let through."""
        return self.pen.call(self.unit.function(self.node.function, self.pen), *arguments)


def _is_two(expr: plan.Expr) -> bool:
    return isinstance(expr, plan.Constant) and expr.value == 2


def _are_alike(types: Sequence[Type]) -> bool:
    """Whether values of these types are all numbers, or all strings."""
    return any(all(kind.only(kinds) for kind in types) for kinds in (Kind.NUMBER, Kind.STR))
