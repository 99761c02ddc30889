"""`near`: what is at most so far from a point lies in a box around it, and a world can be queried for that.

    WHERE distance(this, p) <= 1            also asks            x BETWEEN p[0] - 1.000001 AND p[0] + 1.000001 ...

The distance is tested as before, of what the adapter finds in the box: that 1,006 bodies of PyBullet all ask for their
neighbours within 1 m takes 0.3 s in place of 180 s, for 6,794 distances are measured in place of a million.

The adapter has promised what `distance` measures, by `Table.places`; the point and the radius must be numbers that are
known before the table is walked. Nothing that is compared can fail then, so it shows nowhere that the rest is evaluated
for fewer elements.

    WHERE abs(o.t - s.t) < 0.1              also asks            o.t BETWEEN s.t - 0.1000001 AND s.t + 0.1000001

    WHERE distance([p.x, p.y], [q.x, q.y]) < 1

of the elements of a list or data frame, for each row of another source: these are looked up in the order of t or q.x.
So it is with a difference, which is to be some number, or above or below it:

    WHERE b.t - a.t < 0.1                   also asks            b.t <= a.t + 0.1000001
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.kinds import Kind
from ss2sql.language.operations import OPERATIONS
from ss2sql.language.plan_traversal import list_sources, split_and, walk
from ss2sql.lowering.guards import is_free
from ss2sql.lowering.rewrites.constant_folding import fold_node
from ss2sql.lowering.rewrites.rewrite_context import (
    RewriteContext,
    make_call,
    make_constant,
    rewrite_bottom_up,
)

# So much wider is the box: more than what floats lose between the distance and the ends of the box. It can be a factor,
# for where a float ends a range, rounding the end never leaves the float outside.
RADIUS_TOLERANCE = 1.000001
MAX_DISTANCE = 1e150  # of coordinates, so that no distance is infinite
MAX_NUMBER = 2.0**53  # of places on a line, so that integers are floats as well
# The ends of a difference that is compared with a number: above it, below it.
_ENDS = {"lt": (1,), "le": (1,), "gt": (-1,), "ge": (-1,), "eq": (1, -1)}
_NEEDED_OPERATORS = frozenset({"ge", "le", "lt", "gt", "add", "sub", "mul", "item"})
_NUMBER = Kind.INT | Kind.FLOAT

Sources = Mapping[int, plan.Source]


@dataclass(frozen=True, slots=True)
class Point:
    """Something at a point: its coordinates, and the source whose element it is, if it is one."""

    coordinates: tuple[plan.Expr, ...]
    source: plan.WorldSource | plan.ValueSource | None = None
    is_element: bool = False


def limit_distances(query: plan.Query, world: RewriteContext) -> plan.Query:
    sources: Sources = {node.id: node for node in walk(query) if isinstance(node, plan.SOURCES)}
    if not _NEEDED_OPERATORS.isdisjoint(world.replaced):
        return query
    return rewrite_bottom_up(
        query, lambda node: _rewrite_to_boxes(node, sources) if isinstance(node, plan.Query) else node
    )


def _rewrite_to_boxes(query: plan.Query, sources: Sources) -> plan.Query:
    if query.where is None:
        return query
    parts = split_and(query.where)
    number = {source.id: index for index, source in enumerate(query.sources)}
    wanted: list[plan.Expr] = []
    for part in parts:
        found = _derive_ranges(part, number, sources) or _derive_difference_ends(part, number, sources)
        wanted += [one for one in found if one not in parts]
        wanted.append(part)
    return query if len(wanted) == len(parts) else replace(query, where=plan.And(tuple(wanted), span=query.where.span))


def _derive_ranges(part: plan.Expr, number: Mapping[int, int], sources: Sources) -> list[plan.Expr]:
    """What a condition implies of columns of one of the query's own sources, `number` of them by their ids."""
    match part:
        case plan.Call(function=plan.Function(name="lt" | "le", builtin=True), arguments=(plan.Call() as away, radius)):
            pass
        case plan.Call(function=plan.Function(name="gt" | "ge", builtin=True), arguments=(radius, plan.Call() as away)):
            pass
        case _:
            return []
    if not radius.type.is_only(_NUMBER):
        return []
    places = _find_points_to_rewrite(away, sources)
    if places is None:
        return []
    for place, centre in (places, places[::-1]):
        source = place.source
        ends = (*centre.coordinates, radius)
        if source is not None and _can_rewrite_to_range(source, place) and _is_known_before(ends, source, number):
            return _build_ranges(place, centre, _widen_radius(radius))
    return []


def _is_known_before(
    values: tuple[plan.Expr, ...], source: plan.WorldSource | plan.ValueSource, number: Mapping[int, int]
) -> bool:
    """Whether values are known when a source of the query is walked; one whose ends stay the same is walked once."""
    if source.id not in number:
        return False
    known = list_sources(plan.MakeList(values, span=values[0].span))
    if isinstance(source, plan.ValueSource) and not known:
        return False
    return all(number.get(other, -1) < number[source.id] for other in known)


