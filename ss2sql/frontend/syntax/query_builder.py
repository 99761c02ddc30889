"""The builder's second half: queries and their clauses.

The grammar accepts the clauses of a query in any order and number; their order is checked here, where the error can
name both clauses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

from ss2sql.errors import Span
from ss2sql.fast_dataclasses import dataclass
from ss2sql.frontend.syntax import ast
from ss2sql.frontend.syntax.expression_builder import END_HINT, MEMORIZE_HINT, Expr, ExpressionBuilder, HasDepth, Part
from ss2sql.frontend.syntax.tokenizer import Token, shorten_text

FIXED = ("WHERE", "START WITH", "CONNECT BY", "STOP WITH")
FREE = ("GROUP BY", "ORDER SIBLINGS BY", "ORDER BY", "LIMIT")
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
        """The node of a query from its clauses, each at most once and in its place."""
        fields: dict[str, Any] = {}
        seen: dict[str, Clause] = {}
        ordered = True
        for clause in clauses:
            ordered = ordered and self._check_order(clause, seen)
            seen.setdefault(clause.keyword, clause)
            fields |= clause.fields
        node = ast.Query(**fields, span=span)
        return self._make_part(node, *clauses, query=node)

    def _check_order(self, clause: Clause, seen: dict[str, Clause]) -> bool:
        """Refuses a clause that occurs twice, or after one that it must precede; False if it does."""
        keyword = clause.keyword
        later = (*FIXED[FIXED.index(keyword) + 1 :], *FREE) if keyword in FIXED else ()
        wrong = next((other for other in seen if other in later), None)
        if keyword in seen:
            cures = {"WHERE": "join the conditions with AND", "STOP WITH": "join the conditions with OR"}
            cure = cures.get(keyword, "keep one of them" if keyword == "LIMIT" else "write one list, with commas")
            error = self._make_error("P001", f"{keyword} stands twice in this query", clause.span, cure)
            error.related = ((seen[keyword].span, "the first one"),)
        elif wrong is not None:
            error = self._make_error("P001", f"{keyword} stands before {wrong}, not after it", clause.span,
                                f"the order is {ORDER}")  # fmt: skip
            error.related = ((seen[wrong].span, "this comes later"),)
        return keyword not in seen and wrong is None

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
        start = tuple(node for node in self._list_nodes(parts) if isinstance(node, ast.Assign | ast.Each))
        return self._make_clause(
            "START WITH", span, parts, start=start, first=self._find_only_condition(parts, "START WITH")
        )

    def each(self, span: Span, name: Token, values: Expr) -> Part[ast.Each]:
        (node,) = self._list_nodes((values,))
        return self._make_part(ast.Each(name.text, node, span=span, name_span=self._find_span(name)), values)

    def connect(self, span: Span, *parts: Part[Any]) -> Clause:
        nodes = self._list_nodes(parts)
        for option, value in pairwise(nodes):
            between = self.script_source.text[option.span.end : value.span.start]
            unbounded = isinstance(option, ast.Option) and option == ast.Option("MEMORIZE", None, span=option.span)
            if unbounded and isinstance(value, ast.Name | ast.Literal) and "," not in between:
                self._make_error("P001", f"{MEMORIZE_HINT}, not {value.span.text}", value.span,
                            f"write MEMORIZE ({value.span.text})")  # fmt: skip
        fields = {
            "options": tuple(node for node in nodes if isinstance(node, ast.Option)),
            "connect": tuple(node for node in nodes if isinstance(node, ast.Assign)),
            "made": self._find_only_condition(parts, "CONNECT BY"),
        }
        return self._make_clause("CONNECT BY", span, parts, **fields)

    def _find_only_condition(self, parts: Sequence[Part[Any]], keyword: str) -> ast.Expr | None:
        """The condition among the assignments and options of a clause."""
        found = [part.node for part in parts if not isinstance(part.node, ast.Assign | ast.Each | ast.Option)]
        each = next((part.node for part in parts if isinstance(part.node, ast.Each)), None)
        if each and found and all(isinstance(node, ast.Literal) for node in found):
            values = ", ".join(node.span.text for node in (each.values, *found))
            self._make_error("P006", "EACH goes through a list", found[0].span, f"write EACH {each.name} IN [{values}]")
            return None
        for other in found[1:]:
            text = f"{found[0].span.text} AND {other.span.text}"
            error = self._make_error("P001", f"{keyword} has two conditions", other.span, f"write {shorten_text(text)}")
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
