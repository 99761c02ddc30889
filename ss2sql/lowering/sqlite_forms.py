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

from ss2sql.language import plan
from ss2sql.language.kinds import Kind
from ss2sql.language.operations import GROUPS, OPERATIONS, Check, Form
from ss2sql.language.operations.operation import sql_class
from ss2sql.language.plan_traversal import is_volatile, list_choices
from ss2sql.lowering import sql_builder
from ss2sql.lowering.sql_builder import Node
from ss2sql.lowering.sql_names import SQLITE_FUNCTIONS
from ss2sql.lowering.storage_class import can_repeat

if TYPE_CHECKING:
    from ss2sql.lowering.sqlite_expressions import ExpressionLowering, SqlScope

MAX_SAFE_INTEGER = 2**62  # an operation on integers that leaves 64 bits gives a float beyond
MAX_SAFE_FLOAT = 1e308
MAX_CHECKED_NODES = 60  # of an expression that is written twice: the distance of two points takes 45
_ALL, _REVERSED, _VALUE = "all_arguments", "all_reversed", "the_value"


def _build_parser(*known: str) -> Any:
    """A parser to which a call stays what is written, but for these functions."""
    base: Any = SQLite.Parser
    syntax = {name: base.FUNCTION_PARSERS[name] for name in ("CAST", "CHAR")}
    functions = {name: base.FUNCTIONS[name] for name in known}
    return type(base)("Parser", (base,), {"FUNCTIONS": functions, "FUNCTION_PARSERS": syntax})


_PARSER = _build_parser()
_OF_GROUPS = _build_parser("COUNT", "MIN", "MAX")  # sqlglot has to know that they are aggregates


@cache
def parse_sql(text: str, parser: Any = _PARSER) -> Node:
    """The tree of a text, with columns `argument_0` in the places of the arguments. Read it, and copy what you take."""
    named = re.sub(r"\{(\d)\}", r"argument_\1", text)
    for place, name in (("{*}", _ALL), ("{reversed}", _REVERSED), ("{value}", _VALUE)):
        named = named.replace(place, name)
    node: Node = parser(dialect="sqlite").parse(SQLite().tokenize(named), named)[0]
    return node


def fill_operands(text: str, operands: Sequence[Node], value: Node | None = None) -> Node:
    """A text with the operands in their places, and with the parentheses that these need."""
    known: dict[str, Node] = {f"argument_{index}": operand for index, operand in enumerate(operands)}
    if value is not None:
        known[_VALUE] = value
    return _fill_node(parse_sql(text), known, operands)


def _fill_node(node: Node, known: Mapping[str, Node], operands: Sequence[Node]) -> Node:
    def inner(part: Node) -> Node:
        return _fill_node(part, known, operands)

    match node:
        case exp.Column():
            return known[node.name].copy()
        case exp.Paren():
            return inner(node.this)
        case exp.And():
            joined = sql_builder.conjunction([inner(part) for part in node.flatten()])
            assert joined is not None
            return joined
        case exp.Binary():
            made = sql_builder.binary(type(node), inner(node.this), inner(node.expression))
            made.set("typed", True if isinstance(node, exp.Div) else None)  # sqlglot adds no cast of its own
            return made
        case exp.Not() | exp.Neg():
            return type(node)(this=sql_builder.wrap_operand(inner(node.this)))
        case exp.Between():
            low, high = inner(node.args["low"]), inner(node.args["high"])
            return exp.Between(this=sql_builder.wrap_operand(inner(node.this)), low=low, high=high)
        case exp.Cast():
            return _cast_node(inner(node.this), node.to)
        case exp.Anonymous():
            return _fill_call(node, known, operands)
        case exp.AggFunc():
            return type(node)(this=inner(node.this))
        case exp.Distinct():
            return exp.Distinct(expressions=[inner(part) for part in node.expressions])
        case exp.Chr():
            return sql_builder.call("char", *map(inner, node.expressions))
        case exp.Literal() | exp.Null():
            return node.copy()
        case _:
            raise AssertionError(f"forms do not have {type(node).__name__}")


def _cast_node(node: Node, kind: exp.DataType) -> Node:
    if kind.sql("sqlite") == "REAL" and isinstance(node, exp.Literal) and node.this.isdigit():
        return exp.Literal.number(f"{node.this}.0")
    return exp.Cast(this=node, to=kind.copy())


def _fill_call(node: exp.Anonymous, known: Mapping[str, Node], operands: Sequence[Node]) -> Node:
    arguments: list[Node] = []
    for part in node.expressions:
        several = part.name if isinstance(part, exp.Column) else ""
        if several in (_ALL, _REVERSED):
            arguments += [one.copy() for one in (operands if several == _ALL else reversed(operands))]
            if len(operands) == 1:  # SQLite takes a max of one argument for the aggregate
                return arguments[0]
        else:
            arguments.append(_fill_node(part, known, operands))
    return sql_builder.call(node.name, *arguments)


# --- calls ---------------------------------------------------------------------------------------------


def lower_unchecked(lowering: ExpressionLowering, call: plan.Call, env: SqlScope) -> Node | None:
    """A call by a form that needs no check."""
    form = _choose_form(call)
    return None if form is None or _get_check(form, call) else _write_form(form, call, lowering, env)


