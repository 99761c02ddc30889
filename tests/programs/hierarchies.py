"""Random searches over a few edges: conditions, several starts, keys behind BY, LAST, what a step says of its path.

Every one is finite: a condition or MEMORIZE bounds the level.
"""

from __future__ import annotations

from typing import Any

from hypothesis import strategies as st

from .case import ProgramCase
from .choices import Choices

# Whole numbers most often; numbers in two forms, words, and several kinds.
NODES = (*[(0, 1, 2, 3, 4)] * 5, (0, 1, 1.0, 2, 0.5), ("", "a", "A", "1", "b"), (None, 0, 1.0, "1", 1))
BYS = ("", "", "BY town", "BY town", "BY (town, day)", "BY dst", "BY (src, town)", "BY day")
GUARDS = ("", "", "UNIQUE", "UNIQUE", "NO CYCLE", "MEMORIZE 4", "MEMORIZE 3")
ORDERS = ("", "", "BREADTH FIRST", "DEPTH FIRST", *(f"COST km{more}" for more in ("", " HEURISTIC")), "HEURISTIC",
          "PROBABILITY km / 4 + 0.1")  # fmt: skip
ESTIMATES = ("1", "dst", "abs(dst - 2)", "0", "level()", "km")
CONDITIONS = (
    *("src == town", "src == town AND level() <= 4", "PRIOR dst == src OR level() == 1", "src == town AND km > 0"),
    *("src == town AND NOT cycle(town)", "src == town AND km < 3 AND level() < 4", "src <= town AND level() < 3"),
    *("src == town AND prior(src) != dst AND level() <= 3", "src == town AND len(path(dst)) < 4"),
    "src == town AND next(town) != root(src) AND level() < 4",
)
ROW = ("dst", "src", "town", "day", "km")
OF_PATHS = (
    *("level()", "prior(dst)", "root(src)", "path(dst)", 'path(src, "-")', "next(town)", "cycle(town)", "cycle(dst)"),
    *("leaf()", "level() + dst", "prior(level())", "next(level())", "path(level())", "prior(prior(dst))"),
)
ENDINGS = ("", "", "", " ORDER BY dst DESC", " LIMIT 2", " ORDER BY level(), dst LIMIT 3", " ORDER BY leaf()")


def hierarchy(c: Choices) -> tuple[str, list[dict[str, Any]]]:
    """A query over the source `edges`, and these."""
    guard, order = c.pick(GUARDS), c.pick(ORDERS)
    memorizes = guard.startswith("MEMORIZE")
    nodes = c.pick(NODES)[: 2 + c.below(4)]
    if memorizes:  # keeps one form of equal states, 1 or 1.0, and nothing says which
        nodes = tuple(dict.fromkeys(nodes))
    edges = [
        {"src": c.pick(nodes), "dst": c.pick(nodes), "km": c.pick((1, 1, 2, 0, 3, 0.5))} for _ in range(1 + c.below(8))
    ]
    if memorizes and order in ("BREADTH FIRST", "DEPTH FIRST", "HEURISTIC"):
        order = ""
    if order.endswith("HEURISTIC"):
        order += f" {c.pick(ESTIMATES if not memorizes else ('1', '0'))}"
    by = c.pick(BYS) if guard else ""
    options = [
        part for part in c.shuffled([f"{guard} {by}".strip(), order, "MAXIMUM 2" if c.chance(15) else ""]) if part
    ]
    condition = "src == town" if memorizes else c.pick(CONDITIONS)
    if not memorizes and "level() <" not in condition and "len(" not in condition:
        condition = f"({condition}) AND level() < {5 if guard else 4}"
    one, other = nodes[0], nodes[-1]
    starts = c.pick((*(f"town = {node!r}" for node in (one, other)), f"EACH town IN {[one, other, one]}"))
    inside = c.chance(20)  # a search for each edge, in FROM
    if inside and c.chance(75):
        starts = c.pick(("town = o.dst", "EACH town IN [o.src, o.dst]"))
    starts += c.pick((", day = 0", ", day = 0", ", EACH day IN [0, 1]"))
    first = c.pick(("", "", "", ", src == 0", ", km < 2"))
    connect = c.pick(("town = dst, day = day + 1", "day = day + 1, town = dst", "town = dst, day = town",
                      "town = IF(day == 1; dst; src), day = day + 1"))  # fmt: skip
    of_path = not memorizes
    said = c.pick(("level()", "prior(dst)", "[path(src), prior(level())]", "root(town)")) if c.chance(15) else ""
    if said and of_path:
        starts, connect = f"{starts}, said = 0", c.pick((f"said = {said}, {connect}", f"{connect}, said = {said}"))
    where = c.pick(("", "", "dst == 1", "dst != src", *(("level() == 2", "prior(dst) == None OR dst == 0") * of_path)))
    stop = c.pick(("", "", "dst == 2", "km == 3", "day == 2", *(("level() == 3", "cycle(town)") * of_path)))
    siblings = c.pick(("", "", "", " ORDER SIBLINGS BY dst", " ORDER SIBLINGS BY km DESC, dst"))
    shown, ending = _shown(c, guard, by, said if of_path else "")
    search = (
        f"SELECT {'LAST ' if inside else c.pick(('', 'LAST '))}{shown} FROM edges{where and f' WHERE {where}'} "
        f"START WITH {starts}{first} CONNECT BY {''.join(f'{option}, ' for option in options)}{condition}, "
        f"{connect}{stop and f' STOP WITH {stop}'}{siblings}{ending}"
    )
    if inside:
        search = f"SELECT {c.pick(('o.dst, h.this', '*', 'o.km, 1'))} FROM o = edges, h = ({search})"
    return search + c.pick((" AS rows", " AS list", " AS dict", "")), edges


def _shown(c: Choices, guard: str, by: str, said: str) -> tuple[str, str]:
    """What SELECT shows, and what comes behind."""
    if (by or not guard) and c.chance(15):
        key = c.pick(("dst", "level()", "root(src)", "leaf()"))
        others = c.pick(("count(*)", "count(*), sum(km)", "max(level())"))
        return f"{key}, {others}", f" GROUP BY {key}{c.pick(('', ' HAVING count(*) > 1'))}"
    columns = c.some((*ROW, *OF_PATHS), 1, 3)
    if guard and not by and not set(columns) & set(ROW):
        columns.append(c.pick(("dst", "town")))
    return ", ".join([*columns, *["said", "next(said)"][: 2 * bool(said)]]), c.pick(ENDINGS)


@st.composite
def hierarchies(draw: Any) -> ProgramCase:
    """A search with its edges, which are a variable or a table."""
    c = Choices(draw(st.binary(min_size=24, max_size=90)))
    as_table = c.chance(50)
    script, edges = hierarchy(c)
    return ProgramCase(script, **({"tables": {"edges": edges}} if as_table else {"variables": {"edges": edges}}))
