"""What mutation testing changes, and that what it leaves out is still there."""

from __future__ import annotations

import ast
import gc
from collections.abc import Iterator
from pathlib import Path

import mutants
import mutants_made
import pytest
import reached
from mutants_made import Mutant

import ss2sql.lowering.sqlite_forms

TEXT = '''
def f(a, b):
    """Of two numbers."""
    if a < 1 and not b:
        return a + 2
    assert b
    return g(a, b, c=3)


class C:
    def m(self, x: int = 7) -> str:
        match x:
            case 1 if self:
                self.n = [y for y in x if y]
            case _:
                pass
        return "s" if x else None
'''
CHANGES = [
    *("f: if a < 1 and (not b): -> if not (a < 1 and (not b)):", "f: a < 1 and (not b) -> a < 1 or not b"),
    *("f: a < 1 and (not b) -> not b", "f: a < 1 and (not b) -> a < 1", "f: a < 1 -> a <= 1", "f: 1 -> 2"),
    *("f: not b -> b", "f: return a + 2 -> return None", "f: a + 2 -> a - 2", "f: 2 -> 3"),
    *("f: return g(a, b, c=3) -> return None", "f: g(a, b, c=3) -> g(a, b)", "f: g(a, b, c=3) -> g(b, a, c=3)"),
    *("f: 3 -> 4", "C.m: case 1 if self: -> case 1:", "C.m: case 1 if self: -> nothing", "C.m: case _: -> nothing"),
    *("C.m: 1 -> 2", "C.m: self.n = [y for y in x if y] -> nothing", "C.m: [y for y in x if y] -> [y for y in x]"),
    *("C.m: return 's' if x else None -> return None", "C.m: 's' if x else None -> 's'", "C.m: 's' -> 'XXs'"),
    "C.m: 's' if x else None -> None",
]


@pytest.fixture(scope="module")
def every() -> Iterator[list[Mutant]]:
    """All of them: a million nodes of syntax trees, which would set off many collections among 8,000 tests."""
    gc.disable()
    yield mutants.every()
    gc.enable()


def test_changes_of_a_module(tmp_path: Path) -> None:
    path = tmp_path / "m.py"
    path.write_text(TEXT, encoding="utf-8")
    found = [mutant.name.removeprefix("m.py ") for mutant in mutants_made.mutants(path, "m.py")]
    assert sorted(found) == sorted(CHANGES)


def test_a_changed_function_computes_something_else(tmp_path: Path) -> None:
    path = tmp_path / "m.py"
    path.write_text("def f(a):\n    return a + 2\n", encoding="utf-8")
    given: dict[str, object] = {}
    exec(compile(path.read_text(encoding="utf-8"), str(path), "exec"), given)
    function = given["f"]
    answers = []
    for mutant in mutants_made.mutants(path, "m.py"):
        site, code = mutants_made.mutated(path, mutant)
        assert (site.function, site.line) == ("f", 1)
        function.__code__ = code  # type: ignore[attr-defined]
        answers.append(function(5))  # type: ignore[operator]
    assert answers == [None, 3, 8]


@pytest.mark.slow  # 4 s alone, minutes in a process that has run all other tests
def test_every_mutant_has_a_name_of_its_own(every: list[Mutant]) -> None:
    assert len({mutant.name for mutant in every}) == len(every)


def test_functions_are_found_by_their_place() -> None:
    path = Path(ss2sql.lowering.sqlite_forms.__file__)
    places = mutants.functions()
    for function in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(function, ast.FunctionDef):
            first = min([function.lineno, *(one.lineno for one in function.decorator_list)])
            assert places[str(path), mutants_made.Site(function.name, first)]


def test_lines_are_followed_through_edits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reached, "PACKAGE", tmp_path)
    monkeypatch.setattr(reached, "FOLDER", tmp_path)
    (tmp_path / "texts").mkdir()
    then, now = "a\nb\nc\nd\n", "new\na\nb\nchanged\nd\n"
    (tmp_path / "texts" / reached.digest(then)).write_text(then, encoding="utf-8")
    (tmp_path / "m.py").write_text(now, encoding="utf-8")
    assert reached.lines_then("m.py", reached.digest(then)) == [1, 1, 2, 2, 4]
    assert reached.lines_then("m.py", reached.digest(now)) == [1, 2, 3, 4, 5]


def test_files_of_tests_that_read_scripts_are_learned_anew_when_these_change(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reached, "FOLDER", tmp_path)
    files = [str(reached.TESTS_FOLDER / name) for name in ("test_sheets.py", "test_triggers.py")]
    assert reached.written_off(files) == files
    assert reached.stale(files) == []
    monkeypatch.setattr(reached, "read_cases", lambda: "another script")
    assert reached.stale(files) == files[:1]


@pytest.mark.slow  # 4 s alone, minutes in a process that has run all other tests
def test_justified_mutants_exist_and_say_why(every: list[Mutant]) -> None:
    names = {mutant.name for mutant in every}
    for name, why in mutants.justified().items():
        assert name in names, "the code has changed: look at the mutant again"
        assert why.endswith(".")
