"""The forms of operations that are SQL, and what SQLite's are checked by.

SQLite's own operators are right within one class only.

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
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

import sqlglot
from sqlglot import exp
from sqlglot.dialects.sqlite import SQLite

from ss2sql.language import plan
from ss2sql.language.kinds import Kind, Type
from ss2sql.language.operations import GROUPS, OPERATIONS, Check, Form
from ss2sql.language.operations.operation import find_sql_class
from ss2sql.language.plan_traversal import is_volatile, list_plan_choices
from ss2sql.lowering import sql_builder
from ss2sql.lowering.sql_builder import Node
from ss2sql.lowering.sql_query import SQLITE_FUNCTIONS

if TYPE_CHECKING:
    from ss2sql.lowering.sqlite_expressions import ExpressionLowering, SqlScope


REAL_NUMBER = Kind.INT | Kind.FLOAT


def is_sql_number(kind: Type) -> bool:
    return find_sql_class(kind) == "number"


def have_same_storage_class(left: Type, right: Type, none: bool = False) -> bool:
    known = find_sql_class(left, none)
    return known is not None and known == find_sql_class(right, none)


INTEGRAL = Kind.BOOL | Kind.INT
MAX_REPEATED_NODES = (
    12  # what is written twice must not be longer: two columns and a literal with operators between them
)

_PLAIN = (exp.Column, exp.Identifier, exp.Literal, exp.Placeholder, exp.Paren, exp.Neg, exp.Add, exp.Sub, exp.Mul)


def can_repeat(node: Node, most: int = MAX_REPEATED_NODES) -> bool:
    """Whether an operand is so short that it may stand several times in the text, and so quick to compute."""
    parts = list(node.walk())
    return len(parts) <= most and all(isinstance(part, _PLAIN) for part in parts)


# --- reads the forms of operations that are SQL: texts, parsed once, with the operands in their places
_VALUE = "the_value"


def _build_sql_parser(*known: str) -> Callable[[str], Any]:
    """A parser of SQLite's SQL to which a call stays what is written, but for these functions."""
    base: Any = SQLite.Parser
    syntax = {name: base.FUNCTION_PARSERS[name] for name in ("CAST", "CHAR")}
    functions = {name: base.FUNCTIONS[name] for name in known}
    parser = type(base)("Parser", (base,), {"FUNCTIONS": functions, "FUNCTION_PARSERS": syntax})
    return lambda text: parser(dialect="sqlite").parse(SQLite().tokenize(text), text)[0]


_PARSERS: dict[str, Callable[[str], Any]] = {
    "sqlite": _build_sql_parser(),
    "sqlite groups": _build_sql_parser("COUNT", "MIN", "MAX"),  # sqlglot has to know that they are aggregates
    "duckdb": lambda text: sqlglot.parse_one(text, dialect="duckdb"),
}


@cache
def _parse_sql(text: str, dialect: str, count: int) -> Node:
    """The tree of a text for so many operands, which are columns in it. Read it, and copy what you take."""
    places = [f"{{{index}}}" for index in range(count)]
    text = text.replace("{*}", ", ".join(places)).replace("{reversed}", ", ".join(reversed(places)))
    node: Node = _PARSERS[dialect](re.sub(r"\{(\d+)\}", r"argument_\1", text).replace("{value}", _VALUE))
    return node


def fill_operands(text: str, operands: Sequence[Node], value: Node | None = None, dialect: str = "sqlite") -> Node:
    """A text with the operands in their places, and with the parentheses that these need."""
    if len(operands) == 1 and ("{*}" in text or "{reversed}" in text):  # SQLite takes a max of one for the aggregate
        return operands[0].copy()
    finish = _finish_duckdb if dialect == "duckdb" else _finish_sql_form

    def fill_node(node: Node) -> Node:
        match node:
            case exp.Column(name=name):
                known = value if name == _VALUE else operands[int(name.removeprefix("argument_"))]
                assert known is not None
                return known.copy()
            case exp.Paren():
                return fill_node(node.this)
            case exp.And():
                return sql_builder.join_by_and([fill_node(part) for part in node.flatten()])
            case exp.Binary():
                made: Node = sql_builder.binary(type(node), fill_node(node.this), fill_node(node.expression))
                made.set("typed", True if isinstance(node, exp.Div) else None)  # sqlglot adds no cast of its own
                return finish(made)
        made = node.copy()
        for name, part in node.args.items():
            if isinstance(part, list):
                made.set(name, [fill_node(one) for one in part])
            elif isinstance(part, exp.Expr) and not isinstance(part, exp.DataType):
                made.set(name, fill_node(part))
        if isinstance(made, (exp.Not, exp.Neg, exp.Between)):
            made.set("this", sql_builder.wrap_operand(made.this))
        return finish(made)

    return fill_node(_parse_sql(text, dialect, len(operands)))


