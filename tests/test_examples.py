"""The examples run, quickly, and tell what they promise; golden cases have what such scripts find."""

import itertools
import os
import re
import subprocess
import sys
from typing import Any

import pytest
from example_pages import EXAMPLES, play

import ss2sql

SIMULATED = ("chaos", "facts", "navigation", "sensors")
NAMES = tuple(sorted(("converters", "errors", "hanoi", "hierarchy", "map_colouring", "robot", *SIMULATED)))
SLOWEST = 60  # seconds of processor time for one example; nearly all of it is the map in its nested forms


def test_every_example_is_listed_and_has_a_test():
    folders = sorted(path.name for path in EXAMPLES.iterdir() if (path / "run.py").exists())
    assert tuple(folders) == NAMES
    listed = (EXAMPLES / "README.md").read_text("utf-8")
    assert all(f"python examples/{name}/run.py" in listed for name in NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_shows_its_scripts_with_sql_and_rows(name):
    if name in SIMULATED:
        pytest.importorskip("pybullet")
    example = play(name)
    scripts = sorted(path.stem for path in (EXAMPLES / name).glob("*.ss"))
    assert sorted(shown.name for shown in example.page.shown) == scripts
    assert example.text.count("\nSQL\n") == example.text.count("\nrows\n") == len(scripts)
    assert example.seconds < SLOWEST
    for script in (EXAMPLES / name).glob("*.ss"):
        heading, lesson = script.read_text("utf-8").splitlines()[:2]
        assert heading.startswith("# ")
        assert lesson.startswith("# ")


# --- the robot -----------------------------------------------------------------------------------------


def test_robot_rings_and_is_drawn():
    text = play("robot").text
    assert re.search(r"the bell rang\s+[1-9]\d*\s+times", text)
    picture = "\n".join(line for line in text.splitlines() if line.count("█") >= 2)
    assert [picture.count(sign) for sign in "STo"] == [1, 1, len(play("robot").value("paths")[0]) - 1]


# --- mistakes ------------------------------------------------------------------------------------------


def test_every_mistake_names_line_column_reason_and_cure():
    example = play("errors")
    messages = re.split(r"^error$", example.text, flags=re.MULTILINE)[1:]
    assert len(messages) == len(example.module["TOUR"])
    for message in messages:
        assert re.search(r"error\[[A-Z]\d{3}\]: \S+", message), message
        assert re.search(r"--> <script>:\d+:\d+", message), message
        assert "^" in message
        assert "= help: " in message, message
    assert "no error" not in example.text
    assert "Ada" in example.text.split("The session works on")[1]


# --- converters ----------------------------------------------------------------------------------------


def cheapest(library: dict[str, Any], price: str | None) -> tuple[dict[str, float], dict[str, list[str]]]:
    """The least sum of prices from csv to every format, and the formats on the way; without prices each costs 1."""
    networkx = pytest.importorskip("networkx")
    graph = networkx.MultiDiGraph()
    for entry in library.values():
        graph.add_edge(entry.takes, entry.gives, price=entry.price)
    return networkx.single_source_dijkstra(graph, "csv", weight=price)  # type: ignore[no-any-return]


def test_converters_are_chained_by_their_number_and_by_their_price():
    example = play("converters")
    library = example.module["LIBRARY"]
    (fewest,), (best,) = example.result("1_fewest").paths, example.result("2_cheapest").paths
    for chain in (fewest, best):
        ends = [(library[name].takes, library[name].gives) for name, _ in chain]
        assert (ends[0][0], ends[-1][1]) == ("csv", "numpy")
        assert all(left[1] == right[0] for left, right in itertools.pairwise(ends))
        assert [price for _, price in chain] == [library[name].price for name, _ in chain]
    assert len(fewest) == cheapest(library, None)[0]["numpy"] < len(best)
    assert sum(price for _, price in best) == pytest.approx(cheapest(library, "price")[0]["numpy"])
    values = [data for _, data in example.module["run_chain"]([name for name, _ in best], example.module["TEXT"])]
    assert values[-1].tolist() == [[0.5, 1.25, 3.0], [2.0, 0.75, 1.5]]


# --- sensors --------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_alarm_tells_every_change_while_the_robot_drives():
    pytest.importorskip("pybullet")
    from ss2sql.vtables.pybullet import PyBulletWorld

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


# --- the demonstration ---------------------------------------------------------------------------------


def test_demo_runs_to_its_summary():
    environment = {**os.environ, "PYTHONIOENCODING": "utf-8"}
    done = subprocess.run(
        [sys.executable, str(EXAMPLES / "demo.py"), "hanoi", "hierarchy", "robot"],
        capture_output=True, text=True, encoding="utf-8", check=True, timeout=300, env=environment,
    )  # fmt: skip
    summary = done.stdout.split("Summary")[1]
    for answer in ("285 paths, shortest 15 steps", "24 paths", "1000 paths, shortest 10 steps"):
        assert answer in summary
    assert done.stderr == ""
