"""Hidden columns: those that a representation needs beside SELECT's.

`SELECT mass FROM space AS plane(...)` needs the bodies' positions, `SELECT mass FROM space AS prolog` the bodies
themselves, `SELECT to(mass, name(this)) FROM space AS dict` the name in each row. Such columns follow those of SELECT,
and only the representation sees them.
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING

from ss2sql.errors import ResolveError
from ss2sql.frontend.resolve.scope import resolve_this
from ss2sql.frontend.syntax.tree_builder import OPERATORS
from ss2sql.language import plan
from ss2sql.language.kinds import Kind
from ss2sql.language.plan_traversal import is_volatile, list_sources, list_states

if TYPE_CHECKING:
    from ss2sql.frontend.resolve.resolver import Resolver

_SIGNS = {*OPERATORS.values(), "neg", "not_in", "item", "slice", "like"}  # calls that are written as operators


def add_hidden_columns(resolver: Resolver, query: plan.Query) -> plan.Query:
    """The query with its representation's columns. Rows of searches and groups belong to no single element."""
    query = _resolve_labels(resolver, query)
    form = query.representation
    wanted = resolver.catalog.hidden_columns.get(form.name)
    if wanted is None or (query.search and not query.last) or query.aggregated or not query.sources:
        return query
    hidden: list[plan.Expr] = []
    facts: tuple[plan.FactColumn, ...] = ()
    if wanted == "elements":
        hidden.extend(_resolve_hidden_elements(query.sources[:1]))
    else:
        facts = tuple(_resolve_hidden_fact(output, query.sources, hidden) for output in query.columns)
    word = wanted.removesuffix("s").replace("call", "argument")
    columns = (*query.columns, *(plan.Output(f"{word} {n}", expr) for n, expr in enumerate(hidden, 1)))
    return replace(query, columns=columns, representation=replace(form, hidden=len(hidden), facts=facts))


def _resolve_labels(resolver: Resolver, query: plan.Query) -> plan.Query:
    """The query with the names that `to` gives to columns row by row, which `AS dict` alone shows.

    UNIQUE and NO CYCLE ignore them: `to(this, "step" + str(level))` repeats where `this` does.
    """
    own = {source.id for source in query.sources}
    named: dict[int, plan.Expr] = {}
    for place, output in enumerate(query.columns):
        label = output.label
        if label is not None and (list_sources(label) & own or query.id in {one for one, _ in list_states(label)}):
            named[place] = label
    if not named:
        return query
    if query.aggregated:
        message = "with GROUP BY or DISTINCT a column has one name"
        span = next(iter(named.values())).span
        resolver.errors.append(ResolveError("R014", message, span, ("show it in a column of its own",)))
    columns = [replace(output, label=None) if n in named else output for n, output in enumerate(query.columns)]
    search, form = query.search, query.representation
    if form.name == "dict":
        if search is not None and search.repeats != "allowed" and not search.key:
            search = replace(search, key=tuple(output.expr for output in columns))
        columns += [plan.Output(f"name {place}", label) for place, label in named.items()]
        form = replace(form, hidden=len(named), labels=tuple(named))
    return replace(query, columns=tuple(columns), search=search, representation=form)


def _resolve_hidden_elements(sources: tuple[plan.Source, ...]) -> list[plan.Expr]:
    """The elements of sources, where these are more than rows of columns."""
    found = [resolve_this(source, source.span) for source in sources if not isinstance(source, plan.TableSource)]
    return [element for element in found if element.type.kinds != Kind.DICT]


def _resolve_hidden_fact(
    output: plan.Output, sources: tuple[plan.Source, ...], hidden: list[plan.Expr]
) -> plan.FactColumn:
    """A column as a fact; the fact's arguments are added to the hidden columns, each once."""
    name, arguments, valued = "", _resolve_hidden_elements(sources), True
    match output.expr:
        case plan.Element() as element:
            arguments, valued = [element], False
        case plan.Column(source=number, name=word):
            name, arguments = word, _resolve_hidden_elements(tuple(source for source in sources if source.id == number))
        case plan.Call(function=function, arguments=given) if function.name not in _SIGNS and not any(
            map(is_volatile, given)
        ):
            word = function.name.removeprefix("world_").rpartition(".")[2]
            name, arguments = word, list(given)
    if not re.fullmatch(rf"{re.escape(name)}(_\d+)?", output.name):
        name = ""  # `to` has given the column a name of its own
    for argument in arguments:
        if argument not in hidden:
            hidden.append(argument)
    return plan.FactColumn(name, tuple(map(hidden.index, arguments)), valued)