def _finish_sql_form(node: Node) -> Node:
    """Names of functions as they are written, and a float of an integer that is written out."""
    match node:
        case exp.Anonymous():
            return sql_builder.call(node.name, *node.expressions)
        case exp.Chr():
            return sql_builder.call("char", *node.expressions)
        case exp.Cast(this=exp.Literal() as known) if node.to.sql("sqlite") == "REAL" and known.this.isdigit():
            return exp.Literal.number(f"{known.this}.0")
    return node


def _finish_duckdb(node: Node) -> Node:
    """`i + 1 + 1` as `i + 2`, of numbers that are written out."""
    match node:
        case exp.Add(this=exp.Literal(is_string=False) as one, expression=exp.Literal(is_string=False) as other):
            return sql_builder.number(int(one.this) + int(other.this))
        case exp.Add(
            this=exp.Add(this=base, expression=exp.Literal(is_string=False) as one),
            expression=exp.Literal(is_string=False) as other,
        ):
            return sql_builder.binary(exp.Add, base, sql_builder.number(int(one.this) + int(other.this)))
    return node


# --- the forms of operations in SQLite, and what they are checked by
MAX_SAFE_INTEGER = 2**62  # an operation on integers that leaves 64 bits gives a float beyond
MAX_SAFE_FLOAT = 1e308
MAX_CHECKED_NODES = 60  # of an expression that is written twice: the distance of two points takes 45


# --- calls ---------------------------------------------------------------------------------------------


def lower_unchecked(lowering: ExpressionLowering, call: plan.Call, env: SqlScope) -> Node | None:
    """A call by a form that needs no check."""
    form = _choose_form(call)
    return None if form is None or _get_check(form, call) else _lower_form(form, call, lowering, env)


def lower_checked(lowering: ExpressionLowering, call: plan.Call, env: SqlScope) -> Node | None:
    """A call by a form with a check; where that does not hold, Python is called."""
    form = _choose_form(call)
    test = form and _get_check(form, call)
    if form is None or not test or is_volatile(call):
        return None
    if test is Check.SIZE:
        return lower_size_checked(lowering, call, env)
    operands = [lowering.lower_expr(argument, env) for argument in call.arguments]
    if not all(map(can_repeat, operands)):
        return None
    value = fill_operands(str(form.text), operands)
    otherwise = lowering.call_python(call, env, rarely=True)
    if test is Check.NOT_NULL:
        return sql_builder.call("coalesce", value, otherwise)
    assert isinstance(test, str), f"SQL has no {test}"
    return sql_builder.case([(fill_operands(test, operands, value), value)], otherwise)


def _choose_form(call: plan.Call) -> Form | None:
    """The first form that fits; one without a check where the call cannot fail."""
    for form in OPERATIONS[call.function.name].sqlite:
        fits = form.when([argument.type for argument in _get_operands(form, call)])
        if fits and (_get_check(form, call) or not call.function.raises) and _find_sql_calls(form) <= SQLITE_FUNCTIONS:
            return form
    return None


def _get_check(form: Form, call: plan.Call) -> str | Check | None:
    return form.only or (form.check if call.function.raises else None)


def _get_operands(form: Form, call: plan.Call) -> Sequence[plan.Expr]:
    return list_plan_choices(call) if form.spread else call.arguments


def _lower_form(form: Form, call: plan.Call, lowering: ExpressionLowering, env: SqlScope) -> Node | None:
    operands = [lowering.lower_expr(argument, env) for argument in _get_operands(form, call)]
    text = str(form.text)
    often = [operand for index, operand in enumerate(operands) if text.count(f"{{{index}}}") > 1]
    return fill_operands(text, operands) if all(map(can_repeat, often)) else None


@cache
def _find_sql_calls(form: Form) -> frozenset[str]:
    texts = [text for text in (form.text, form.check, form.only) if isinstance(text, str)]
    return frozenset(name for text in texts for name in re.findall(r'\b([a-z_0-9]+)"?\(', text)) - {"cast"}


# --- sums and products ---------------------------------------------------------------------------------


