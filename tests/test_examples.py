"""The examples run, quickly, and what they find is right."""

import itertools
import math
import os
import re
import runpy
import sqlite3
import subprocess
import sys
from contextlib import closing
from typing import Any

import pytest
from example_pages import EXAMPLES, play

SIMULATED = ("chaos", "facts", "navigation", "sensors")  # tested in test_examples_worlds.py
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


# --- Towers of Hanoi -----------------------------------------------------------------------------------

SEVEN = [[0, 2], [0, 1], [2, 1], [0, 2], [1, 0], [1, 2], [0, 2]]


def test_hanoi_gives_the_answers_of_the_paper():
    hanoi = play("hanoi")
    assert hanoi.value("1_nested") == SEVEN
    assert hanoi.value("2_search") == [[{"this": step} for step in SEVEN]]
    assert hanoi.lengths("3_no_cycle") == {7: 1, 8: 4, 9: 16}
    # The goal is entered by two different moves, so that there are two last rows: after seven steps, and after eight.
    assert hanoi.lengths("4_unique") == {7: 1, 8: 1}
    assert [step for step, _ in hanoi.result("4_unique").paths[0]] == SEVEN
    assert hanoi.lengths("5_memorize") == {15: 1, 16: 8, 17: 48, 18: 228}


def test_the_program_of_the_paper_differs_in_its_import_line_only():
    stub = (EXAMPLES / "hanoi" / "stub.py").read_text("utf-8")
    assert re.findall(r"^(?:import|from).*", stub, re.MULTILINE) == ["import ss2sql.compat as SelectScript"]
    assert runpy.run_path(str(EXAMPLES / "hanoi" / "stub.py"))["result"] == [SEVEN]
    assert str([SEVEN]) in play("hanoi").text


# --- map colouring -------------------------------------------------------------------------------------

COLOURS = ("red", "green", "blue", "yellow")
EIGHT = "ab ac ad ae af bc bd bf bg cd cg ch de dh ef eh fg gh".split()  # noqa: SIM905
FIVE = "ab ac ad ae bc bd cd de".split()  # noqa: SIM905


def colourings(countries: str, borders: list[str]) -> list[dict[str, str]]:
    found = []
    for colours in itertools.product(COLOURS, repeat=len(countries)):
        colour = dict(zip(countries, colours, strict=True))
        if all(colour[left] != colour[right] for left, right in borders):
            found.append(colour)
    return found


@pytest.mark.parametrize("name", ["1_inequalities", "2_nested_query", "3_pairs", "4_names"])
def test_eight_countries_have_48_colourings_in_every_form(name):
    rows = play("map_colouring").value(name)
    assert len(rows) == 48
    assert "".join(colour[0] for colour in rows[0].values()) == "rgbygbyr"
    assert rows == colourings("abcdefgh", EIGHT)


def test_five_countries_are_counted_and_logged():
    example = play("map_colouring")
    expected = colourings("abcde", FIVE)
    assert (len(expected), 4**5 - len(expected)) == (48, 976)
    assert example.value("5_counting") == [48, 976]
    assert example.value("6_logging") == expected
    red = [colour for colour in expected if colour["a"] == "red"]
    assert len(red) == 12
    assert example.value("7_logging_some") == red
    for line in ("It printed 1,024 lines", "It printed 12 lines", f"log: 1{' red' * 5}", f"log: 1024{' yellow' * 5}"):
        assert line in example.text


# --- the hierarchy -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def company(tmp_path_factory):
    """The employees as the example makes them, by number."""
    file = tmp_path_factory.mktemp("company") / "company.db"
    play("hierarchy").module["make_company"](file)
    with closing(sqlite3.connect(file)) as connection:
        connection.row_factory = sqlite3.Row
        return {row["id"]: dict(row) for row in connection.execute("SELECT * FROM employees ORDER BY id")}


def reports(company: dict[int, Any], boss: int | None) -> list[int]:
    return [number for number, person in company.items() if person["manager"] == boss]


def test_hierarchy_managers_and_departments(company):
    example = play("hierarchy")
    leading = {person["manager"] for person in company.values()} - {None}
    expected = sorted((company[number]["name"], company[number]["department"]) for number in leading)
    assert list(example.result("1_managers")) == expected
    salaries: dict[str, list[int]] = {}
    for person in company.values():
        salaries.setdefault(person["department"], []).append(person["salary"])
    rows = [(name, len(paid), min(paid), round(sum(paid) / len(paid)), max(paid)) for name, paid in salaries.items()]
    assert list(example.result("5_salaries")) == sorted(rows, key=lambda row: -sum(salaries[row[0]]) / row[1])


def test_hierarchy_whole_tree(company):
    def below(boss: int | None, path: list[tuple[int, str]]) -> list[list[tuple[int, str]]]:
        found = []
        for number in reports(company, boss):
            here = [*path, (number, company[number]["name"])]
            found += [here, *below(number, here)]
        return found

    example = play("hierarchy")
    paths = example.result("2_tree").paths
    assert paths == below(None, [])
    assert len(paths) == len(company) == 24
    assert all("   " * (len(path) - 1) + path[-1][1] in example.text for path in paths)


def test_hierarchy_upwards_and_downwards(company):
    example = play("hierarchy")
    chain, number = [], 24
    while number is not None:
        chain.append((company[number]["name"], company[number]["department"]))
        number = company[number]["manager"]
    assert example.result("3_upwards").paths == [chain]
    near = [[(company[one]["name"], 1)] for one in reports(company, 2)]
    far = [
        [(company[one]["name"], 1), (company[two]["name"], 2)]
        for one in reports(company, 2)
        for two in reports(company, one)
    ]
    assert far
    assert example.result("4_downwards").paths == near + far


# --- the robot -----------------------------------------------------------------------------------------


def test_robot_paths_reach_the_target_around_the_walls():
    networkx = pytest.importorskip("networkx")
    example = play("robot")
    paths = example.value("paths")
    floor = example.module["Floor"]()
    assert (len(paths), example.result("paths").status) == (1000, "maximum")
    assert len({tuple(map(tuple, path)) for path in paths}) == 1000
    lengths = list(map(len, paths))
    assert lengths == sorted(lengths)
    free = [(x, y) for y, row in enumerate(floor.rows) for x, cell in enumerate(row) if cell != "#"]
    beside = [(one, other) for one in free for other in free if 0 < math.dist(one, other) < 1.5]
    start = tuple(map(int, floor.position("YouBot")))
    assert lengths[0] == networkx.shortest_path_length(networkx.Graph(beside), start, (10, 9))
    assert lengths[-1] <= 20
    for path in paths:
        assert path[-1] == [10.0, 9.0]
        assert len(set(map(tuple, path))) == len(path)
        assert all(floor.rows[int(y)][int(x)] != "#" for x, y in path)
        for (x, y), (to_x, to_y) in itertools.pairwise([floor.position("YouBot"), *path]):
            assert max(abs(x - to_x), abs(y - to_y)) == 1


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


def test_converters_reach_every_format_by_the_cheapest_chain():
    example = play("converters")
    prices, ways = cheapest(example.module["LIBRARY"], "price")
    del prices["csv"], ways["csv"]
    chains = example.value("3_all")
    assert {chain[-1]: ["csv", *chain] for chain in chains} == ways
    assert [prices[chain[-1]] for chain in chains] == sorted(prices.values())
    assert all(" > ".join(["csv", *chain]) in example.text for chain in chains)


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
