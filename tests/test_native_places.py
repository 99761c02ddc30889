"""Where errors are: every exception that leaves the native executor names its place in the script."""

from __future__ import annotations

import re
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest
from native_host import FakeHost, place
from reference import Failure, Reference
from sessions import wrong_scripts

from ss2sql.runtime.python.located_code import EVAL_LABEL


def raising(error: BaseException) -> Callable[..., Any]:
    """A function that raises an exception, from none."""

    def fail(*arguments: Any) -> Any:
        raise error from None

    return fail


FUNCTIONS: dict[str, Callable[..., Any]] = {
    "rows": lambda: [{"a": 1}, {"b": 2}], "numbers": lambda: [1], "nan": lambda: float("nan"), "huge": lambda: 2**63,
    "same": lambda value: value, "empty": dict,
}  # fmt: skip
VARIABLES: dict[str, Any] = {"uneven": {"a": [1], "b": []}, "table": [{"k": 1}], "digits": "9" * 5000}


@pytest.mark.parametrize(
    ("code", "words", "marked"),
    [
        *wrong_scripts("values"),
        ("X001", [], "1 «+»\n  'a'"), ("X003", [], "x = [1];\nx[0] + x[«3»]"),
        ("R001", [], "IF(1 == 2; late = 1);\nSELECT this FROM [1, 2] WHERE this == 2 AND «late» > 1"),
        ("X004", [], "[1,\n «nan()»]"),  # an error of the border has the place of the call
    ],
)  # fmt: skip
def test_errors_of_the_language(code: str, words: list[str], marked: str) -> None:
    script = re.sub("[«»]", "", marked)
    error = FakeHost(FUNCTIONS, dict.fromkeys(FUNCTIONS, "volatile"), **VARIABLES).error(script)
    before, wrong, _ = re.split("[«»]", marked)
    assert error.code == code
    assert place(error) == f"{before.count(chr(10)) + 1}:{len(before) - before.rfind(chr(10))} {wrong}"
    assert all(part in str(error) for part in words)
    with pytest.raises(Failure) as caught:
        Reference(FUNCTIONS, VARIABLES).run(script)
    assert caught.value.code == code


@pytest.mark.parametrize("source", ["rows", "numbers"])
def test_a_column_that_a_row_has_not(source: str) -> None:
    error = FakeHost(FUNCTIONS).error(f"SELECT r.a FROM r = {source}()")
    assert (error.code, place(error)) == ("X008", "1:8 r.a")


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
    from ss2sql.runtime.python import located_code

    whole = located_code.CodePage.find_span
    monkeypatch.setattr(located_code.CodePage, "find_span", lambda page, at: whole(page, (at[0], at[1], None, None)))
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