def lower_size_checked(lowering: ExpressionLowering, call: plan.Call, env: SqlScope) -> Node | None:
    """Sums and products, with one check for a whole expression: a float stays one, and infinity stays beyond."""
    whole = call.type.kinds == Kind.INT
    if not (whole or call.type.kinds == Kind.FLOAT):
        return None
    node = _lower_chain(lowering, call, env, call.type.kinds)
    if node is None or not can_repeat(node, MAX_CHECKED_NODES):
        return None
    otherwise = sql_builder.mark_sql_as_rare(_call_python_operators(lowering, call, env))
    if not whole:
        return sql_builder.case([(sql_builder.between(node, -MAX_SAFE_FLOAT, MAX_SAFE_FLOAT), node)], otherwise)
    if not any(_choose_inner_form(argument, Kind.INT, env) for argument in call.arguments):
        return sql_builder.case([(sql_builder.between(node, -MAX_SAFE_INTEGER, MAX_SAFE_INTEGER), node)], otherwise)
    is_whole = sql_builder.binary(exp.EQ, sql_builder.call("typeof", node.copy()), sql_builder.string("integer"))
    return sql_builder.case([(is_whole, node)], otherwise)


def _choose_inner_form(expr: plan.Expr, kinds: Kind, env: SqlScope) -> Form | None:
    """The form of an operand that is computed under the check of the whole expression, and is not known already."""
    if not isinstance(expr, plan.Call) or not expr.function.builtin or not expr.function.raises:
        return None
    if env.get_known(expr) is not None:
        return None
    form = _choose_form(expr) if expr.type.kinds == kinds else None
    return form if form is not None and form.check is Check.SIZE else None


def _call_python_operators(lowering: ExpressionLowering, expr: plan.Expr, env: SqlScope) -> Node:
    """The same with a Python call for every operator."""
    if not isinstance(expr, plan.Call) or _choose_inner_form(expr, expr.type.kinds, env) is None:
        return lowering.lower_value(expr, env)
    operands = [_call_python_operators(lowering, argument, env) for argument in expr.arguments]
    return lowering.write_python_call(expr, operands)


def _lower_chain(lowering: ExpressionLowering, expr: plan.Expr, env: SqlScope, kinds: Kind) -> Node | None:
    form = _choose_inner_form(expr, kinds, env)
    if not isinstance(expr, plan.Call) or form is None:
        return lowering.lower_expr(expr, env) if find_sql_class(expr.type, none=True) == "number" else None
    text, operands = str(form.text), list[Node]()
    for index, argument in enumerate(expr.arguments):
        operand = _lower_chain(lowering, argument, env, kinds) if f"{{{index}}}" in text else sql_builder.null()
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
    return None if form is None else fill_operands(str(form.text), [argument], dialect="sqlite groups")


def list_form_functions() -> frozenset[str]:
    """The functions of SQLite that forms call, so that statements may call them."""
    forms = [form for row in OPERATIONS.values() for form in (*row.sqlite, *(row.group.sqlite if row.group else ()))]
    return frozenset().union(*map(_find_sql_calls, forms))


# --- texts in columns for numbers -----------------------------------------------------------------------


def strip_numeric_affinity(tree: Node, tables: Iterable[plan.TableSource]) -> None:
    """Has texts in columns that are declared for numbers compared as texts.

    Of a column `day DATE` SQLite would take '2020' for a number in `day < '2020'`, and any text for more than it. What
    is no number stays a text, so that SQLite may look `day < '2020-02-01'` up.
    """
    names = {name for table in tables for name in table.texts_for_numbers}
    shown = [(node.alias, _get_column(node.this)) for node in tree.find_all(exp.Alias)] if names else []
    while more := {alias for alias, column in shown if column is not None and column.name in names} - names:
        names |= more
    for comparison in list(tree.find_all(exp.LT, exp.LTE, exp.GT, exp.GTE, exp.Between)) if names else ():
        sides = list(comparison.iter_expressions())
        for side in sides:
            column = _get_column(side)
            if column is None or column.name not in names:
                continue
            if not all(other is side or _is_text_beside_numbers(other) for other in sides):
                sql_builder.drop_affinity(column)


def _get_column(node: Node) -> exp.Column | None:
    bare = node.unnest()
    bare = bare.this if isinstance(bare, exp.Collate) else bare
    return bare if isinstance(bare, exp.Column) else None


def _is_text_beside_numbers(node: Node) -> bool:
    """Whether a node is a text that SQLite cannot read as a number."""
    if not isinstance(node, exp.Literal) or not node.is_string:
        return False
    try:
        float(node.this)
    except ValueError:
        return True
    return False
