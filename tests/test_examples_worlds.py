"""The examples over simulations: what they find is what plain calls of the simulator give."""

import itertools
import re
import shutil
from collections import Counter
from math import hypot
from typing import Any

import pytest

pytest.importorskip("pybullet")
from bullet_rooms import kind_of, mass_of
from example_pages import play
from prolog_facts import facts

import ss2sql
from ss2sql.vtables.pybullet import PyBulletWorld


def is_png(file: Any) -> bool:
    return file.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n" and file.stat().st_size > 20_000


# --- the chaos -----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def box() -> Any:
    """The chaos as the example first asks about it."""
    with ss2sql.scenes.chaos(seed=18, bodies=150) as world:
        world.step(play("chaos").module["STEPS"])
        yield world


def test_chaos_finds_heavy_spheres_and_the_heaviest(box):
    example = play("chaos")
    spheres = {b: mass_of(box.client, b) for b in box.names if kind_of(box.client, b) == "sphere"}
    heavy = {body: weight for body, weight in sorted(spheres.items()) if weight > 50}
    places = [list(box.client.getBasePositionAndOrientation(body)[0]) for body in heavy]
    assert list(example.result("1_heavy")) == list(zip(heavy.values(), places, strict=True))
    heaviest = max(spheres, key=lambda body: spheres[body])
    assert list(example.result("2_heaviest")) == [(heaviest, box.names[heaviest], spheres[heaviest])]
    assert is_png(example.picture("heaviest.png"))


def test_chaos_gives_planes_with_what_is_in_the_box(box):
    example = play("chaos")
    masses, velocities = example.value("3_planes")
    assert masses.shape == velocities.shape == (100, 100)
    total = sum(mass_of(box.client, body) for body in box.names)
    assert 0.8 * total < masses.sum() <= total * (1 + 1e-9)  # the blur loses what is near the walls
    assert masses.min() >= 0 > velocities.min()
    assert re.search(r"^  [ .:\-=+*#%@]{50}   [ .:\-=+*#%@]*@[ .:\-=+*#%@]*$", example.text, re.MULTILINE)


def test_chaos_counts_kinds_before_and_after(box):
    example = play("chaos")
    moving = {body: mass_of(box.client, body) for body in box.names if mass_of(box.client, body) > 0}
    kinds = Counter(kind_of(box.client, body) for body in moving)
    rows = {row[0]: row[1:] for row in example.result("4_kinds")}
    assert {name: row[0] for name, row in rows.items()} == kinds
    for name, (_, weight, fastest) in rows.items():
        alike = [body for body in moving if kind_of(box.client, body) == name]
        assert weight == round(sum(moving[body] for body in alike))
        assert fastest == round(max(hypot(*box.client.getBaseVelocity(body)[0]) for body in alike), 1)
    assert re.search(r"The same after \d+ steps, [1-9]\d* births and \d+ deaths", example.text)


# --- sensors -------------------------------------------------------------------------------------------


def test_sensors_leave_the_free_cells_that_none_sees():
    example = play("sensors")
    seen, occupied = example.value("1_coverage"), example.value("2_floor")
    expected = [
        ((column + 0.5) / 2, (row + 0.5) / 2)
        for row, column in itertools.product(range(24), range(32))
        if seen[row, column] == 0 and not occupied[row, column]
    ]
    assert list(example.result("3_unseen")) == expected
    assert f"{len(expected)} of 768 cells" in example.text
    assert is_png(example.picture("unseen.png"))
    rows = [line.split() for line in example.text.splitlines() if re.fullmatch(r"\s*([.\d] ){32}\s*", line)]
    assert rows == [
        ["." if cell == 0 else str(int(cell)) for cell in row] for grid in (seen, occupied) for row in grid[::-1]
    ]


def test_the_alarm_tells_every_change_while_the_robot_drives():
    example = play("sensors")
    log = []
    with ss2sql.scenes.hall(seed=0) as hall:
        space = PyBulletWorld(hall)

        def seeing() -> list[str]:
            return [hall.names[sensor] for sensor in sorted(hall.sensors) if space.isSensing(sensor, "YouBot")]

        before = seeing()
        assert list(example.result("4_alarm")) == [(name,) for name in before]
        for x, y in example.module["spots"]():
            space.move("YouBot", [x, y])
            hall.step(24)
            if seeing() != before:
                before = seeing()
                log.append((f"{x:.1f}", f"{y:.1f}", ", ".join(before) or "nobody"))
    assert log
    assert re.findall(r" s  at \((.*), (.*)\)  (\S.*?)\s*$", example.text, re.MULTILINE) == log
    assert f"{len(log)} changes" in example.text


# --- facts ---------------------------------------------------------------------------------------------


def test_facts_are_those_of_the_simulation():
    example = play("facts")
    with ss2sql.scenes.hall(seed=0) as hall:
        weights = {name: mass_of(hall.client, body) for body, name in hall.names.items()}
    told = facts(example.value("1_bodies"))
    sensors = {hall.names[sensor] for sensor in hall.sensors}
    assert {fact for fact in told if fact[0].startswith("is")} == {
        *(("isSensor", name) for name in sensors), ("isRobot", "YouBot"),
    }  # fmt: skip
    heavy = {name: weight for name, weight in weights.items() if weight > 0 or name in sensors}
    assert {name: weight for _, name, weight in (fact for fact in told if fact[0] == "mass")} == pytest.approx(heavy)


def test_prolog_draws_the_conclusions_of_the_rules():
    example = play("facts")
    told = [fact for name in ("1_bodies", "2_relations", "3_sensing") for fact in facts(example.value(name))]
    pairs = [fact[1:] for fact in told if fact[0] == "above"]
    watched = {fact[2] for fact in told if fact[0] == "isSensing"}
    light = [
        name for kind, name, *weight in told if kind == "mass" and weight[0] <= 25 and ("isSensor", name) not in told
    ]
    below = {name: [low for high, low in pairs if high == name] for name in light}
    places = {
        name: next(low for low in lows if not any((other, low) in pairs for other in lows))
        for name, lows in below.items()
    }
    answer = [f"{name} is light and stands on {places[name]}" for name in light]
    answer += [f"YouBot fetches {name} from {places[name]}" for name in light if name not in watched]
    assert len(answer) > len(light) > 0
    if shutil.which("swipl") is None:
        assert "SWI-Prolog is not installed here" in example.text
    else:
        shown = example.text.split("and answers:")[1]
        assert [line.strip() for line in shown.strip().splitlines()] == answer
