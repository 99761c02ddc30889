"""From grammar rules to the syntax tree: one method per rule of `grammar.lark`, expressions first, then queries.

The parser calls a method when its rule is complete, with the span of its text and its children. A method makes the
node and collects errors that the grammar accepts: queries without an end, assignments as conditions, large numbers.

The grammar accepts GROUP BY, ORDER BY and LIMIT in any order and number; that they stand once is checked here, where
the error can name both.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise, takewhile
from typing import TYPE_CHECKING, Any, Generic, TypeAlias, TypeVar

from ss2sql.errors import ParseError, Source, Span
from ss2sql.fast_dataclasses import dataclass
from ss2sql.frontend.syntax import ast, tokenizer
from ss2sql.frontend.syntax.tokenizer import OPTIONS, OTHER_OPTIONS, Token, shorten_query, shorten_text

if TYPE_CHECKING:
    from ss2sql.frontend.syntax.parser import Table

MAX_DEPTH = 300
OPERATORS = {
    "+": "add", "-": "sub", "*": "mul", "/": "div", "%": "mod", "^": "pow", "==": "eq", "!=": "ne", "<>": "ne",
    "<": "lt", "<=": "le", ">": "gt", ">=": "ge", "IN": "in",
}  # fmt: skip
COMPARISONS = frozenset(("==", "!=", "<>", "<", "<=", ">", ">=", "IN", "NOT IN", "IS", "BETWEEN", "LIKE"))
LOGIC = frozenset(("AND", "OR", "XOR"))
COMMENT_HINT = "write a blank after it, or # before a comment"
MEMORIZE_HINT = "MEMORIZE takes a whole number"
CHAIN_HINT = "write a < b AND b < c"
VALUED_OPTIONS = ("COST", "HEURISTIC", "PROBABILITY", "MAXIMUM")
END_HINT = ("end it with AS, for instance AS list, or put it in parentheses",)

_N = TypeVar("_N")


@dataclass(slots=True, eq=False)
class Part(Generic[_N]):
    """A node that is not yet in the tree: `depth` counts its levels.

    `query` is the query without parentheses that stands at the right end of its text, if there is one.
    """

    node: _N
    depth: int = 1
    query: ast.Query | None = None


Expr: TypeAlias = Part[ast.Expr]
HasDepth: TypeAlias = "Part[Any] | Clause"


class ExpressionBuilder:
    """Makes the expressions of one script."""

    def __init__(self, source: Source) -> None:
        self.script_source = source
        self._errors: list[ParseError] = []
        # 9223372036854775808 is in range only after a minus: its error waits here, by the number's offset.
        self._too_large: dict[int, ParseError] = {}
        self._number: Expr | None = None

    def list_actions(self, table: Table) -> list[Callable[..., Any] | None]:
        """The method of each rule of `table`; None for rules that make no node."""
        return [getattr(self, rule.action) if rule.action else None for rule in table.rules]

    def list_errors(self) -> list[ParseError]:
        """The errors found so far."""
        return [*self._errors, *self._too_large.values()]

    def has_unended_query(self, start: int) -> bool:
        """Whether a query after the offset `start` was found without an end: it runs into what follows."""
        found = (
            e
            for e in self._errors
            if e.code == "P009" or COMMENT_HINT in e.hints or e.message.startswith(MEMORIZE_HINT)
        )
        return any(e.span is not None and e.span.end > start for e in found)

    def script(self, span: Span, *statements: Expr) -> ast.Script:
        whole = Span(self.script_source, 0, len(self.script_source.text))
        return ast.Script(tuple(part.node for part in statements), span=whole)

    # Assignments and operators

    def assign(self, span: Span, name: Token, value: Expr) -> Expr:
        node = ast.Assign(name.text, value.node, span=span, name_span=self._find_span(name))
        return self._make_part(node, value, query=value.query)

    def temporal_assign(self, span: Span, target: Part[ast.Temporal], value: Expr) -> Expr:
        name, keep = target.node.name, target.node.when
        if keep is None:
            self._make_error("P001", f"'{name}{{}} =' does not say how many seconds to keep", target.node.span,
                        f"write '{name}{{5.0}} =' to keep what was in force during the last five seconds")  # fmt: skip
            return value
        return self._make_part(ast.TemporalAssign(name, keep, value.node, span=span), target, value, query=value.query)

    def disjunction(self, span: Span, *parts: Expr) -> Expr:
        return self._make_part(ast.Or(self._list_operands(parts, "OR"), span=span), *parts, query=parts[-1].query)

    def conjunction(self, span: Span, *parts: Expr) -> Expr:
        return self._make_part(ast.And(self._list_operands(parts, "AND"), span=span), *parts, query=parts[-1].query)

    def exclusive(self, span: Span, *parts: Expr) -> Expr:
        left, right = self._list_operands(parts, "XOR")
        return self._make_part(ast.Xor(left, right, span=span), *parts, query=parts[-1].query)

    def negated(self, span: Span, operand: Expr) -> Expr:
        return self._make_part(ast.Not(operand.node, span=span), operand, query=operand.query)

    def calculated(self, span: Span, left: Expr, sign: Token, right: Expr) -> Expr:
        operands = self._list_operands((left, right), sign.kind, self._find_span(sign))
        if sign.kind == "IN":
            self._check_list(Span(self.script_source, sign.start, span.end), sign.kind, right.node)
        node = ast.Operator(OPERATORS[sign.kind], operands, span=span, place=self._find_span(sign))
        return self._make_part(node, left, right, query=right.query)

    def excluded(self, span: Span, left: Expr, sign: Token, last: Token, right: Expr) -> Expr:
        place = Span(self.script_source, sign.start, last.end)
        self._check_list(Span(self.script_source, sign.start, span.end), "NOT IN", right.node)
        node = ast.Operator("not_in", self._list_operands((left, right), "NOT IN", place), span=span, place=place)
        return self._make_part(node, left, right, query=right.query)

    def _check_list(self, place: Span, sign: str, right: ast.Expr) -> None:
        """Refuses `IN ('Bonn')`, which would look for a part of the text: a list of one is meant."""
        if isinstance(right, ast.Literal) and right.span.end < place.end:  # it stands in parentheses
            text = right.span.text
            inside = (f"write {sign} {text} to look in the text",) if isinstance(right.value, str) else ()
            hints = (f"write {sign} [{text}]", *inside)
            self._make_error("P006", "a list stands in square brackets", place, *hints)

    def is_none(self, span: Span, value: Expr, *words: Token) -> Expr:
        place = Span(self.script_source, words[0].start, words[-1].end)
        none = ast.Literal(None, span=self._find_span(words[-1]))
        function = "eq" if len(words) == 2 else "ne"
        (operand, _) = self._list_operands((value, Part(none)), "IS", place)
        return self._make_part(ast.Operator(function, (operand, none), span=span, place=place), value)

    def between(self, span: Span, value: Expr, *parts: Expr | Token) -> Expr:
        operands = [value, *(part for part in parts if isinstance(part, Part))]
        words = [part for part in parts if isinstance(part, Token)]
        place = Span(self.script_source, words[0].start, words[-2].end)
        tested, low, high = self._list_operands(operands, "BETWEEN", place)
        node = ast.Between(tested, low, high, span=span, place=place)
        return self._negate_if(len(words) == 3, self._make_part(node, *operands, query=operands[-1].query))

    def like(self, span: Span, value: Expr, *parts: Expr | Token) -> Expr:
        words, (pattern,) = [part for part in parts if isinstance(part, Token)], parts[-1:]
        assert isinstance(pattern, Part)
        place = Span(self.script_source, words[0].start, words[-1].end)
        node = ast.Operator("like", self._list_operands((value, pattern), "LIKE", place), span=span, place=place)
        return self._negate_if(len(words) == 2, self._make_part(node, value, pattern, query=pattern.query))

    def _negate_if(self, negated: bool, test: Expr) -> Expr:
        return self._make_part(ast.Not(test.node, span=test.node.span), test, query=test.query) if negated else test

    def prior(self, span: Span, word: Token, value: Expr) -> Expr:
        """`PRIOR x` is `prior(x)`."""
        return self._make_part(ast.Call("prior", (value.node,), span=span), value)

    def minus(self, span: Span, sign: Token, operand: Expr) -> Expr:
        node = operand.node
        if operand is self._number and isinstance(node, ast.Literal) and isinstance(node.value, int | float):
            self._too_large.pop(node.span.start, None)
            return Part(ast.Literal(-node.value, span=span))
        negative = ast.Operator("neg", (node,), span=span, place=self._find_span(sign))
        return self._make_part(negative, operand, query=operand.query)

    # Atoms

    def name(self, span: Span, name: Token) -> Expr:
        return Part(ast.Name(name.text, span=span))

    def this(self, span: Span, source: Token | None = None) -> Expr:
        return Part(ast.This(source.text if source else None, span=span))

    def attribute(self, span: Span, source: Token, name: Token) -> Expr:
        return Part(ast.Attribute(source.text, name.text, span=span))

    def attribute_of_this(self, span: Span, name: Token) -> Expr:
        return Part(ast.Attribute(None, name.text, span=span))

    def integer(self, span: Span, number: Token) -> Expr:
        digits = number.text.lstrip("0") or "0"
        value = int(digits) if len(digits) < 20 else 2**64  # int() refuses texts of thousands of digits
        if value >= 2**63:
            error = ParseError(
                "P007", "this integer is beyond 64 bits", span,
                ["integers go from -9223372036854775808 to 9223372036854775807; 1e30 is a float"],
            )  # fmt: skip
            if value == 2**63:
                self._too_large[span.start] = error
            else:
                self._errors.append(error)
        self._number = Part(ast.Literal(value, span=span))
        return self._number

    def float_(self, span: Span, number: Token) -> Expr:
        value = float(number.text)
        if value == float("inf"):
            self._make_error("P007", "this number is too large for a float", span, "floats go up to about 1.8e308")
        self._number = Part(ast.Literal(value, span=span))
        return self._number

    def string(self, span: Span, token: Token) -> Expr:
        try:
            return Part(ast.Literal(tokenizer.unescape_string(self.script_source, token), span=span))
        except ParseError as error:
            self._errors.append(error)
            return Part(ast.Literal("", span=span))

    def constant(self, span: Span, word: Token) -> Expr:
        return Part(ast.Literal({"TRUE": True, "FALSE": False}.get(word.kind), span=span))

    def enclosed(self, span: Span, value: Expr) -> Expr:
        return Part(value.node, value.depth)

    def list_(self, span: Span, *items: Expr) -> Expr:
        return self._make_part(ast.ListLiteral(tuple(item.node for item in items), span=span), *items)

    def call(self, span: Span, function: Token, *arguments: Expr) -> Expr:
        node = ast.Call(function.text, tuple(argument.node for argument in arguments), span=span)
        for query in [part.query for part in arguments if part.query is not None]:
            self._check_last_sources(query)
        return self._make_part(node, *arguments)

    def _check_last_sources(self, query: ast.Query) -> None:
        """Refuses `join(SELECT name FROM people, ',')`: the last argument is read as a source."""
        sources = reversed(query.sources)
        literals = list(takewhile(lambda one: one.name is None and isinstance(one.expr, ast.Literal), sources))
        tables = query.sources[: len(query.sources) - len(literals)]
        if not literals or not tables or query.span.end > query.sources[-1].span.end:
            return
        text = self.script_source.text[query.span.start : tables[-1].span.end]
        rest = self.script_source.text[literals[-1].span.start : query.span.end]
        hint = f"write {shorten_query(text)} AS list, {rest}"
        message = f"this query inside a call is not ended, so {shorten_text(rest)} is a source of it"
        self._make_error("P009", message, query.span, hint, "AS value stands there for a single value")

    def call_of(self, span: Span, owner: Token, function: Token, *arguments: Expr) -> Expr:
        nodes = tuple(argument.node for argument in arguments)
        return self._make_part(ast.Call(function.text, nodes, owner=owner.text, span=span), *arguments)

    def call_star(self, span: Span, function: Token) -> Expr:
        return Part(ast.Call(function.text, (), span=span, star=True))

    def call_distinct(self, span: Span, function: Token, argument: Expr) -> Expr:
        return self._make_part(ast.Call(function.text, (argument.node,), span=span, distinct=True), argument)

    def when(self, span: Span, condition: Expr, value: Expr) -> tuple[Expr, Expr]:
        return condition, value

    def case(self, span: Span, *parts: Any) -> Expr:
        """CASE as IF within IF."""
        branches = [part for part in parts if isinstance(part, tuple)]
        whole: Expr = parts[-1] if len(parts) > len(branches) else Part(ast.Literal(None, span=span))
        for condition, value in reversed(branches):
            node = ast.If(self._check_condition(condition, "CASE WHEN"), (value.node,), (whole.node,), span=span)
            whole = self._make_part(node, condition, value, whole)
        return whole

    def if_(self, span: Span, condition: Expr, *branches: Sequence[Expr]) -> Expr:
        then, otherwise = (*branches, (), ())[:2]
        test = self._check_condition(condition, "IF")
        node = ast.If(test, tuple(part.node for part in then), tuple(part.node for part in otherwise), span=span)
        return self._make_part(node, condition, *then, *otherwise)

    def branch(self, span: Span, *values: Expr) -> tuple[Expr, ...]:
        return values

    def temporal(self, span: Span, name: Token, when: Expr | None = None) -> Part[ast.Temporal]:
        if when is None:
            return Part(ast.Temporal(name.text, None, span=span))
        return self._make_part(ast.Temporal(name.text, when.node, span=span), when)

    def indexed(self, span: Span, value: Expr, *subscripts: Expr | tuple[Expr | None, Expr | None]) -> Expr:
        for subscript in subscripts:
            if isinstance(subscript, Part):
                value = self._make_part(ast.Index(value.node, subscript.node, span=span), value, subscript)
            else:
                lower, upper = (part.node if part else None for part in subscript)
                bounds = [part for part in subscript if part is not None]
                value = self._make_part(ast.Slice(value.node, lower, upper, span=span), value, *bounds)
        return value

    def member(self, span: Span, value: Expr, name: Token) -> Expr:
        """`p.address.city` is `p.address["city"]`."""
        return self._make_part(
            ast.Index(value.node, ast.Literal(name.text, span=self._find_span(name)), span=span), value
        )

    def slice_(self, span: Span, *parts: Expr | Token) -> tuple[Expr | None, Expr | None]:
        lower = upper = None
        for part in parts:
            if isinstance(part, Part):
                lower, upper = (part, None) if part is parts[0] else (lower, part)
        return lower, upper

    # Shared by all methods

    def _find_span(self, token: Token) -> Span:
        return Span(self.script_source, token.start, token.end)

    def _make_part(self, node: Any, *parts: HasDepth, query: ast.Query | None = None) -> Part[Any]:
        """A node with its depth. Raises ParseError (P005) for a tree that is too deep for later stages."""
        depth = 1 + max([part.depth for part in parts], default=0)
        if depth > MAX_DEPTH:
            raise _make_syntax_depth_error(node)
        return Part(node, depth, query)

    def _make_error(self, code: str, message: str, span: Span, *hints: str) -> ParseError:
        error = ParseError(code, message, span, hints)
        self._errors.append(error)
        return error

    def _list_operands(self, parts: Sequence[Expr], sign: str, place: Span | None = None) -> tuple[ast.Expr, ...]:
        """The operands of `sign`. A bare query on its left must end with AS; a comparison refuses it."""
        for query in [part.query for part in parts[:-1] if part.query is not None]:
            shape = query.representation
            if shape is None and sign in COMPARISONS and _ends_in_comparison(query):
                self._make_error("P001", f"a comparison does not go on with {sign}", place or query.span, CHAIN_HINT)
            elif shape is None and place is not None and place.source.text.startswith("--", place.start):
                comment = Span(place.source, place.start, place.start + 2)
                self._make_error("P006", "-- does not start a comment", comment, COMMENT_HINT)
            elif shape is None:
                bare = sign not in LOGIC and query.span.end == query.sources[-1].span.end
                hints = (f"a source with {sign} in it stands in parentheses: FROM (a {sign} b)",) if bare else ()
                if bare and sign == "IN":
                    hints = (f"to name a source write FROM {query.sources[-1].span.text} = ...",)
                self._make_error("P009", f"the query to the left of {sign} is not ended", query.span, *hints, *END_HINT)
            elif sign in COMPARISONS:
                self._make_error("P009", f"a query to the left of {sign} stands in parentheses", query.span,
                            f"write (SELECT ... AS {shape.name}) {sign} ...")  # fmt: skip
        return tuple(part.node for part in parts)

    def _check_condition(self, part: Expr, keyword: str) -> ast.Expr:
        """The condition after `keyword`; an assignment is refused, unless in parentheses."""
        node = part.node
        if isinstance(node, ast.Assign):
            self._make_error("P006", f"= assigns, but {keyword} needs a condition", node.span,
                        f"write {node.name} == {tokenizer.shorten_text(node.value.span.text)} to compare")  # fmt: skip
        return node


_COMPARING = {OPERATORS.get(sign, sign.lower().replace(" ", "_")) for sign in COMPARISONS}


def _is_comparison(node: ast.Expr) -> bool:
    return isinstance(node, ast.Between) or (isinstance(node, ast.Operator) and node.function in _COMPARING)


def _gives_value(node: ast.Expr) -> bool:
    """Whether it is not there to be true or false; a call may be."""
    plain = ast.Name | ast.Attribute | ast.This | ast.Index | ast.ListLiteral | ast.Literal | ast.Operator
    return isinstance(node, plain) and not _is_comparison(node)


def _ends_in_comparison(query: ast.Query) -> bool:
    """Whether the last written clause is a condition that ends in a comparison."""
    last = query.having or query.stop or query.where
    while isinstance(last, ast.And | ast.Or):
        last = last.parts[-1]
    return last is not None and _is_comparison(last) and last.span.end == query.span.end


def _make_syntax_depth_error(node: Any) -> ParseError:
    """The error for a node with too many levels below it; a chain of one operator is called long."""
    if isinstance(node, ast.Operator) and node.place is not None:
        first = node.operands[0]
        if isinstance(first, ast.Operator) and first.function == node.function:
            cure = "sum([a, b, ...]) adds a list" if node.function == "add" else "assign parts of it to variables first"
            message = f"more than {MAX_DEPTH} values are joined by {node.place.text}"
            return ParseError("P005", message, node.place, (cure, "long data comes from Python as a variable"))
    cures = ("assign inner parts to variables first; long data comes from Python as a variable",)
    return ParseError("P005", f"the script is nested deeper than {MAX_DEPTH} levels", node.span, cures)


# --- the builder's second half: queries and their clauses
ORDER = "SELECT, FROM, WHERE, START WITH, CONNECT BY, STOP WITH, then GROUP BY, ORDER BY and LIMIT, and AS at the end"


@dataclass(slots=True)
class Clause:
    """A clause of a query: its keyword, what it sets in `ast.Query`, its depth and its place."""

    keyword: str
    fields: dict[str, Any]
    depth: int
    span: Span


class Builder(ExpressionBuilder):
    """Makes the tree of one script."""

    def query(self, span: Span, *clauses: Clause) -> Expr:
        """The node of a query from its clauses, each at most once."""
        fields: dict[str, Any] = {}
        seen: dict[str, Clause] = {}
        for clause in clauses:
            if clause.keyword in seen:
                message = f"{clause.keyword} stands twice in this query"
                error = self._make_error("P001", message, clause.span, "keep one of them, or write one list")
                error.related = ((seen[clause.keyword].span, "the first one"),)
            seen.setdefault(clause.keyword, clause)
            fields |= clause.fields
        unset = {item.name for item in fields.get("start", ())} - {item.name for item in fields.get("connect", ())}
        for keyword, field in (("START WITH", "first"), ("CONNECT BY", "made")):
            if field in fields:
                fields[field] = self._find_only_condition(fields[field], keyword, unset)
        node = ast.Query(**fields, span=span)
        return self._make_part(node, *clauses, query=node)

    def distinct(self, span: Span) -> Clause:
        return Clause("DISTINCT", {"distinct": True}, 1, span)

    def last(self, span: Span) -> Clause:
        return Clause("LAST", {"last": True}, 1, span)

    def star(self, span: Span) -> Clause:
        return Clause("SELECT", {"columns": (ast.Star(span=span),)}, 1, span)

    def columns(self, span: Span, *columns: Expr) -> Clause:
        return self._make_clause("SELECT", span, columns, columns=self._list_nodes(columns))

    def named(self, span: Span, column: Expr, name: Token) -> Part[ast.Named]:
        (expr,) = self._list_nodes((column,))
        return self._make_part(ast.Named(expr, name.text, span=span), column)

    def sources(self, span: Span, *sources: Part[ast.From]) -> Clause:
        return self._make_clause("FROM", span, sources, sources=tuple(source.node for source in sources))

    def source(self, span: Span, *parts: Any) -> Part[ast.From]:
        name = parts[0].text if len(parts) == 2 else None
        (expr,) = self._list_nodes(parts[-1:])
        return self._make_part(ast.From(name, expr, span=span), parts[-1])

    def joined(self, span: Span, source: Part[ast.From], condition: Expr, optional: bool = False) -> Part[ast.From]:
        self._list_nodes((condition,))
        on = self._check_condition(condition, "ON")
        return self._make_part(replace(source.node, on=on, optional=optional), source, condition)

    def left_joined(self, span: Span, source: Part[ast.From], condition: Expr) -> Part[ast.From]:
        return self.joined(span, source, condition, True)

    def where(self, span: Span, condition: Expr) -> Clause:
        self._list_nodes((condition,))
        return self._make_clause("WHERE", span, (condition,), where=self._check_condition(condition, "WHERE"))

    def start(self, span: Span, *parts: Part[Any]) -> Clause:
        nodes = self._list_nodes(parts)
        self._check_commas(nodes, "START WITH")
        start = tuple(node for node in nodes if isinstance(node, ast.Assign | ast.Each))
        return self._make_clause("START WITH", span, parts, start=start, first=parts)

    def each(self, span: Span, name: Token, values: Expr) -> Part[ast.Each]:
        (node,) = self._list_nodes((values,))
        return self._make_part(ast.Each(name.text, node, span=span, name_span=self._find_span(name)), values)

    def connect(self, span: Span, *parts: Part[Any]) -> Clause:
        nodes = self._list_nodes(parts)
        self._check_commas(nodes, "CONNECT BY")
        made = parts
        for option, value in pairwise(nodes):
            between = self.script_source.text[option.span.end : value.span.start]
            unbounded = isinstance(option, ast.Option) and option == ast.Option("MEMORIZE", None, span=option.span)
            as_number = isinstance(value, ast.Name | ast.Literal | ast.Operator) and not _is_comparison(value)
            if unbounded and as_number and "," not in between:
                literal = isinstance(value, ast.Literal)  # no whole number, so one in parentheses is refused, too
                cure = "for instance MEMORIZE 10, or MEMORIZE (n)" if literal else f"write MEMORIZE ({value.span.text})"
                self._make_error("P001", f"{MEMORIZE_HINT}, not {value.span.text}", value.span, cure)
                made = tuple(part for part in parts if part.node is not value)
        fields = {
            "options": tuple(node for node in nodes if isinstance(node, ast.Option)),
            "connect": tuple(node for node in nodes if isinstance(node, ast.Assign)),
            "made": made,
        }
        return self._make_clause("CONNECT BY", span, parts, **fields)

    def _check_commas(self, nodes: Sequence[ast.Node], keyword: str) -> None:
        """Refuses `town = dst AND src == town`, where a comma is meant: town would become True or False."""
        for node in nodes:
            match node:
                case ast.Assign(name=name, value=ast.And(parts=(first, *others)) as value) if _gives_value(first):
                    in_parentheses = value.span.end < node.span.end
                    own = isinstance(first, ast.Name) and first.name == name
                    if in_parentheses or own or not any(map(_is_comparison, others)):
                        continue
                    rest = self.script_source.text[first.span.end : node.span.end].lstrip(") \n\t")[len("AND") :]
                    self._make_error("P006", f"the parts of {keyword} are separated by commas", value.span,
                                f"write {name} = {first.span.text}, {rest.lstrip()}",
                                f"True or False is assigned in parentheses: {name} = (...)")  # fmt: skip

    def _find_only_condition(self, parts: Sequence[Part[Any]], keyword: str, unset: set[str]) -> ast.Expr | None:
        """The condition among the assignments and options of a clause; nothing sets the variables in `unset`."""
        found = [part.node for part in parts if not isinstance(part.node, ast.Assign | ast.Each | ast.Option)]
        each = next((part.node for part in parts if isinstance(part.node, ast.Each)), None)
        if each and found and all(isinstance(node, ast.Literal) for node in found):
            values = ", ".join(node.span.text for node in (each.values, *found))
            self._make_error("P006", "EACH goes through a list", found[0].span, f"write EACH {each.name} IN [{values}]")
            return None
        for other in found[1:]:
            cure = f"write {_write_conjunct(found[0])} AND {_write_conjunct(other)}"
            if isinstance(found[0], ast.Name | ast.Attribute):
                cure = _write_forgotten_by([part.node for part in parts], found[0]) or cure
            for node in found if keyword == "CONNECT BY" else ():
                match node:
                    case ast.Name(name=name) if name.upper() in VALUED_OPTIONS:
                        cure = f"{name} needs a value, for instance {name} 1"
                    case ast.Name(name=name) if name.upper() in OPTIONS:
                        cure = f"{name} is an option: write it right after CONNECT BY"
                    case ast.Name(name=name) if name.upper() in OTHER_OPTIONS:
                        cure = f"write {OTHER_OPTIONS[name.upper()]} for {name}"
                    case ast.Literal(value=limit) if type(limit) is int:
                        cure = f"write level() <= {limit} AND {_write_conjunct(other)} for a depth limit"
                    case ast.Operator(function="eq", operands=(ast.Name(name=name), value)) if name in unset:
                        cure = f"write {name} = {shorten_text(value.span.text)}"
            error = self._make_error("P001", f"{keyword} has two conditions", other.span, cure)
            error.related = ((found[0].span, "the first one"),)
        return found[0] if found else None

    def option(self, span: Span, *parts: Any) -> Part[ast.Option]:
        by = next((p for p, part in enumerate(parts) if isinstance(part, Token) and part.kind == "BY"), len(parts))
        words = [part.kind for part in parts[:by] if isinstance(part, Token)]
        argument, key = (
            self._list_nodes([p for p in some if isinstance(p, Part)]) for some in (parts[:by], parts[by:])
        )
        values = [part for part in parts if isinstance(part, Part)]
        node = ast.Option(" ".join(words), argument[0] if argument else None, key, span=span)
        return self._make_part(node, *values)

    def stop(self, span: Span, condition: Expr) -> Clause:
        self._list_nodes((condition,))
        return self._make_clause("STOP WITH", span, (condition,), stop=self._check_condition(condition, "STOP WITH"))

    def group(self, span: Span, *parts: Any) -> Clause:
        keys = [part for part in parts if isinstance(part, Part)]
        fields: dict[str, Any] = {"group": self._list_nodes(keys)}
        for having in parts[len(keys) :]:
            fields |= having.fields
        return self._make_clause("GROUP BY", span, parts, **fields)

    def having(self, span: Span, condition: Expr) -> Clause:
        self._list_nodes((condition,))
        return self._make_clause("HAVING", span, (condition,), having=self._check_condition(condition, "HAVING"))

    def siblings(self, span: Span, *keys: Part[ast.OrderKey]) -> Clause:
        return self._make_clause("ORDER SIBLINGS BY", span, keys, siblings=tuple(key.node for key in keys))

    def order(self, span: Span, *keys: Part[ast.OrderKey]) -> Clause:
        return self._make_clause("ORDER BY", span, keys, order=tuple(key.node for key in keys))

    def order_key(self, span: Span, expr: Expr, direction: Token | None = None) -> Part[ast.OrderKey]:
        (node,) = self._list_nodes((expr,))
        return self._make_part(ast.OrderKey(node, direction is not None and direction.kind == "DESC", span=span), expr)

    def limit(self, span: Span, number: Expr, *offset: Expr) -> Clause:
        limit, *first = self._list_nodes((number, *offset))
        return self._make_clause("LIMIT", span, (number, *offset), limit=limit, offset=first[0] if first else None)

    def representation(self, span: Span, name: Token, *arguments: Expr) -> Clause:
        named = tuple(part.node for part in arguments if isinstance(part.node, ast.Assign))
        positional = tuple(part.node for part in arguments if not isinstance(part.node, ast.Assign))
        if named and positional and named[0].span.start < positional[-1].span.start:
            self._make_error("P001", "this argument has no name, but stands after one that has", positional[-1].span,
                        "positional arguments come first, named ones after them")  # fmt: skip
        shape = ast.Representation(name.text, positional, named, span=span)
        return self._make_clause("AS", span, arguments, representation=shape)

    def _make_clause(self, keyword: str, span: Span, parts: Sequence[HasDepth], **fields: Any) -> Clause:
        words = keyword.split()
        place = Span(self.script_source, span.start, span.start + len(words[0]))
        return Clause(keyword, fields, max([part.depth for part in parts], default=0), place)

    def _list_nodes(self, parts: Sequence[Part[Any]]) -> tuple[Any, ...]:
        """The nodes of parts that belong to a query: a query inside it must be ended by AS or parentheses."""
        for part in parts:
            if part.query is not None and part.query.representation is None:
                self._make_error("P009", "this query inside another is not ended", part.query.span, *END_HINT)
        return tuple(part.node for part in parts)


def _write_conjunct(node: ast.Node) -> str:
    text = shorten_text(node.span.text)
    return f"({text})" if isinstance(node, ast.Or | ast.Xor) else text


def _write_forgotten_by(nodes: Sequence[ast.Node], condition: ast.Expr) -> str:
    """The hint `UNIQUE BY town` for `UNIQUE town, ...`, `UNIQUE BY (a, b)` for `UNIQUE BY a, b, ...`; else nothing."""
    option = nodes[max(nodes.index(condition) - 1, 0)]
    if not isinstance(option, ast.Option) or option.keyword not in ("UNIQUE", "NO CYCLE"):
        return ""
    keys = ", ".join(key.span.text for key in (*option.by, condition))
    return f"write {option.keyword} BY {f'({keys})' if option.by else keys}"