def lower_checked(lowering: ExpressionLowering, call: plan.Call, env: SqlScope) -> Node | None:
    """A call by a form with a check; where that does not hold, Python is called."""
    form = _choose_form(call)
    test = form and _get_check(form, call)
    if form is None or not test or is_volatile(call):
        return None
    if test is Check.SIZE:
        return lower_size_checked(lowering, call, env)
    operands = [lowering.lower(argument, env) for argument in call.arguments]
    if not all(map(can_repeat, operands)):
        return None
    value = fill_operands(str(form.text), operands)
    otherwise = sql_builder.mark_as_rare(
        lowering.python(call, [lowering.value(argument, env) for argument in call.arguments])
    )
    if test is Check.NOT_NULL:
        return sql_builder.call("coalesce", value, otherwise)
    assert isinstance(test, str), f"SQL has no {test}"
    return sql_builder.case([(fill_operands(test, operands, value), value)], otherwise)


def _choose_form(call: plan.Call) -> Form | None:
    """The first form that fits; one without a check where the call cannot fail."""
    for form in OPERATIONS[call.function.name].sqlite:
        given = _get_operands(form, call)
        fits = given and form.when([argument.type for argument in given])
        if fits and (_get_check(form, call) or not call.function.raises) and _find_functions(form) <= SQLITE_FUNCTIONS:
            return form
    return None


def _get_check(form: Form, call: plan.Call) -> str | Check | None:
    return form.only or (form.check if call.function.raises else None)


def _get_operands(form: Form, call: plan.Call) -> Sequence[plan.Expr]:
    return list_choices(call) if form.spread else call.arguments


def _write_form(form: Form, call: plan.Call, lowering: ExpressionLowering, env: SqlScope) -> Node | None:
    operands = [lowering.lower(argument, env) for argument in _get_operands(form, call)]
    text = str(form.text)
    often = [operand for index, operand in enumerate(operands) if text.count(f"{{{index}}}") > 1]
    return fill_operands(text, operands) if all(map(can_repeat, often)) else None


@cache
def _find_functions(form: Form) -> frozenset[str]:
    """The functions of SQLite that a form calls."""
    texts = [text for text in (form.text, form.check, form.only) if isinstance(text, str)]
    return frozenset(name for text in texts for name in re.findall(r'\b([a-z_0-9]+)"?\(', text)) - {"cast"}


# --- sums and products ---------------------------------------------------------------------------------


def lower_size_checked(lowering: ExpressionLowering, call: plan.Call, env: SqlScope) -> Node | None:
    """Sums and products, with one check for a whole expression: a float stays one, and infinity stays beyond."""
    whole = call.type.kinds == Kind.INT
    if not (whole or call.type.kinds == Kind.FLOAT):
        return None
    node = _build_tree(lowering, call, env, call.type.kinds)
    if node is None or not can_repeat(node, MAX_CHECKED_NODES):
        return None
    otherwise = sql_builder.mark_as_rare(_call_python_operators(lowering, call, env))
    if not whole:
        return sql_builder.case([(_build_between(node, MAX_SAFE_FLOAT), node)], otherwise)
    if not any(_choose_inner_form(argument, Kind.INT) for argument in call.arguments):
        return sql_builder.case([(_build_between(node, MAX_SAFE_INTEGER), node)], otherwise)
    is_whole = sql_builder.binary(exp.EQ, sql_builder.call("typeof", node.copy()), sql_builder.string("integer"))
    return sql_builder.case([(is_whole, node)], otherwise)


def _build_between(node: Node, limit: float) -> Node:
    return exp.Between(
        this=sql_builder.wrap_operand(node.copy()), low=sql_builder.number(-limit), high=sql_builder.number(limit)
    )


def _choose_inner_form(expr: plan.Expr, kinds: Kind) -> Form | None:
    """The form of an operand that is computed under the check of the whole expression."""
    if not isinstance(expr, plan.Call) or not expr.function.builtin or not expr.function.raises:
        return None
    form = _choose_form(expr) if expr.type.kinds == kinds else None
    return form if form is not None and form.check is Check.SIZE else None


def _call_python_operators(lowering: ExpressionLowering, expr: plan.Expr, env: SqlScope) -> Node:
    """The same with a Python call for every operator."""
    if not isinstance(expr, plan.Call) or _choose_inner_form(expr, expr.type.kinds) is None:
        return lowering.value(expr, env)
    return lowering.python(expr, [_call_python_operators(lowering, argument, env) for argument in expr.arguments])


def _build_tree(lowering: ExpressionLowering, expr: plan.Expr, env: SqlScope, kinds: Kind) -> Node | None:
    form = None if any(known == expr for known, _ in env.known) else _choose_inner_form(expr, kinds)
    if not isinstance(expr, plan.Call) or form is None:
        return lowering.lower(expr, env) if sql_class(expr.type, none=True) == "number" else None
    text, operands = str(form.text), list[Node]()
    for index, argument in enumerate(expr.arguments):
        operand = _build_tree(lowering, argument, env, kinds) if f"{{{index}}}" in text else sql_builder.null()
        if operand is None or (text.count(f"{{{index}}}") > 1 and not can_repeat(operand)):
            return None
        operands.append(operand)
    return fill_operands(text, operands)


# --- aggregates ----------------------------------------------------------------------------------------


def lower_aggregate(aggregate: plan.Aggregate, argument: Node) -> Node | None:
    """An aggregate that SQLite computes itself."""
    assert aggregate.argument is not None
    types = [aggregate.argument.type]
    form = next((form for form in GROUPS[aggregate.function].sqlite if form.when(types)), None)
    if form is None:
        return None
    return _fill_node(parse_sql(str(form.text), _OF_GROUPS), {"argument_0": argument}, [argument])


def list_form_functions() -> frozenset[str]:
    """The functions of SQLite that forms call, so that statements may call them."""
    forms = [form for row in OPERATIONS.values() for form in (*row.sqlite, *(row.group.sqlite if row.group else ()))]
    return frozenset().union(*map(_find_functions, forms))
