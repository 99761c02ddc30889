"""Random queries over every world that is shipped, and over copies of its tables: both give the same.

WHERE with AND, OR, NOT and IN, joins with the tables in both orders, ORDER BY and LIMIT, on both engines, while bodies
move, are born and die. `SS2SQL_WORLD_QUERIES` sets how many for each world; 300 without it.
"""

from __future__ import annotations

import os
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any

import fake_openravepy
import pytest
from balls import BallWorld, Box
from body_queries import ARGUMENTS
from openrave_rooms import ball, scene
from pyode import load

import ss2sql
from ss2sql.vtables.questions import Questions

QUERIES = int(os.environ.get("SS2SQL_WORLD_QUERIES", "300"))
EACH = 100  # of one scene
BODIES = 12

Change = Callable[[Random], Any]


def check(world: str, capsys: Any, make: Callable[[int], tuple[Any, Change, Any]], needed: int = QUERIES) -> None:
    """Judges scenes until enough queries were asked. `make` gives for a seed the world, how it changes, arguments."""
    asked, seed, elements = 0, 0, Counter[str]()
    while asked < needed:
        source, change, arguments = make(seed)
        report = ss2sql.check_world(source, seed, min(EACH, needed - asked), change, arguments)
        assert report.skipped == []
        asked += report.queries
        elements.update(report.elements)
        seed += 1
    with capsys.disabled():
        print(f"\n{world}: {asked} queries, 0 differences; {dict(elements)} in {seed} scenes")
    assert asked == needed
    assert elements.total() > 0


def test_balls_in_a_box(capsys: Any) -> None:
    def make(seed: int) -> tuple[Any, Change, Any]:
        box = Box.random(seed, 2 * BODIES)
        return BallWorld(box), box.change, {"gaps": [(min(box.balls),)], "near": [(0.0, 0.0, 0.0), (1, 1, 0, 4.0)]}

    check("balls", capsys, make)


def test_chaos_in_pybullet(capsys: Any) -> None:
    pytest.importorskip("pybullet")
    from ss2sql.scenes import chaos
    from ss2sql.scenes.bullet import connect

    client: Any = connect()  # one for all: each takes 29 MB that never come back
    rays = [([0.0, 0.0, 9.0], [0.0, 0.0, -9.0]), ([[3.0, 0.0, 1.0]], [[-3.0, 0.0, 1.0]])]

    def make(seed: int) -> tuple[Any, Change, Any]:
        world = chaos(seed, BODIES, client)

        def change(dice: Random) -> None:
            world.step(dice.randint(1, 40))
            particles = [body for body in world.names if client.getDynamicsInfo(body, -1)[0] > 0]
            world.explode(dice.choice(particles))
            world.bear()

        return world, change, {**ARGUMENTS, "rays": rays}

    try:
        check("PyBullet", capsys, make)
    finally:
        client.disconnect()


def test_chaos_in_mujoco(capsys: Any) -> None:
    pytest.importorskip("mujoco")
    from ss2sql.scenes.mujoco_chaos import chaos

    def make(seed: int) -> tuple[Any, Change, Any]:
        world = chaos(seed, BODIES)  # nobody is born here, and nobody dies
        return world, lambda dice: world.step(dice.randint(1, 40)), ARGUMENTS

    check("MuJoCo", capsys, make)


def test_chaos_in_ode(capsys: Any) -> None:
    with TemporaryDirectory() as folder:
        if load(Path(folder)) is None:
            pytest.skip("ODE is not installed for this Python: apt-get install python3-pyode")
        from ss2sql.scenes.ode_chaos import chaos

        def make(seed: int) -> tuple[Any, Change, Any]:
            world = chaos(seed, BODIES)

            def change(dice: Random) -> None:
                world.step(dice.randint(1, 40))
                world.remove(dice.choice(world.particles))
                if len(world.particles) < BODIES:
                    world.explode(dice.choice(world.particles))

            return world, change, ARGUMENTS

        check("ODE", capsys, make)


def test_bodies_in_openrave(capsys: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "openravepy", fake_openravepy)

    def make(seed: int) -> tuple[Any, Change, Any]:
        environment = scene(seed, BODIES)

        def change(dice: Random) -> None:
            environment.Remove(dice.choice(environment.bodies))
            environment.Add(ball("new", 0.3, 77, [dice.uniform(-4, 4) for _ in range(3)]))
            dice.choice(environment.bodies).SetTransform([1, 0, 0, 0, *(dice.uniform(-4, 4) for _ in range(3))])

        return environment, change, ARGUMENTS

    check("OpenRAVE", capsys, make)


def test_the_queries_have_what_they_promise(monkeypatch: pytest.MonkeyPatch) -> None:
    """ORs, filters, and every join in both orders."""
    asked: list[str] = []
    plain = Questions.script

    def noted(self: Questions) -> Any:
        found = plain(self)
        asked.append(found.text)
        return found

    monkeypatch.setattr(Questions, "script", noted)
    ss2sql.check_world(BallWorld(Box.random(1, 5)), queries=200, arguments={"gaps": []})
    froms = [text.split(" FROM ")[1].split(" AS rows")[0].split(" WHERE ")[0].split(" ORDER ")[0] for text in asked]
    joins = [names.split(" LIMIT ")[0].split(", ") for names in froms if ", " in names]
    assert len(joins) > 50
    unpaired = Counter((one, other) for one, other in joins) - Counter((other, one) for one, other in joins)
    assert unpaired.total() <= 1  # that of the last query
    for word in (" OR ", " AND ", "NOT (", " IN [", " NOT IN [", " ORDER BY ", " LIMIT ", "b = numbers", "b = world"):
        assert sum(word in text for text in asked) > 5, word
