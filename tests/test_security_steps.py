"""One step of a run may make many values: what they take together is bounded, too, see runtime/sizes.py."""

from __future__ import annotations

import gc
import weakref
from typing import Any

import pytest
from test_security_sizes import ENGINES, refused

import ss2sql
from ss2sql.runtime import executing, run, shaping


def queries_in_each_other(depth: int) -> str:
    """A value of 3^depth rows, which takes one row of the outermost query."""
    inner = "0"
    for _ in range(depth):
        inner = f"(SELECT {inner} FROM xs)"
    return f"xs = [1, 2, 3]; SELECT 1 FROM [{inner}] AS list;"


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("depth", [8, 9, 12])
def test_one_step_makes_values_that_are_too_large(engine: str, depth: int) -> None:
    """The statement goes on after the innermost of them; what happens then must not be what the user hears of."""
    with ss2sql.connect(max_size=300_000) as session:
        assert refused(session, queries_in_each_other(depth), engine=engine) == "X014"
        assert session.run("SELECT 1 FROM [1] AS list;", engine=engine).value == [1]  # type: ignore[arg-type]


@pytest.mark.parametrize("engine", ENGINES)
def test_one_step_that_makes_many_values_is_broken_off(engine: str) -> None:
    """It would be one of 3^20 rows. Natively they share their values, so that it is made at once, and then measured."""
    with ss2sql.connect() as session:
        code = "X014" if engine == "native" else "T001"
        assert refused(session, queries_in_each_other(20), engine=engine, timeout=0.2) == code


def test_values_of_inner_queries_are_not_copied(monkeypatch: pytest.MonkeyPatch) -> None:
    copied: list[int] = []
    monkeypatch.setattr(shaping, "fresh_rows", lambda rows: copied.append(len(rows)) or rows)  # type: ignore[func-returns-value]
    with ss2sql.connect() as session:
        for form in ("list", "dict", "rows"):
            inner = f"SELECT (SELECT [this] FROM [1, 2] AS {form}) FROM [1, 2, 3] AS {form}"
            session.run(f"x = ({inner}); y = [{inner}]; len({inner})", engine="native")
        assert copied == []
        session.run("SELECT (SELECT [this] FROM [1, 2]) FROM [1, 2, 3]", engine="native")
        assert copied == [3]


class Watched(run.Run):
    """A run that a weak reference can tell of."""

    __slots__ = ("__weakref__",)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_run_is_free_at_its_end(monkeypatch: pytest.MonkeyPatch, engine: str) -> None:
    """With all that it holds, and without the garbage collector, which would come when more has piled up."""
    made: list[weakref.ref[Watched]] = []

    def noted(*arguments: Any, **options: Any) -> Watched:
        one = Watched(*arguments, **options)
        made.append(weakref.ref(one))
        return one

    monkeypatch.setattr(executing, "Run", noted)
    with ss2sql.connect() as session:
        gc.disable()
        try:
            session.run("SELECT this FROM range(1000) AS list", engine=engine)  # type: ignore[arg-type]
            assert [one() for one in made] == [None]
        finally:
            gc.enable()
