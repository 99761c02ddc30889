"""Small worlds to search in: each function makes one, with all that a query about it can be made of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from .choices import Choices


@dataclass(frozen=True)
class Machine:
    """A small world to search in, as texts.

    `row` are columns that decide alone what a step leads to, `others` further ones. `goals` and `stops` are
    conditions that the row decides, `loose_goals` and `loose_stops` read more. `legal` bounds how many steps of a
    state can go on; there are few different rows, so that a search for new rows ends.
    """

    sources: str
    start: tuple[tuple[str, str], ...]
    connect: tuple[tuple[str, str], ...]
    row: tuple[str, ...]
    others: tuple[str, ...]
    goals: tuple[str, ...]
    stops: tuple[str, ...]
    legal: int
    loose_goals: tuple[str, ...] = ()
    loose_stops: tuple[str, ...] = ()
    costs: tuple[str, ...] = ("1", "0", "0.5")
    bounds: tuple[str, ...] = ("1",)  # heuristics that depend on the row alone
    chances: tuple[str, ...] = ("0.5", "1", "0.25")
    ints: tuple[str, ...] = ()
    must_stop: str = ""
    uses: tuple[str, ...] = ()
    before: str = ""  # a statement that the query needs


def ring(c: Choices) -> Machine:
    """Numbers modulo a small one."""
    size = c.pick((5, 3, 4, 7))
    steps = c.pick(("[1, 2]", "[1, -1]", "[2, 1, 2]", "[1, 3]", "[1]"))
    after = f"(pos + this) % {size}"
    return Machine(
        f"{c.pick(('', 's = '))}{steps}",
        start=(("pos", c.pick(("0", "1", "2"))),),
        connect=(("pos", after),),
        row=(after,),
        others=("pos", "this", "[pos, this]"),
        goals=(f"{after} == {c.below(size)}", f"{after} > 1", "True"),
        stops=(f"{after} == {c.below(size)}",),
        legal=1 + steps.count(","),
        loose_goals=("pos < this",),
        loose_stops=("pos == 2",),
        costs=("abs(this)", "1", "pos", "0.5 + pos", f"{after} / 2", "IF(pos == 1; True; 2)"),
        bounds=(f"({after})", f"{after} / 2", f"abs(2 - {after})"),
        chances=("0.5", "1 / (1 + abs(this))", "IF(pos == 1; 0; 0.5)", "1"),
        ints=("pos", "this", "pos + this"),
    )


def floats(c: Choices) -> Machine:
    """Floats modulo 2."""
    after = "(x + this) % 2.0"
    moves = c.pick(("[0.5, 1.0]", "[0.5, 0.25]", "[1.5]"))
    return Machine(
        "moves",
        start=(("x", c.pick(("0.0", "0.5", "1.5"))),),
        connect=(("x", after),),
        row=(after,),
        others=("x", "this", "x * this"),
        goals=(f"{after} == {c.pick(('1', '1.5', '0.0'))}", f"{after} >= 1"),
        stops=(f"{after} == {c.pick(('0.5', '1.0'))}",),
        legal=1 + moves.count(","),
        loose_goals=("x == this",),
        loose_stops=("x > 1.2",),
        costs=("this", "x", "this * 0.1"),
        bounds=(after,),
        chances=("this / 2", "0.3", "0.7"),
        before=f"moves = {moves}; ",
    )


def words(c: Choices) -> Machine:
    """Words that grow letter by letter; two ways may spell the same word."""
    letters = c.pick(("['a', 'b']", "['a', 'aa']", "['b', 'ab', 'a']"))
    after = "text + this"
    size = c.pick((3, 2, 4)) if letters.count(",") == 1 else 2
    return Machine(
        letters,
        start=(("text", c.pick(("''", "'a'"))),),
        connect=(("text", after),),
        row=(after,),
        others=("text", "this", "len(text)"),
        goals=(f"{after} == 'ab'", f"'a' IN {after}", f"len({after}) > 1", f"({after})[-1] == 'a'"),
        stops=(f"{after} == 'aa'",),
        legal=letters.count(",") + 1,
        loose_goals=("this > text",),
        costs=("len(this)", "1", "len(text)"),
        bounds=(f"len({after})",),
        chances=("0.5", "1 / len(this)", "IF(this == 'b'; 0.9; 0.4)"),
        ints=("len(text)", "len(this)"),
        must_stop=f"len({after}) > {size}",
    )


def towers(c: Choices) -> Machine:
    """Two disks on three towers, moved by a function that changes its argument."""
    after = "shift(this, tower)"
    goal = c.pick(("[[], [], [2, 1]]", "[[], [2, 1], []]", "[[1], [2], []]"))
    return Machine(
        c.pick(("[[0, 1], [0, 2], [1, 0], [1, 2], [2, 0], [2, 1]]", "[[0, 1], [1, 2], [2, 0]]")),
        start=(("tower", c.pick(("[[2, 1], [], []]", "[[2], [1], []]"))),),
        connect=(("tower", after),),
        row=("this", "tower"),
        others=("tower[0]", "len(tower[2])", after),
        goals=(f"{goal} == {after}", f"{after} == {goal}", f"[] != {after} AND {after}[0] == []"),
        stops=(f"{after} == {goal}",),
        legal=3,
        costs=("1", "this[0] + this[1]", "len(tower[0])"),
        bounds=("this[0]", "1"),
        chances=("0.5", "1 / (1 + this[0])", "IF(this[1] == 2; 0.9; 0.3)"),
        ints=("len(tower[0])", "this[0]"),
        must_stop=f"[] == {after}",
        uses=("shift",),
    )


def graph(c: Choices) -> Machine:
    """A successor function that mentions the state: a list of nodes, or rows with weights."""
    with_rows = c.chance(50)
    node = "n.to_node" if with_rows else "n.this"
    return Machine(
        "n = links(node)" if with_rows else "n = near(node)",
        start=(("node", c.pick(("0", "1", "2"))),),
        connect=(("node", node),),
        row=(node,),
        others=("node", "this", f"{node} + node", *(("n.toll", "links(node)") if with_rows else ("near(node)",))),
        goals=(f"{node} == {c.below(5)}", f"{node} IN [3, 4]", "True"),
        stops=(f"{node} == {c.below(5)}",),
        legal=3,
        loose_goals=(f"{node} > node",),
        loose_stops=("node == 3",),
        costs=("n.toll", "1", f"n.toll + {node}") if with_rows else ("1", f"{node}", "abs(n.this - node)"),
        bounds=(node, f"4 - {node}"),
        chances=(f"1 / (1 + {node})", "0.5", f"IF({node} == 2; 0; 0.8)"),
        ints=("node", node),
        uses=("links",) if with_rows else ("near",),
    )


def edges(c: Choices) -> Machine:
    """A table of edges, read for each state by a nested query, or scanned with conditions."""
    scan = c.chance(40)
    place = "" if scan else "e."
    follows = "src == node AND " if scan else ""
    return Machine(
        "edges" if scan else "e = (SELECT * FROM edges WHERE src == node)",
        start=(("node", c.pick(("0", "1", "2"))),),
        connect=(("node", f"{place}dst"),),
        row=("src", "dst", "node") if scan else ("e.dst",),
        others=("node", f"{place}src", f"{place}far", "this"),
        goals=(f"{follows}{place}dst == {c.below(4)}", f"{follows}True"),
        stops=(f"{place}dst == {c.below(4)}",),
        legal=3,
        loose_goals=(f"{follows}{place}far > 1",),
        loose_stops=("node == 3",),
        costs=(f"{place}far", "1", f"{place}far / 2"),
        bounds=(f"{place}dst",),
        chances=(f"1 / (1 + {place}far)", "0.5"),
        ints=("node", f"{place}dst", f"{place}far"),
        must_stop="src != node" if scan else "",
    )


def product(c: Choices) -> Machine:
    """Two sources, the second of which may mention the state; a later variable sees an earlier one."""
    after = "(pos + a.this * b.this) % 4"
    second = c.pick(("b = [1, 2]", "b = [0, 3]", "b = [pos, 1]", "b = range(1 + pos % 2)"))
    return Machine(
        f"a = {c.pick(('[1, 2]', '[1]', '[0, 1]'))}, {second}",
        start=(("pos", "0"), ("before", "pos - 1")),
        connect=(("before", "pos"), ("pos", after)),
        row=(after,),
        others=("pos", "a.this", "b.this", "before"),
        goals=(f"{after} == {c.below(4)}", f"{after} >= 1"),
        stops=(f"{after} == {c.below(4)}",),
        legal=4,
        loose_goals=("a.this < b.this", "before < pos"),
        loose_stops=("pos > 2",),
        costs=("a.this", "b.this", "pos"),
        bounds=(after,),
        chances=("0.5", "a.this / 2", "1 / (1 + b.this)"),
        ints=("pos", "a.this", "b.this", "before"),
    )


def grid(c: Choices) -> Machine:
    """Places in a square, as lists; `+` may be replaced by the addition of vectors."""
    vectors = c.chance(40)
    after = "cur + this" if vectors else "[cur[0] + this[0], cur[1] + this[1]]"
    return Machine(
        c.pick(("[[0, 1], [1, 0]]", "[[0, 1], [1, 0], [-1, 0]]", "[[1, 1], [1, 0]]")),
        start=(("cur", "[0, 0]"),),
        connect=(("cur", after),),
        row=(after,),
        others=("cur", "this", "cur[0]"),
        goals=(f"[2, 2] == {after}", f"({after})[1] == {c.below(3)}", f"{after} IN [[1, 1], [2, 1.0]]"),
        stops=(f"{after} == [1, 1]",),
        legal=3,
        loose_stops=("cur == [1.0, 2]",),
        costs=("1", "cur[0]", "abs(this[0])", "distance(cur, cur)"),
        bounds=(f"abs(2 - ({after})[0])", f"({after})[1]"),
        chances=("0.5", "1 / (1 + cur[1])"),
        ints=("cur[0]", "cur[1]"),
        must_stop=f"({after})[0] > 2 OR ({after})[1] > 2 OR ({after})[0] < 0",
        uses=("add",) if vectors else (),
    )


MACHINES: tuple[Callable[[Choices], Machine], ...] = (ring, graph, edges, words, towers, product, grid, floats)
