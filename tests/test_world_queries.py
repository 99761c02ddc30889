"""What every simulator does: queries give what loops over its interface give, and functions mean the same in all.

Random queries run over each world, and over copies of its tables, while bodies move, are born and die. How many are
drawn is set by `SS2SQL_PROGRAMS`, or for this file by `SS2SQL_WORLD_QUERIES` and `SS2SQL_SCENES`.
"""

from __future__ import annotations

import os
import re
from collections import Counter
from math import pi
from pathlib import Path
from random import Random
from typing import Any

import fake_openravepy as fake
import pytest
from golden import each_row
from programs.drawn import amount
from sessions import ENGINES, answers
from simulators import ARGUMENTS, SIMULATORS, Stage, Things, agree

import ss2sql

QUERIES = int(os.environ.get("SS2SQL_WORLD_QUERIES") or amount(0.3))
SCENES = int(os.environ.get("SS2SQL_SCENES") or amount(0.2) // 4)
EACH = 100  # queries of one scene
BODIES = 12
every = pytest.mark.parametrize("simulator", SIMULATORS, indirect=True)
with_a_room = pytest.mark.parametrize("simulator", sorted(set(SIMULATORS) - {"Things"}), indirect=True)


@pytest.fixture
def simulator(request: pytest.FixtureRequest) -> Any:
    return SIMULATORS[request.param](request)


@pytest.fixture
def room(simulator: Any, ss: ss2sql.Session) -> Stage:
    """A ball, a crate and a pearl, which are the world `space` of the session."""
    made: Stage = simulator.room()
    ss.attach("space", made.source)
    return made


# --- random queries ------------------------------------------------------------------------------------


@pytest.mark.drawn
@every
def test_queries_give_what_loops_give(simulator: Any, ss: ss2sql.Session) -> None:
    """The paper's queries, before and after steps, births and deaths. The engines take turns."""
    for seed in range(SCENES):
        stage = simulator.scene(seed, 40 if seed % 10 == 9 else 2 + seed % 9)
        ss.attach("space", stage.source)
        for change in (False, True):
            if change:
                stage.change(Random(seed))
            bodies = stage.look()
            assert bodies
            agree(ss, bodies, ENGINES[seed % len(ENGINES)])


@pytest.mark.drawn
@every
def test_random_queries_give_what_copies_give(simulator: Any) -> None:
    asked, seed, elements = 0, 0, Counter[str]()
    while asked < QUERIES:
        stage = simulator.scene(seed, BODIES)
        report = ss2sql.check_world(stage.source, seed, min(EACH, QUERIES - asked), stage.change, ARGUMENTS)
        assert report.skipped == []
        asked += report.queries
        elements.update(report.elements)
        seed += 1
    assert asked == QUERIES
    assert elements["bodies"] > 0
    if isinstance(simulator, Things):
        assert min(elements[table] for table in ("links", "joints", "shapes")) > 0


@pytest.mark.parametrize("simulator", ["PyBullet", "MuJoCo", "Ode"], indirect=True)
def test_chaos_is_the_same_for_the_same_seed_and_stays_in_its_box(simulator: Any, ss: ss2sql.Session) -> None:
    def played(seed: int, at_once: int) -> list[Any]:
        """What is there after each second."""
        stage, seconds = simulator.scene(seed, 40), []
        ss.attach("space", stage.source)
        for second in range(1, 4):
            for _ in range(240 // at_once):
                stage.source.step(at_once)
            bodies = stage.look()
            assert max(abs(part) for body in bodies if body.free for part in body.pos) < 5.1
            assert ss.eval("getTime();") == pytest.approx(second)
            seconds.append(bodies)
        return seconds

    one, other = played(7, 240), played(7, 1)
    assert one == other != played(8, 240)
    assert any(body.rise for body in one[-1])
    born = {body.name for body in one[-1]} - {body.name for body in one[0]}
    assert born or not hasattr(ss.get("space").source, "births")


PAGES = {"Ode": "ode.md", "OpenRave": "openrave.md"}


@pytest.mark.parametrize("simulator", PAGES, indirect=True)
def test_pages_of_simulators_show_what_code_gives(simulator: Any, capsys: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    page = PAGES[type(simulator).__name__]
    monkeypatch.setattr(fake.Environment, "Load", lambda self, file: simulator.load(self), raising=False)
    text = (Path(__file__).parent.parent / "docs" / page).read_text("utf-8")
    code, shown = re.findall(r"^```py\n(.*?)^```\n+```\w*\n(.*?)^```", text, re.DOTALL | re.MULTILINE)[0]
    exec(compile(code, page, "exec"), {})
    assert capsys.readouterr().out == shown


# --- a ball, a crate and a pearl -----------------------------------------------------------------------


@with_a_room
def test_columns_of_a_room(room: Stage, ss: ss2sql.Session) -> None:
    columns = "type, mass, isEnabled, isSphere, velocity, angularVelocity, quat, rot"
    rows = answers(ss, f"SELECT {columns} FROM space WHERE mass > 0 AS rows;")
    still = ([0, 0, 0], [0, 0, 0], [0, 0, 0, 1], [0, 0, 0])
    assert rows == [
        ("sphere", 60.0, True, True, *still),
        ("box", 10.0, True, False, *still),
        ("sphere", 51.0, True, True, *still),
    ]
    (volume, ball), (cube, _), _ = answers(ss, "SELECT volume, aabb FROM space WHERE mass > 0 AS rows;")
    assert (volume, cube) == pytest.approx((4 / 3 * pi * 0.5**3, 1.0))
    assert ball == [pytest.approx([-0.5, -0.5, 0.5]), pytest.approx([0.5, 0.5, 1.5])]


@with_a_room
def test_distances_are_between_positions_and_gaps_between_surfaces(room: Stage, ss: ss2sql.Session) -> None:
    script = "SELECT name(c.b), c.distance FROM c = space.closest('ball', None, {}) AS rows;"
    gaps = answers(ss, script.format(9))
    assert gaps == [("crate", pytest.approx(1.0, abs=1e-6)), ("pearl", pytest.approx(0.4, abs=1e-6))]
    assert answers(ss, script.format(0.5)) == gaps[1:]
    both = "SELECT c.distance FROM a = space, c = space.closest(a.this, 'pearl', 9) WHERE a.name == 'ball' AS list;"
    assert answers(ss, both) == [gaps[1][1]]
    script = "[distance('ball', 'crate'), distance('ball', [0, 3, 5]), distance([3, 4], 'ball')];"
    assert answers(ss, script) == [2, 5, 5]


@with_a_room
def test_above_below_within_and_overlaps_go_by_boxes(room: Stage, ss: ss2sql.Session) -> None:
    def names(condition: str, source: str = "space") -> Any:
        return answers(ss, f"SELECT name FROM {source} WHERE mass > 0 AND {condition} AS list;")

    assert names("within(this, [[-2, -1, 0], [1, 1, 2]])") == ["ball", "pearl"]
    assert names("above(this, [[1, 0, 0], [-1, 0, 0.5]])") == ["ball", "pearl"]
    assert names("above(this, [[1, 0, 0], [-1, 0, 1.5]])") == []
    assert names("below(this, [[1, 0, 4], [2, 0, 5]])") == ["crate"]
    assert names("id >= 0", "space.overlaps([[0.4, 0, 1], [1.6, 1, 1]])") == ["ball", "crate"]
    assert names("id >= 0", "space.overlaps('pearl')") == ["pearl"]
    assert answers(ss, "[within('pearl', 'crate'), above('ball', 'crate')];") == [False, False]


@with_a_room
def test_bodies_are_tried_out_and_moved(simulator: Any, room: Stage, ss: ss2sql.Session) -> None:
    before = room.look()
    tried = "collision('ball', [1.2, 0]), collision('ball', [1.2, 0, 9]), collision('ball', 'crate'), collision('ball')"
    assert answers(ss, f"[{tried}];") == [True, False, False, False]
    assert room.look() == before
    script = "[move('ball', {0}), checkCollision('ball'), position('ball')];"
    assert answers(ss, "move('ball', [0, 0, 1, 0, 0, 0, 2]);") == [0, 0, 1, 0, 0, 0, 2]
    assert ss.run(script.format([1.2, 0])).value == [[1.2, 0], True, [1.2, 0]]
    assert [body.pos for body in room.look() if body.name == "ball"] == [(1.2, 0.0, 1.0)]  # it keeps its height
    assert answers(ss, "[collision('ball'), collision('ball', 'crate'), collision('pearl')];") == [True, True, False]
    assert ss.run(script.format([-4, 0, 7]), engine="native").value == [[-4, 0, 7], False, [-4, 0]]


@with_a_room
@each_row("worlds/wrong-use", "script", "message")
def test_wrong_use_is_told(room: Stage, ss: ss2sql.Session, engine: Any, script: str, message: str) -> None:
    with pytest.raises(ss2sql.Error, match=message) as caught:
        ss.run(script, engine=engine)
    assert caught.value.code in ("X007", "X011", "R005")
    assert [body.name for body in room.look() if body.mass] == ["ball", "crate", "pearl"]


@with_a_room
def test_the_dead_are_gone_and_elements_are_the_same_in_all_sessions(room: Stage, ss: ss2sql.Session) -> None:
    ball, pearl = ss.eval("SELECT this FROM space WHERE isSphere(this) AS list;")
    assert (ball.mass, pearl.mass) == (60.0, 51.0)
    with ss2sql.connect() as other:
        other.attach("there", room.source)
        assert other.eval("SELECT this FROM there WHERE isSphere(this) AS list;") == [ball, pearl]
    if room.kill is None:
        return
    room.kill("pearl")
    assert answers(ss, "SELECT name FROM space AS list;") == ["ball", "crate"]
    assert ball.mass == 60.0
    with pytest.raises(ss2sql.Error, match="no longer exists"):
        pearl.mass  # noqa: B018
