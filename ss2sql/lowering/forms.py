"""The forms of operations as SQL: texts of language/operations, parsed once, with the operands in their places.

    Form("{0} + {1}", check=SIZE)          CASE WHEN a + b BETWEEN -4611686018427387904 AND 4611686018427387904
                                           THEN a + b ELSE "add"(a, b, '1:8') END
    Form("{0} < {1}", check=NOT_NULL)      coalesce(a < b, lt(a, b, '1:8'))
    Form("sqrt({0})", check="{0} >= 0")    CASE WHEN a >= 0 THEN sqrt(a) ELSE sqrt_of(a, '1:8') END

So it is where the types promise numbers, but not their size, or not that none of them is None: in columns of tables,
and in sums that grow. A sum of a million rows takes 0.06 s so and 0.5 s in Python. What stands in the text more than
once is written more than once, so it has to be short; see `may_repeat`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

from sqlglot import exp
from sqlglot.dialects.sqlite import SQLite

from ss2sql import plan
from ss2sql.kinds import Kind
from ss2sql.language.operations import GROUPS, OPERATIONS, Check, Form
from ss2sql.language.operations.row import sql_class
from ss2sql.lowering import sql
from ss2sql.lowering.classes import may_repeat
from ss2sql.lowering.names import SQLITE_FUNCTIONS
from ss2sql.lowering.sql import Node
from ss2sql.walk import choices, is_volatile

if TYPE_CHECKING:
    from ss2sql.lowering.expressions import Env, Expressions

SAFE = 2**62  # an operation on integers that leaves 64 bits gives a float beyond
SAFE_FLOAT = 1e308
MOST_NODES = 60  # of an expression that is written twice: the distance of two points takes 45
_ALL, _REVERSED, _VALUE = "all_arguments", "all_reversed", "the_value"


def _parser(*known: str) -> Any:
    """A parser to which a call stays what is written, but for these functions."""
    base: Any = SQLite.Parser
    syntax = {name: base.FUNCTION_PARSERS[name] for name in ("CAST", "CHAR")}
    functions = {name: base.FUNCTIONS[name] for name in known}
    return type(base)("Parser", (base,), {"FUNCTIONS": functions, "FUNCTION_PARSERS": syntax})


_PARSER = _parser()
_OF_GROUPS = _parser("COUNT", "MIN", "MAX")  # sqlglot has to know that they are aggregates


@cache
def parsed(text: str, parser: Any = _PARSER) -> Node:
    """The tree of a text, with columns `argument_0` in the places of the arguments. Read it, and copy what you take."""
    named = re.sub(r"\{(\d)\}", r"argument_\1", text)
    for place, name in (("{*}", _ALL), ("{reversed}", _REVERSED), ("{value}", _VALUE)):
        named = named.replace(place, name)
    node: Node = parser(dialect="sqlite").parse(SQLite().tokenize(named), named)[0]
    return node


def filled(text: str, operands: Sequence[Node], value: Node | None = None) -> Node:
    """A text with the operands in their places, and with the parentheses that these need."""
    known: dict[str, Node] = {f"argument_{index}": operand for index, operand in enumerate(operands)}
    if value is not None:
        known[_VALUE] = value
    return _filled(parsed(text), known, operands)


def _filled(node: Node, known: Mapping[str, Node], operands: Sequence[Node]) -> Node:
    def inner(part: Node) -> Node:
        return _filled(part, known, operands)

    match node:
        case exp.Column():
            return known[node.name].copy()
        case exp.Paren():
            return inner(node.this)
        case exp.And():
            joined = sql.conjunction([inner(part) for part in node.flatten()])
            assert joined is not None
            return joined
        case exp.Binary():
            made = sql.binary(type(node), inner(node.this), inner(node.expression))
            made.set("typed", True if isinstance(node, exp.Div) else None)  # sqlglot adds no cast of its own
            return made
        case exp.Not() | exp.Neg():
            return type(node)(this=sql.operand(inner(node.this)))
        case exp.Between():
            low, high = inner(node.args["low"]), inner(node.args["high"])
            return exp.Between(this=sql.operand(inner(node.this)), low=low, high=high)
        case exp.Cast():
            return _cast(inner(node.this), node.to)
        case exp.Anonymous():
            return _called(node, known, operands)
        case exp.AggFunc():
            return type(node)(this=inner(node.this))
        case exp.Distinct():
            return exp.Distinct(expressions=[inner(part) for part in node.expressions])
        case exp.Chr():
            return sql.call("char", *map(inner, node.expressions))
        case exp.Literal() | exp.Null():
            return node.copy()
        case _:
            raise AssertionError(f"forms do not have {type(node).__name__}")


def _cast(node: Node, kind: exp.DataType) -> Node:
    if kind.sql("sqlite") == "REAL" and isinstance(node, exp.Literal) and node.this.isdigit():
        return exp.Literal.number(f"{node.this}.0")
    return exp.Cast(this=node, to=kind.copy())


def _called(node: exp.Anonymous, known: Mapping[str, Node], operands: Sequence[Node]) -> Node:
    arguments: list[Node] = []
    for part in node.expressions:
        several = part.name if isinstance(part, exp.Column) else ""
        if several in (_ALL, _REVERSED):
            arguments += [one.copy() for one in (operands if several == _ALL else reversed(operands))]
            if len(operands) == 1:  # SQLite takes a max of one argument for the aggregate
                return arguments[0]
        else:
            arguments.append(_filled(part, known, operands))
    return sql.call(node.name, *arguments)


# --- calls ---------------------------------------------------------------------------------------------


def certain(lowering: Expressions, call: plan.Call, env: Env) -> Node | None:
    """A call by a form that needs no check."""
    form = _form(call)
    return None if form is None or _test(form, call) else _written(form, call, lowering, env)


def checked(lowering: Expressions, call: plan.Call, env: Env) -> Node | None:
    """A call by a form with a check; where that does not hold, Python is called."""
    form = _form(call)
    test = form and _test(form, call)
    if form is None or not test or is_volatile(call):
        return None
    if test is Check.SIZE:
        return sized(lowering, call, env)
    operands = [lowering.lower(argument, env) for argument in call.arguments]
    if not all(map(may_repeat, operands)):
        return None
    value = filled(str(form.text), operands)
    otherwise = sql.rare(lowering.python(call, [lowering.value(argument, env) for argument in call.arguments]))
    if test is Check.NOT_NULL:
        return sql.call("coalesce", value, otherwise)
    assert isinstance(test, str), f"SQL has no {test}"
    return sql.case([(filled(test, operands, value), value)], otherwise)


def _form(call: plan.Call) -> Form | None:
    """The first form that fits; one without a check where the call cannot fail."""
    for form in OPERATIONS[call.function.name].sqlite:
        given = _given(form, call)
        fits = given and form.when([argument.type for argument in given])
        if fits and (_test(form, call) or not call.function.raises) and _functions(form) <= SQLITE_FUNCTIONS:
            return form
    return None


def _test(form: Form, call: plan.Call) -> str | Check | None:
    return form.only or (form.check if call.function.raises else None)


def _given(form: Form, call: plan.Call) -> Sequence[plan.Expr]:
    return choices(call) if form.spread else call.arguments


def _written(form: Form, call: plan.Call, lowering: Expressions, env: Env) -> Node | None:
    operands = [lowering.lower(argument, env) for argument in _given(form, call)]
    text = str(form.text)
    often = [operand for index, operand in enumerate(operands) if text.count(f"{{{index}}}") > 1]
    return filled(text, operands) if all(map(may_repeat, often)) else None


@cache
def _functions(form: Form) -> frozenset[str]:
    """The functions of SQLite that a form calls."""
    texts = [text for text in (form.text, form.check, form.only) if isinstance(text, str)]
    return frozenset(name for text in texts for name in re.findall(r'\b([a-z_0-9]+)"?\(', text)) - {"cast"}


# --- sums and products ---------------------------------------------------------------------------------


def sized(lowering: Expressions, call: plan.Call, env: Env) -> Node | None:
    """Sums and products, with one check for a whole expression: a float stays one, and infinity stays beyond."""
    whole = call.type.kinds == Kind.INT
    if not (whole or call.type.kinds == Kind.FLOAT):
        return None
    node = _tree(lowering, call, env, call.type.kinds)
    if node is None or not may_repeat(node, MOST_NODES):
        return None
    otherwise = sql.rare(_calls(lowering, call, env))
    if not whole:
        return sql.case([(_between(node, SAFE_FLOAT), node)], otherwise)
    if not any(_inner_form(argument, Kind.INT) for argument in call.arguments):
        return sql.case([(_between(node, SAFE), node)], otherwise)
    is_whole = sql.binary(exp.EQ, sql.call("typeof", node.copy()), sql.string("integer"))
    return sql.case([(is_whole, node)], otherwise)


def _between(node: Node, limit: float) -> Node:
    return exp.Between(this=sql.operand(node.copy()), low=sql.number(-limit), high=sql.number(limit))


def _inner_form(expr: plan.Expr, kinds: Kind) -> Form | None:
    """The form of an operand that is computed under the check of the whole expression."""
    if not isinstance(expr, plan.Call) or not expr.function.builtin or not expr.function.raises:
        return None
    form = _form(expr) if expr.type.kinds == kinds else None
    return form if form is not None and form.check is Check.SIZE else None


def _calls(lowering: Expressions, expr: plan.Expr, env: Env) -> Node:
    """The same with a Python call for every operator."""
    if not isinstance(expr, plan.Call) or _inner_form(expr, expr.type.kinds) is None:
        return lowering.value(expr, env)
    return lowering.python(expr, [_calls(lowering, argument, env) for argument in expr.arguments])


def _tree(lowering: Expressions, expr: plan.Expr, env: Env, kinds: Kind) -> Node | None:
    form = None if any(known == expr for known, _ in env.known) else _inner_form(expr, kinds)
    if not isinstance(expr, plan.Call) or form is None:
        return lowering.lower(expr, env) if sql_class(expr.type, none=True) == "number" else None
    text, operands = str(form.text), list[Node]()
    for index, argument in enumerate(expr.arguments):
        operand = _tree(lowering, argument, env, kinds) if f"{{{index}}}" in text else sql.null()
        if operand is None or (text.count(f"{{{index}}}") > 1 and not may_repeat(operand)):
            return None
        operands.append(operand)
    return filled(text, operands)


# --- aggregates ----------------------------------------------------------------------------------------


def aggregated(aggregate: plan.Aggregate, argument: Node) -> Node | None:
    """An aggregate that SQLite computes itself."""
    assert aggregate.argument is not None
    types = [aggregate.argument.type]
    form = next((form for form in GROUPS[aggregate.function].sqlite if form.when(types)), None)
    if form is None:
        return None
    return _filled(parsed(str(form.text), _OF_GROUPS), {"argument_0": argument}, [argument])


def functions_in_forms() -> frozenset[str]:
    """The functions of SQLite that forms call, so that statements may call them."""
    forms = [form for row in OPERATIONS.values() for form in (*row.sqlite, *(row.group.sqlite if row.group else ()))]
    return frozenset().union(*map(_functions, forms))
