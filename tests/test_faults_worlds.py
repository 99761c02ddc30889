"""Worlds that raise, give garbage, die, are born, use their session again or close it, at the k-th call of each method.

By default some calls of each method and kind are tried, drawn with a seed; `SS2SQL_FAULTS=all` tries many more of them,
and `SS2SQL_FAULTS=3` those of another seed.
"""

from __future__ import annotations

import os
from random import Random
from typing import Any

import numpy as np
import pytest
from faulty import endured
from faulty_worlds import KINDS, LONG, Mishaps, Patient, Source, cases, judge
from sessions import both

import ss2sql

WANTED = os.environ.get("SS2SQL_FAULTS", "1")
SAMPLE = 2  # kinds of faults for each script and engine; 25 ms each


@both
@pytest.mark.parametrize(("site", "script"), list(cases()))
def test_faults_of_worlds(site: str, script: str, engine: Any) -> None:
    patient = Patient(site, script, engine)
    dice = Random(f"{WANTED} {script} {engine}")
    for kind in KINDS if WANTED == "all" else dice.sample(KINDS, SAMPLE):
        places = sorted({1, 2, 3, patient.calls}) if WANTED == "all" else [dice.choice((1, 2, patient.calls))]
        for k in places:
            at = f"{site}, {script}, {engine}"
            patient = endured(patient, lambda: Patient(site, script, engine), judge, kind, k, at)
    patient.close()


def broken(ss: ss2sql.Session, engine: Any, site: str, script: str, value: Any) -> ss2sql.Error:
    """The error of a script where a method of the world gives this."""
    source = Source()
    ss.attach("things", Mishaps(source))
    source.site, source.left, source.wrong = site, 1, lambda _: value
    with pytest.raises(ss2sql.ExecutionError) as caught:
        ss.run(script, engine=engine)
    return caught.value


@both
@pytest.mark.parametrize("keys", [[[1]], [1, {}], np.arange(4).reshape(2, 2)])
def test_keys_that_cannot_be_hashed(ss: ss2sql.Session, engine: Any, keys: Any) -> None:
    error = broken(ss, engine, "keys", "SELECT n FROM things AS list;", keys)
    assert error.code == "X011"
    assert "which cannot be hashed" in error.message
    assert isinstance(error.__cause__, TypeError)


@both
@pytest.mark.parametrize("site", ["keys", "near", "beside"])
def test_a_walk_without_end_can_be_ended(ss: ss2sql.Session, engine: Any, site: str) -> None:
    given: list[int] = []

    def endless() -> Any:
        for number in range(LONG):
            given.append(number)
            if number == 1500:
                ss.interrupt()
            yield (number, number) if site == "beside" else number

    script = {"keys": "SELECT n FROM things;", "near": "SELECT n FROM things.near(1);",
              "beside": "SELECT m FROM things.beside(1);"}[site]  # fmt: skip
    source = Source()
    ss.attach("things", Mishaps(source))
    source.site, source.left, source.wrong = site, 1, lambda _: endless()
    with pytest.raises(ss2sql.Cancelled):
        ss.run(script, engine=engine)
    assert len(given) < 3000
    assert ss.eval("len(SELECT n FROM things);") == 12


@both
@pytest.mark.parametrize(("site", "column"), [("mass", "mass"), ("size", "size")])
def test_arrays_without_end(ss: ss2sql.Session, engine: Any, site: str, column: str) -> None:
    error = broken(ss, engine, site, f"SELECT {column} FROM things AS list;", map(float, range(LONG)))
    assert error.code == "X011"


@both
def test_a_world_that_leaves_while_its_function_runs(ss: ss2sql.Session, engine: Any) -> None:
    source = Source()
    ss.attach("things", Mishaps(source))
    source.site, source.left, source.wrong = "keys", 1, lambda value: (ss.detach("things"), value)[1]
    with pytest.raises(ss2sql.ExecutionError) as caught:
        ss.run("SELECT push(this), x FROM things AS rows;", engine=engine)
    assert caught.value.code in ("X011", "X008")
    assert ss.tables() == {}


@both
@pytest.mark.parametrize("moment", [float("nan"), "noon", [1], 10**400])
def test_clocks_that_say_no_time(ss: ss2sql.Session, engine: Any, moment: Any) -> None:
    error = broken(ss, engine, "time", "SELECT getTime() FROM [1] AS list;", moment)
    assert error.code == "X004"
    assert "which is no time" in error.message
    ss.detach("things")
    ss.function("getTime", lambda: moment)
    with pytest.raises(ss2sql.ExecutionError, match="the function 'getTime' says"):
        ss.run("v{5.0} = 1;", engine=engine)


@both
def test_errors_keep_what_the_world_has_raised(ss: ss2sql.Session, engine: Any) -> None:
    source = Source()
    ss.attach("things", Mishaps(source))

    def fail(_: Any) -> Any:
        raise OSError("the simulator is gone")

    for site, script in (("time", "SELECT getTime() FROM [1] AS list;"), ("check", "SELECT weight(this) FROM things;")):
        source.site, source.left, source.wrong = site, 1 if site == "time" else 2, fail
        with pytest.raises(ss2sql.ExecutionError, match="the simulator is gone") as caught:
            ss.run(script, engine=engine)
        assert caught.value.code == "X011"
        assert type(caught.value.__cause__) is OSError


@both
def test_messages_of_values_that_cannot_be_shown(ss: ss2sql.Session, engine: Any) -> None:
    class MuteError(Exception):
        def __str__(self) -> str:
            raise ValueError

    def fail(_: Any) -> Any:
        raise MuteError

    source = Source()
    ss.attach("things", Mishaps(source))
    source.site, source.left, source.wrong = "color", 1, fail
    with pytest.raises(ss2sql.ExecutionError, match=r"things\[0\] cannot be read: MuteError"):
        ss.run("SELECT color FROM things;", engine=engine)
    assert broken(ss, engine, "keys", "SELECT n FROM things AS list;", [10**5000]).code == "X004"


WAITING = (
    "SELECT s FROM things START WITH s = 0.0 CONNECT BY NO CYCLE MAXIMUM 5 s = s + x STOP WITH s > 6;",
    "SELECT 1 / (4 - s) FROM frame START WITH s = 0 CONNECT BY UNIQUE MAXIMUM 5 s = s + 1 STOP WITH 1 / (4 - s) > 6;",
)


@pytest.mark.parametrize("script", WAITING)
def test_a_condition_that_waits_for_a_copied_source(ss: ss2sql.Session, script: str) -> None:
    """A search reads such a source from a copy, which has to have the column that the condition waits for."""
    pd = pytest.importorskip("pandas")
    ss.attach("things", Mishaps(Source()))
    ss.attach("frame", pd.DataFrame({"x": [0.0, 1.0, 2.0]}))
    outcomes: list[Any] = []
    for engine in ("database", "native"):
        try:
            outcomes.append(ss.run(script, engine=engine).value)  # type: ignore[arg-type]
        except ss2sql.ExecutionError as error:
            outcomes.append(error.code)
    assert outcomes[0] == outcomes[1] != "X009"
