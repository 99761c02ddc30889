"""Bodies that are called by their names, also in a function that has the name of a built-in one."""

from __future__ import annotations

import pytest

import ss2sql

pytest.importorskip("pybullet")

from sessions import ENGINES

from ss2sql.scenes import hall
from ss2sql.scenes.scene import Scene


@pytest.fixture(scope="module")
def scene() -> Scene:
    return hall()


@pytest.mark.parametrize("engine", ENGINES)
def test_distance_from_a_body_by_its_name(scene: Scene, engine: str, ss: ss2sql.Session) -> None:
    ss.attach("space", scene)
    x, y, z = ss.run("SELECT pos FROM space WHERE name == 'YouBot' AS value").value
    away = [x + 3, y + 4, z]
    assert ss.run("distance('YouBot', away);", engine=engine, away=away).value == pytest.approx(5)
    assert ss.run("distance(away, robot);", engine=engine, away=away, robot="YouBot").value == pytest.approx(5)
    assert ss.run("SELECT name FROM space WHERE distance(this, 'YouBot') == 0 AS list", engine=engine).value == [
        "YouBot"
    ]
    assert ss.run("distance([0, 0], [3, 4]);", engine=engine).value == 5.0
    with pytest.raises(ss2sql.ExecutionError, match="Youbot"):
        ss.run("distance('Youbot', away);", engine=engine, away=away)
