"""Values of columns on their way out: they fit what the column declares, or are refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from sessions import both

import ss2sql
from ss2sql.vtables import Column, Table, World


@pytest.mark.parametrize(
    ("declared", "given", "value"),
    [
        (float, np.float32(1.5), 1.5),
        (float, 3, 3.0),
        (int, np.int64(7), 7),
        (bool, np.bool_(True), True),
        (str, np.str_("a"), "a"),
        (int | None, None, None),
        (int | None, np.int8(3), 3),
        (float | None, 2, 2.0),
        (list, np.arange(3), [0, 1, 2]),
        (list, (1, (2, 3)), [1, [2, 3]]),
        ((float, float), np.array([1, 2]), [1.0, 2.0]),
        ((int, str), (1, "a"), [1, "a"]),
        (dict, {"a": np.int32(1)}, {"a": 1}),
        (object, [None, 1.5], [None, 1.5]),
        (int | str, "x", "x"),
    ],
)
@both
def test_values_fit_their_declaration(declared: Any, given: Any, value: Any, engine: Any) -> None:
    found = one_value(declared, given, engine)
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize(
    ("declared", "given"),
    [
        (float, np.array([1.0])),
        (float, "1"),
        (float, True),
        (float, None),
        (float, float("inf")),
        (float, 1e101),
        (int, 1.0),
        (int, 2**63),
        (bool, 1),
        (str, 1),
        (str, "\ud800"),
        (list, "text"),
        ((float, float), (1.0,)),
        ((float, float), 1.0),
        (int | None, "1"),
        (int | str, 1.5),
    ],
)
@both
def test_values_that_do_not_fit_are_refused_by_name(declared: Any, given: Any, engine: Any) -> None:
    with pytest.raises(ss2sql.ExecutionError, match="the column 'value' of things holds") as caught:
        one_value(declared, given, engine)
    assert caught.value.code == "X004"


def one_value(declared: Any, given: Any, engine: Any) -> Any:
    class Things(Table):
        name = "things"
        columns = (Column("value", declared),)
        groups = {"value": "value"}

        def keys(self, where: Any) -> list[Any]:
            return [("a", 1)]

        def value(self, key: Any) -> Any:
            assert key == ("a", 1)
            return given

    class One(World):
        tables = (Things,)

    ss = ss2sql.connect()
    ss.attach("things", One())
    return ss.run("SELECT value FROM things AS value;", engine=engine).value
