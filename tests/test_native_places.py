"""Where errors are: every exception that leaves the native executor names its place in the script."""

from __future__ import annotations

import re
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest
from native_host import FakeHost, place

from ss2sql.runtime.run.error_locations import EVAL_LABEL


def raising(error: BaseException) -> Callable[..., Any]:
    """A function that raises an exception, from none."""

    def fail(*arguments: Any) -> Any:
        raise error from None

    return fail


@pytest.mark.parametrize(
    ("script", "code", "expected"),
    [
        ("1 +\n  'a'", "X001", "1:3 +"), ("x = [1];\nx[0] + x[3]", "X003", "2:10 3"), ("1 < 'a'", "X001", "1:3 <"),
        ("2 * (3 / 0)", "X002", "1:8 /"), ("9223372036854775807 + 1", "X004", "1:21 +"),
        ("sqrt('é') + 1", "X007", "1:1 sqrt('é')"), ("'é€𝄞' + (1 / 0)", "X002", "1:12 /"),
        ("SELECT 1\nFROM [1, 2]\nWHERE this / 0", "X002", "3:12 /"),
        ("1; SELECT this FROM [1, 'a'] ORDER BY this", "X001", "1:39 this"),
        ("SELECT this FROM [1] ORDER BY 1 / (this - 1)", "X002", "1:33 /"),
        ("SELECT this, count(*) FROM [1] GROUP BY this HAVING 1 / (this - 1)", "X002", "1:55 /"),
        ("SELECT count(*), sum(this) FROM ['a'] GROUP BY True", "X007", "1:18 sum(this)"),
        ("SELECT this FROM [1]\nSTART WITH n = 1 CONNECT BY n = n / 0", "X002", "2:35 /"),
        ("SELECT this FROM [1] START WITH n = 1 / 0 CONNECT BY n = n", "X002", "1:39 /"),
        ("SELECT (SELECT b.this + 'x' FROM b = [1] AS value) FROM a = [2]", "X001", "1:23 +"),
        ("SELECT this FROM [1] LIMIT (0 - 1)", "X006", "1:29 0 - 1"),
        ("SELECT r.a FROM r = rows()", "X008", "1:8 r.a"),
        ("SELECT r.a FROM r = numbers()", "X008", "1:8 r.a"),
        ("SELECT 1 FROM [1], uneven", "X005", "1:20 uneven"),
        ("IF(1 == 2; late = 1);\nSELECT this FROM [1, 2] WHERE this == 2 AND late > 1", "R001", "2:45 late"),
        ("eval(5)", "X007", "1:1 eval(5)"),
        ("[1,\n nan()]", "X004", "2:2 nan()"),  # an error of the border has the place of the call
    ],
)  # fmt: skip
def test_errors_of_the_language(script: str, code: str, expected: str) -> None:
    functions = {"rows": lambda: [{"a": 1}, {"b": 2}], "numbers": lambda: [1], "nan": lambda: float("nan")}
    error = FakeHost(functions, uneven={"a": [1], "b": []}).error(script)
    assert (error.code, place(error)) == (code, expected)


def test_a_late_list_of_an_earlier_script_points_there() -> None:
    host = FakeHost()
    host.run("\n\npairs = [[a.this / 0]]")
    assert place(host.error("SELECT (SELECT this FROM pairs AS list) FROM a = [1]")) == "3:18 /"


def test_a_variable_without_a_value_that_nobody_reads() -> None:
    assert FakeHost().run("IF(1 == 2; late = 1); SELECT this FROM [1, 2] WHERE this == 3 AND late > 1 AS list") == []


def test_pythons_traceback_shows_the_script() -> None:
    script = "x = 5;\nSELECT this + x FROM [1, 2]\nWHERE fail(this) == 1"
    with pytest.raises(ZeroDivisionError) as raised:
        FakeHost({"fail": raising(ZeroDivisionError())}).run(script)
    text = "".join(traceback.format_exception(raised.value))
    assert 'File "<script>", line 3' in text
    assert "WHERE fail(this) == 1\n" in text
    # Ten marks below `fail(this)`, whatever the version of Python marks with.
    assert re.search(r"\n {10}[~^]{10}\n", text)


def test_an_error_with_a_place_keeps_it() -> None:
    inner = FakeHost().error("5 / 0")
    error = FakeHost({"other": raising(inner)}).error("SELECT other(this) FROM [1]")
    assert error is inner
    assert place(error) == "1:3 /"


@pytest.mark.parametrize(
    ("script", "expected", "related"),
    [
        ("SELECT this\nFROM [1] WHERE eval('1 + this[0]')", "X001 1:10", ["<script>:2:16"]),
        ("x = 1; eval('1 +')", "P002 1:4", ["<script>:1:8"]),
        ("eval('eval(inner)')", "X002 1:3", ["<eval>:1:1", "<script>:1:1"]),
    ],
)
def test_errors_inside_of_eval_have_all_places(script: str, expected: str, related: list[str]) -> None:
    error = FakeHost(inner="1 / 0").error(script)
    assert error.span is not None
    assert f"{error.code} {error.span.place}" == expected.replace(" ", " <eval>:")
    assert [span.place for span, _ in error.related] == related
    assert error.related[-1][1] == EVAL_LABEL
    assert all(text in str(error) for text in (error.span.place, *related))


def test_without_columns_in_tracebacks_the_line_is_still_known(monkeypatch: pytest.MonkeyPatch) -> None:
    from ss2sql.runtime.run import error_locations

    whole = error_locations.CodePage.find_span
    monkeypatch.setattr(error_locations.CodePage, "find_span", lambda page, at: whole(page, (at[0], at[1], None, None)))
    error = FakeHost().error("1 +\n2;\n3 / 0")
    assert error.span is not None
    assert error.span.line == 3


def test_a_field_that_raises() -> None:
    @dataclass(slots=True)
    class Body:
        mass: Any = None

        def __getattribute__(self, name: str) -> Any:
            if name == "mass":
                raise OSError("gone")
            return object.__getattribute__(self, name)

    with pytest.raises(OSError, match="gone") as raised:
        FakeHost(bodies=[Body()]).run("SELECT\nmass FROM bodies")
    assert raised.value.__notes__[0].startswith("raised by the function 'mass', called at <script>:2:1")
