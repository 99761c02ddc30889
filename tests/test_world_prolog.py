"""AS prolog: facts that a small reader understands, and SWI-Prolog where it is installed."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path
from shutil import which
from typing import Any

import pytest

pytest.importorskip("pybullet")

from little_scenes import GREY, ask
from little_scenes import fixture_scene as fixture_scene

import ss2sql
from ss2sql.scenes.scene import Scene
from ss2sql.scenes.solids import Box, Sphere

# --- prolog --------------------------------------------------------------------------------------------

TERM = re.compile(r"\s*('(?:[^'\\]|\\.)*'|[a-z]\w*|-?\d+(?:\.\d+(?:e[+-]?\d+)?)?|[\[\](),-])")


class Reader:
    """Reads the facts that are written here, and nothing else of Prolog."""

    def __init__(self, text: str) -> None:
        self.tokens = TERM.findall(text)
        assert "".join(self.tokens) == re.sub(r"\s(?=(?:[^']*'[^']*')*[^']*$)", "", text), text

    def next(self) -> str:
        return self.tokens.pop(0)

    def term(self) -> Any:
        token = self.next()
        if token == "[":
            return self.items("]")
        if token[0] in "-0123456789":
            return float(token) if "." in token else int(token)
        name = token[1:-1].replace("\\'", "'").replace("\\n", "\n").replace("\\\\", "\\") if token[0] == "'" else token
        if self.tokens[:1] == ["("]:
            self.next()
            return (name, *self.items(")"))
        return name

    def items(self, end: str) -> list[Any]:
        found = []
        while self.tokens[0] != end:
            found.append(self.term())
            if self.tokens[0] == ",":
                self.next()
        self.next()
        return found


def facts_of(text: str) -> list[Any]:
    return [Reader(line.removesuffix(".")).term() for line in text.splitlines() if not line.startswith(":-")]


needs_prolog = pytest.mark.skipif(which("swipl") is None, reason="SWI-Prolog is not installed")


def prolog(folder: Path, text: str, goal: str) -> list[str]:
    """What SWI-Prolog prints of the solutions of a goal, one a line. It must load the facts without a word."""
    (folder / "facts.pl").write_text(text, encoding="utf-8")
    ask = f"forall(({goal}), (print(X), nl))"
    done = subprocess.run(
        ["swipl", "-q", "-g", ask, "-t", "halt", str(folder / "facts.pl")],
        capture_output=True, text=True, timeout=60, check=True, encoding="utf-8",
    )  # fmt: skip
    assert done.stderr == ""
    return done.stdout.splitlines()


@pytest.fixture
def yard(scene: Scene) -> Scene:
    scene.add("sphere_1", Sphere(0.5), (0.0, 0.0, 0.0), GREY, 3.25)
    scene.add("YouBot", Box(1, 1, 1), (3.0, 4.0, 0.0), GREY, 2.0)
    scene.add("it's 1\\2", Box(1, 1, 1), (9.0, 0.0, 0.0), GREY)
    return scene


FACTS = "SELECT mass, isSphere, linearVelocity(this, 2), to(mass * 2, twice), id FROM space AS prolog;"


def test_every_call_becomes_a_fact(yard: Scene, engine: Any) -> None:
    text = ask(yard, FACTS, engine)
    names = ["sphere_1", "YouBot", "it's 1\\2"]
    assert facts_of(text) == [
        *[("mass", name, mass) for name, mass in zip(names, (3.25, 2.0, 0.0), strict=True)],
        ("isSphere", "sphere_1"),
        *[("linearVelocity", name, 2, 0.0) for name in names],
        *[("twice", name, mass) for name, mass in zip(names, (6.5, 4.0, 0.0), strict=True)],
        *[("id", name, number) for name, number in zip(names, (0, 1, 2), strict=True)],
    ]


def test_facts_are_quoted_where_it_is_needed(yard: Scene, engine: Any) -> None:
    text = ask(yard, "SELECT isBox FROM space AS prolog;", engine)
    assert text == "isBox('YouBot').\nisBox('it\\'s 1\\\\2').\n"


def test_facts_of_several_elements(yard: Scene, engine: Any) -> None:
    text = ask(
        yard,
        "SELECT distance(a.this, b.this) FROM a = space, b = space WHERE a.id < 1 AND b.id == 1 AS prolog;",
        engine,
    )
    assert text == "distance(sphere_1, 'YouBot', 5.0).\n"
    text = ask(yard, "SELECT a.mass, b.mass FROM a = space, b = space WHERE a.id == 0 AS prolog;", engine)
    assert text == "mass(sphere_1, 3.25).\nmass('YouBot', 2.0).\nmass('it\\'s 1\\\\2', 0.0).\n"  # each fact once


def test_facts_of_values(engine: Any) -> None:
    with ss2sql.connect() as ss:
        ss.function("half", lambda x: x / 2)
        ss.function("same", lambda x, y: x == y)

        def facts(script: str) -> Any:
            return ss.run(script, engine=engine).value

        assert (
            facts("SELECT half(this), this FROM [1, 3] AS prolog;")
            == "half(1, 0.5).\nhalf(3, 1.5).\nthis(1).\nthis(3).\n"
        )
        assert (
            facts("SELECT same(a.this, b.this) FROM a = [1, 2], b = [1, 2] AS prolog;") == "same(1, 1).\nsame(2, 2).\n"
        )
        assert (
            facts("SELECT to(this, word) FROM ['a b', 'x', 'X', ''] AS prolog;")
            == "word('a b').\nword(x).\nword('X').\nword('').\n"
        )
        assert (
            facts("SELECT to(1e-7, small), to(-1e30, large) FROM [0] AS prolog;")
            == "small(0, 1.0e-07).\nlarge(0, -1.0e+30).\n"
        )
        assert facts("SELECT to(this, l) FROM [[1, ['a', None]]] AS prolog;") == "l([1, [a, none]]).\n"
        assert facts("SELECT half(this) FROM [] AS prolog;") == ""
        assert facts("SELECT to(None, gone), to(False, wrong), to(True, right) FROM [1] AS prolog;") == "right(1).\n"


def test_bodies_of_one_name_are_told_apart(scene: Scene, engine: Any) -> None:
    for x in (0.0, 5.0):
        scene.add("cube", Box(1, 1, 1), (x, 0.0, 0.0), GREY)
    assert ask(scene, "SELECT isBox FROM space AS prolog;", engine) == "isBox(cube_0).\nisBox(cube_1).\n"


def test_arguments_that_change_something_are_not_evaluated_twice(engine: Any) -> None:
    calls = []
    with ss2sql.connect() as ss:
        ss.function("draw", lambda: calls.append(1) or len(calls), volatility="volatile")
        ss.function("half", lambda x: x / 2)
        text = ss.run("SELECT half(draw()) FROM [7, 8] AS prolog;", engine=engine).value
    assert text == "half(7, 0.5).\nhalf(8, 1.0).\n"
    assert len(calls) == 2


@needs_prolog
def test_prolog_loads_the_facts(yard: Scene, tmp_path: Path) -> None:
    text = ask(yard, FACTS)
    assert prolog(tmp_path, text, "mass(B, M), M > 1, X = B-M") == ["sphere_1-3.25", "'YouBot'-2.0"]
    assert prolog(tmp_path, text, "isSphere(X)") == ["sphere_1"]
    assert prolog(tmp_path, text, "twice(_, X)") == ["6.5", "4.0", "0.0"]
    assert prolog(tmp_path, text, "id(X, 2)") == ["'it\\'s 1\\\\2'"]


@needs_prolog
def test_prolog_loads_any_value(tmp_path: Path) -> None:
    values = [
        "",
        "a",
        "A b",
        "it's",
        "\\",
        "\n\t",
        "ü€",
        "\x07",
        "[]",
        0,
        -3,
        1e-7,
        -1e300,
        5e-324,
        2**62,
        [1, [2, []]],
        {"k": -1},
    ]
    with ss2sql.connect() as ss:
        text = ss.run("SELECT to(this[0], v) FROM values AS prolog;", values=[[value] for value in values]).value
    (tmp_path / "facts.pl").write_text(text, encoding="utf-8")
    done = subprocess.run(
        ["swipl", "-q", "-g", "forall(v(_, X), (writeq(X), nl))", "-t", "halt", str(tmp_path / "facts.pl")],
        capture_output=True, text=True, timeout=60, check=True, encoding="utf-8",
    )  # fmt: skip
    assert done.stderr == ""
    assert len(done.stdout.splitlines()) == len(values)


@needs_prolog
@pytest.mark.parametrize("name", ["length", "sort", "atom", "is", "write", "name", "call", "number", "var", "op"])
def test_facts_may_have_the_names_of_standard_predicates(tmp_path: Path, name: str) -> None:
    with ss2sql.connect() as ss:
        text = ss.run(f"SELECT to(this * 2, {name}), to(True, {name}) FROM [4] AS prolog;").value
    assert prolog(tmp_path, text, f"user:clause({name}(4, X), true)") == ["8"]
