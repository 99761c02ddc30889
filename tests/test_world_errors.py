"""Bad input to worlds: a clear error with code, place and cure, and the session goes on."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from golden import each_row

import ss2sql

pytest.importorskip("pybullet")

from bullet_rooms import ball
from sessions import answers, wrong_scripts

from ss2sql import scenes
from ss2sql.vtables.pybullet.client import start_bullet


@pytest.fixture
def client(client: Any) -> Any:
    """Four balls that fall, 1, 2, 3 and 4 m above the floor."""
    client.setGravity(0, 0, -9.81)
    for number in range(4):
        ball(client, 0.1, (number, 0, number + 1), mass=number + 1)
    return client


@pytest.fixture
def ss(ss: ss2sql.Session, client: Any) -> ss2sql.Session:
    ss.attach("space", client)
    return ss


@pytest.fixture(scope="module")
def cut_off() -> Iterator[ss2sql.Session]:
    """A session whose `space` is disconnected, with a body of it in `kept`."""
    gone = start_bullet()
    ball(gone)
    with ss2sql.connect() as session:
        session.attach("space", gone)
        session.run("kept = SELECT this FROM space AS list;")
        gone.disconnect()
        yield session


def refused(ss: ss2sql.Session, script: str, engine: Any) -> ss2sql.Error:
    """The error of a script, which names a place in it and a cure. Afterwards the session goes on, on both engines."""
    with pytest.raises(ss2sql.Error) as caught:
        ss.run(script, engine=engine)
    error = caught.value
    assert error.span is not None
    assert error.span.source.text == script
    assert error.span.end > error.span.start
    assert error.hints
    assert f"error[{error.code}]: {error.message}" in str(error)
    assert answers(ss, "SELECT this + 1 FROM [1, 2] AS list;") == [2, 3]
    return error


def place(error: ss2sql.Error) -> str:
    assert error.span is not None
    return error.span.source.text[error.span.start : error.span.end]


# --- what has gone -------------------------------------------------------------------------------------


@each_row("worlds/disconnected", "script", "told")
def test_a_disconnected_client(cut_off: ss2sql.Session, engine: Any, script: str, told: str) -> None:
    where = ast.literal_eval(told)
    error = refused(cut_off, script, engine)
    assert (error.code, error.message) == ("X011", "the PyBullet client is disconnected")
    assert error.hints == ("connect anew, and attach the new client",)
    assert where in place(error)


@pytest.mark.parametrize(
    ("script", "says"),
    [
        ("SELECT mass(this) FROM kept;", "bodies[2] no longer exists"),
        *[(f"SELECT {column} FROM kept;", "bodies[2] no longer exists")
          for column in ("mass", "name", "aabb", "velocity", "colour", "type", "volume", "isSensor", "force", "rot")],
        ("SELECT this.x FROM kept WHERE this.x > 0;", "bodies[2] no longer exists"),
        ("space.position('body_2');", "no body is called 'body_2'"),
        *[(script, "there is no body 2") for script in (
            "distance(kept[0], kept[2]);", "space.collision(kept[2], [0, 0]);", "space.move(2, [0, 0]);",
            "space.checkCollision(2);", "SELECT id FROM space.near(kept[2], 1);", "SELECT idA FROM space.contacts(2);",
            "SELECT c.idA FROM k = kept, c = space.closest(k.this, None, 1);")],
    ],
)  # fmt: skip
def test_a_removed_body(client: Any, ss: ss2sql.Session, engine: Any, script: str, says: str) -> None:
    ss.run("kept = SELECT this FROM space AS list;")
    client.removeBody(2)
    error = refused(ss, script, engine)
    assert error.code == "X011"
    assert says in error.message
    assert "anew" in error.hints[0] or "did you mean 'body_" in error.hints[0]
    assert answers(ss, "SELECT id, mass FROM space AS rows;") == [(0, 1.0), (1, 2.0), (3, 4.0)]
    assert answers(ss, "mass(kept[3]);") == 4.0
    assert answers(ss, "SELECT id FROM space WHERE id IN [2, 99999999999] OR id == 99999999999 AS list;") == []


# --- a world that moves while it is read ---------------------------------------------------------------


def test_steps_within_a_query_are_not_seen_by_it(client: Any, ss: ss2sql.Session, engine: Any) -> None:
    """A query sees the world as it was when it began, whatever its functions do to it; the next one sees the steps."""

    engine = "native" if engine == "native" else "auto"

    @ss.function
    def step() -> int:
        client.stepSimulation()
        return 1

    def heights() -> list[float]:
        return [client.getBasePositionAndOrientation(body)[0][2] for body in range(4)]

    before = heights()
    script = "SELECT z, step(), z, z(this), velocity[2] FROM space WHERE step() > 0 AND z > 1.5 AS rows;"
    assert ss.run(script, engine=engine).value == [(z, 1, z, z, 0.0) for z in before[1:]]
    after = heights()
    assert all(low < high for low, high in zip(after, before, strict=True))
    assert answers(ss, "SELECT z FROM space AS list;") == after
    script = "SELECT a.z, b.z, step() FROM a = space, b = space WHERE b.id == a.id AS rows;"
    assert ss.run(script, engine=engine).value == [(z, z, 1) for z in after]


def test_bodies_removed_within_a_query(client: Any, ss: ss2sql.Session, engine: Any) -> None:
    @ss.function(volatility="stable")
    def remove(body: int) -> int:
        client.removeBody(body)
        return body

    error = refused(ss, "SELECT remove(3 - id), distance(this, [0, 0, 0]) FROM space;", engine)
    assert (error.code, error.message) == ("X011", "there is no body 2")  # the second row has removed it
    rows = ss.run("SELECT mass, remove(id), mass FROM space AS rows;", engine=engine).value
    assert rows == [(1.0, 0, 1.0)]
    assert answers(ss, "SELECT id FROM space AS list;") == []


@pytest.mark.parametrize(("code", "words", "marked"), [*wrong_scripts("worlds")])
def test_wrong_names(ss: ss2sql.Session, engine: Any, code: str, words: list[str], marked: str) -> None:
    before, wrong, behind = re.split("[«»]", marked)
    error = refused(ss, before + wrong + behind, engine)
    assert (error.code, place(error)) == (code, wrong)
    assert error.span is not None
    assert error.span.start == len(before)
    assert words[0] in error.message
    assert words[1] in " ".join(error.hints)
    assert answers(ss, "SELECT id FROM space.near([0, 0, 0], 2) AS list;") == [0]


@pytest.mark.parametrize(("name", "source"), [("s", "s = space"), ("space", "space")])
def test_tables_beside_the_world(ss: ss2sql.Session, engine: Any, name: str, source: str) -> None:
    script = (
        f"SELECT {name}.id, len(SELECT this FROM space.joints WHERE body == {name}.id AS list) FROM {source} AS rows;"
    )
    assert ss.run(script, engine=engine).value == [(number, 0) for number in range(4)]


# --- scenes and their pictures -------------------------------------------------------------------------


@pytest.mark.parametrize("path", ["not there/a.png", "", "a file/a.png", "a\0.png"])
def test_a_picture_that_cannot_be_written(client: Any, ss: ss2sql.Session, tmp_path: Path, path: str) -> None:
    (tmp_path / "a file").write_text("")
    with pytest.raises(ss2sql.SessionError, match=r"S002.*cannot be written: ") as caught:
        scenes.render(client, tmp_path / path, size=(16, 12))
    assert caught.value.hints == ("name a file in a folder that exists and may be written to",)
    assert [file.name for file in tmp_path.iterdir()] == ["a file"]
    assert answers(ss, "SELECT id FROM space AS list;") == [0, 1, 2, 3]
    scenes.render(client, tmp_path / "a.png", size=(16, 12))
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")


def test_a_scene_that_was_closed(ss: ss2sql.Session, engine: Any) -> None:
    scene = scenes.chaos(seed=1, bodies=1)
    ss.attach("space", scene)
    scene.close()
    scene.close()
    error = refused(ss, "SELECT id FROM space;", engine)
    assert (error.code, place(error)) == ("X011", "space")
    for action in (scene.step, lambda: scenes.render(scene, None)):
        with pytest.raises(ss2sql.SessionError, match="the scene is closed"):
            action()