def _derive_difference_ends(part: plan.Expr, number: Mapping[int, int], sources: Sources) -> list[plan.Expr]:
    """What `left - right < 1` implies of the place of one of them, for the other."""
    match part:
        case plan.Call(
            function=plan.Function(name=compared, builtin=True),
            arguments=(
                plan.Call(function=plan.Function(name="sub", builtin=True), arguments=(left, right)),
                plan.Constant(value=int() | float() as bound),
            ),
        ) if compared in _ENDS:
            pass
        case _:
            return []
    for sign, (near, far) in ((1, (left, right)), (-1, (right, left))):
        place, centre = _find_place_on_line(near, sources), _find_place_on_line(far, sources)
        if place is None or centre is None or place.source is None:
            continue
        if not _is_known_before((far,), place.source, number):
            continue
        whole = near.type.is_only(Kind.INT) and far.type.is_only(Kind.INT)
        span, found = part.span, list[plan.Expr]()
        for outwards in _ENDS[compared]:
            away = make_constant(sign * (bound if whole else _widen_end(bound, outwards)), span)
            end = make_call("add", far, away, span=span)
            found.append(make_call("le" if sign * outwards > 0 else "ge", near, end, span=span))
        return found if is_free(*found) else []
    return []


def _find_points_to_rewrite(away: plan.Call, sources: Sources) -> tuple[Point, Point] | None:
    """Between which two places a call measures the straight way, if it is certain to do so."""
    function = away.function
    match away:
        case plan.Call(
            function=plan.Function(name="abs", builtin=True),
            arguments=(plan.Call(function=plan.Function(name="sub", builtin=True), arguments=(left, right)),),
        ):
            ends = _find_place_on_line(left, sources), _find_place_on_line(right, sources)
            return None if ends[0] is None or ends[1] is None else (ends[0], ends[1])
    if len(away.arguments) != 2 or (function.of_world or (function.builtin and function.name)) != "distance":
        return None
    one, other = (_find_point_to_rewrite(argument, sources) for argument in away.arguments)
    if one is None or other is None:
        return None
    types = tuple(argument.type for argument in away.arguments)
    measured = one.is_element or other.is_element or not OPERATIONS["distance"].can_fail(types)
    return (one, other) if measured else None


def _find_point_to_rewrite(expr: plan.Expr, sources: Sources) -> Point | None:
    """The place of an element, of a column that says where an element is, or of a list of two or three numbers."""
    if isinstance(expr, (plan.Element, plan.Column)):
        source = sources.get(expr.source)
        name = "this" if isinstance(expr, plan.Element) else expr.name
        if isinstance(source, plan.WorldSource) and name in source.table.schema.places:
            kinds = dict(source.columns)
            columns = (plan.Column(source.id, c, kinds[c], span=expr.span) for c in source.table.schema.places[name])
            return Point(tuple(columns), source, isinstance(expr, plan.Element))
    coordinates = _get_coordinates(expr)
    if not coordinates or not all(map(_is_distance_to_rewrite, coordinates)):
        return None
    owners = list_sources(plan.MakeList(coordinates, span=expr.span))
    source = sources.get(*owners) if len(owners) == 1 else None
    return Point(coordinates, source if isinstance(source, plan.ValueSource) else None)


def _find_place_on_line(expr: plan.Expr, sources: Sources) -> Point | None:
    """The place of a number, which may be a column of the elements of a value."""
    if not _is_distance_to_rewrite(expr) or not expr.type.is_bounded(MAX_NUMBER):
        return None
    source = sources.get(expr.source) if isinstance(expr, (plan.Column, plan.Element)) else None
    return Point((expr,), source if isinstance(source, plan.ValueSource) else None)


def _get_coordinates(expr: plan.Expr) -> tuple[plan.Expr, ...]:
    positions = expr.type.positions
    if not expr.type.is_only(Kind.LIST) or positions is None or len(positions) not in (2, 3):
        return ()
    places = [make_constant(index, expr.span) for index in range(len(positions))]
    return tuple(fold_node(make_call("item", expr, place, span=expr.span)) for place in places)


def _is_distance_to_rewrite(expr: plan.Expr) -> bool:
    return expr.type.is_only(_NUMBER) and expr.type.is_bounded(MAX_DISTANCE) and is_free(expr)


def _can_rewrite_to_range(source: plan.WorldSource | plan.ValueSource, place: Point) -> bool:
    """Whether ranges of the coordinates are looked up; an adapter takes those that it says."""
    if isinstance(source, plan.ValueSource):
        return True
    schema = source.table.schema
    operators = {column.name: column.operators for column in schema.columns}
    names = [column.name for column in place.coordinates if isinstance(column, plan.Column)]
    return schema.walked is None and all({"<=", ">="} <= operators[name] for name in names)


def _widen_radius(radius: plan.Expr) -> plan.Expr:
    if isinstance(radius, plan.Constant):
        return make_constant(float(f"{radius.value * RADIUS_TOLERANCE:.9g}"), radius.span)
    return make_call("mul", radius, make_constant(RADIUS_TOLERANCE, radius.span), span=radius.span)


def _widen_end(bound: float, outwards: int) -> float:
    """An end of a difference, which is rounded once, as much further out as that of a distance."""
    return float(f"{bound + outwards * abs(bound) * (RADIUS_TOLERANCE - 1):.9g}")


def _build_ranges(place: Point, centre: Point, radius: plan.Expr) -> list[plan.Expr]:
    found: list[plan.Expr] = []
    for column, value in zip(place.coordinates, centre.coordinates, strict=False):
        if not isinstance(column, (plan.Column, plan.Element)):
            continue  # nothing is looked up by what is computed
        span = column.span
        found.append(make_call("ge", column, make_call("sub", value, radius, span=span), span=span))
        found.append(make_call("le", column, make_call("add", value, radius, span=span), span=span))
    return found if is_free(*found) else []
