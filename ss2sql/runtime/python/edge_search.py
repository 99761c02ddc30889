"""Searches whose steps are rows of a table or frame of edges, which runtime/search/edge_walk.py walks over arrays."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, TypeAlias

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.kinds import Kind
from ss2sql.runtime.python.query_execution import make_step_meter
from ss2sql.runtime.python.source_loops import loops_over_query_rows
from ss2sql.runtime.run.run_state import Run
from ss2sql.runtime.search.step_contract import Found, Problem
from ss2sql.runtime.sqlite.database_tables import MANY_ROWS
from ss2sql.vtables.frames import Frame

SearchLoop: TypeAlias = Callable[[Problem], Iterator[Found]]


@dataclass(frozen=True, slots=True)
class EdgeSearch:
    """Each step leads from the column `source` to the column `target`; a path ends at the `goal`, None: at each step.

    The edges are a table of the database, or a data frame that has this name.
    """

    edges: plan.TableSource | str
    source: str
    target: str
    goal: plan.Expr | None


def find_edge_search(query: plan.Query) -> EdgeSearch | None:
    """What can be walked over arrays: breadth first with UNIQUE, where a row is the node to which its edge leads."""
    match query:
        case plan.Query(
            sources=(plan.QuerySource(query=edges, optional=False),),
            columns=(plan.Output(expr=plan.Column() as shown),),
            search=plan.Search(
                order="breadth first",
                repeats="unique",
                states=((state, kind),),
                connect=((_, after),),
                stop=None,
                first=None,
                each=(),
                key=(),
            ),
        ) if after == shown:
            goal = None if query.where is None else _find_compared_with(shown, query.where)
        case _:
            return None
    if query.where is not None and not (isinstance(goal, (plan.Constant, plan.Variable)) and _is_integer(goal)):
        return None
    match edges:
        case plan.Query(
            sources=(plan.TableSource() as table,) | (plan.ValueSource(value=plan.Variable(frame=True, name=table)),),
            search=None,
            distinct=False,
            order=(),
            limit=None,
            offset=None,
        ) if edges.where is not None and loops_over_query_rows(edges):
            node = _find_compared_with(plan.State(query.id, state, kind, span=query.span), edges.where)
            target = next(output.expr for output in edges.columns if output.name == shown.name)
        case _:
            return None
    if not (isinstance(node, plan.Column) and isinstance(target, plan.Column)):
        return None
    if not (_is_integer(node) and _is_integer(target)):
        return None
    return EdgeSearch(table, node.name, target.name, goal)


def _is_integer(expr: plan.Expr) -> bool:
    return expr.type.is_only(Kind.INT)


def _find_compared_with(known: plan.Column | plan.State, condition: plan.Expr) -> plan.Expr | None:
    """What the condition compares with a column or a variable, if it is one equality."""
    match condition:
        case plan.Call(function=plan.Function(name="eq", builtin=True), arguments=(left, right)):
            return right if left == known else left if right == known else None
        case _:
            return None


def make_edge_walk(run: Run, search: EdgeSearch, goal: Callable[[], int] | None, others: SearchLoop) -> SearchLoop:
    """The search over arrays, which `others` does where the table is so small that rows are as good."""

    def find_paths(problem: Problem) -> Iterator[Found]:
        columns = _read_columns(run, search)
        if columns is None:
            return others(problem)
        from ss2sql.runtime.search.edge_walk import EdgeArrays, walk_edges

        return walk_edges(EdgeArrays(*columns), problem, goal, make_step_meter(run))

    return find_paths


def _read_columns(run: Run, search: EdgeSearch) -> list[Any] | None:
    """Both columns as arrays; None where rows are as good."""
    edges, names = search.edges, (search.source, search.target)
    if isinstance(edges, plan.TableSource):
        return run.host.read_integer_columns(edges, *names)
    frame = run.get_source(edges)
    if not isinstance(frame, Frame) or frame.length < MANY_ROWS:
        return None
    import numpy as np

    return [np.array(frame.columns[name].values, np.int64) for name in names]
