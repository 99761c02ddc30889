"""Where errors are: every exception that leaves the native executor names its place in the script."""

from __future__ import annotations

import re
import traceback
from dataclasses import dataclass
from typing import Any

import pytest
from native_host import FakeHost, place

from ss2sql.errors import Error, ExecutionError
from ss2sql.runtime.native.locate import EVAL_LABEL


def fail(*arguments: Any) -> Any:
    raise ZeroDivisionError("on purpose")


@pytest.mark.parametrize(
    ("script", "code", "expected"),
    [
        ("1 +\n  'a'", "X001", "1:3 +"),
        ("x = [1];\nx[0] + x[3]", "X003", "2:10 3"),
        ("1 < 'a'", "X001", "1:3 <"),
        ("2 * (3 / 0)", "X002", "1:8 /"),
        ("9223372036854775807 + 1", "X004", "1:21 +"),
        ("sqrt('é') + 1", "X007", "1:1 sqrt('é')"),
        ("'é€𝄞' + (1 / 0)", "X002", "1:12 /"),
        ("SELECT 1\nFROM [1, 2]\nWHERE this / 0", "X002", "3:12 /"),
        ("SELECT this FROM [1] ORDER BY 1 / (this - 1)", "X002", "1:33 /"),
        ("SELECT this, count(*) FROM [1] GROUP BY this HAVING 1 / (this - 1)", "X002", "1:55 /"),
        ("SELECT this FROM [1]\nSTART WITH n = 1 CONNECT BY n = n / 0", "X002", "2:35 /"),
        ("SELECT this FROM [1] START WITH n = 1 / 0 CONNECT BY n = n", "X002", "1:39 /"),
        ("SELECT (SELECT b.this + 'x' FROM b = [1] AS value) FROM a = [2]", "X001", "1:23 +"),
        ("eval(5)", "X007", "1:1 eval(5)"),
    ],
)
def test_errors_of_the_language(script: str, code: str, expected: str) -> None:
    error = FakeHost().error(script)
    assert (error.code, place(error)) == (code, expected)


def test_sorting_what_has_no_order_points_at_the_key() -> None:
    error = FakeHost().error("1; SELECT this FROM [1, 'a'] ORDER BY this")
    assert (error.code, place(error)) == ("X001", "1:39 this")


@pytest.mark.parametrize(
    "script",
    [
        "1 + \n  fail(2)",
        "SELECT this FROM [1]\nWHERE fail(this)",
        "SELECT\nfail(this) FROM [1]",
        "SELECT n.this FROM n = [1] START WITH m = 1 CONNECT BY MEMORIZE\n m = fail(m)",
        "SELECT this FROM [1] GROUP BY\nfail(this)",
        "SELECT (SELECT 1 FROM [1] WHERE\nfail(1)) FROM [1]",
        "SELECT 1 FROM [1],\nl = fail()",
    ],
)
def test_a_users_exception_keeps_its_type_and_gets_a_note(script: str) -> None:
    with pytest.raises(ZeroDivisionError, match="on purpose") as raised:
        FakeHost({"fail": fail}).run(script)
    (note,) = raised.value.__notes__
    column = script.split("\n")[1].index("fail") + 1
    assert note.startswith(f"raised by the function 'fail', called at <script>:2:{column}\n")
    assert note.endswith(script.split("\n")[1])


def test_a_note_names_the_call_that_failed() -> None:
    host = FakeHost({"half": lambda value: 1 / value})
    with pytest.raises(ZeroDivisionError) as raised:
        host.run("SELECT half(this), half(this - 1) FROM [2, 1]")
    assert "called at <script>:1:20" in raised.value.__notes__[0]


def test_pythons_traceback_shows_the_script() -> None:
    script = "x = 5;\nSELECT this + x FROM [1, 2]\nWHERE fail(this) == 1"
    try:
        FakeHost({"fail": fail}).run(script)
    except ZeroDivisionError as error:
        text = "".join(traceback.format_exception(error))
    assert 'File "<script>", line 3' in text
    assert "WHERE fail(this) == 1\n" in text
    # Ten marks below `fail(this)`, whatever the version of Python marks with.
    assert re.search(r"\n {10}[~^]{10}\n", text)


def test_a_stop_iteration_of_a_function_stays_one() -> None:
    def stop(value: Any) -> Any:
        raise StopIteration(value)

    host = FakeHost({"stop": stop})
    with pytest.raises(StopIteration) as raised:
        host.run("SELECT stop(this) FROM [4]")
    assert raised.value.value == 4
    assert "called at <script>:1:8" in raised.value.__notes__[0]


def test_a_runtime_error_of_a_function_stays_one() -> None:
    def give_up(value: Any) -> Any:
        raise RuntimeError("generator raised StopIteration") from None

    with pytest.raises(RuntimeError):
        FakeHost({"f": give_up}).run("SELECT f(this) FROM [4]")


def test_a_name_error_of_a_function_stays_one() -> None:
    def forgot(value: Any) -> Any:
        return unknown  # type: ignore[name-defined]  # noqa: F821

    with pytest.raises(NameError, match="unknown"):
        FakeHost({"f": forgot}).run("SELECT f(this) FROM [4]")


def test_an_error_of_the_border_gets_the_place_of_the_call() -> None:
    error = FakeHost({"nan": lambda: float("nan")}).error("[1,\n nan()]")
    assert (error.code, place(error)) == ("X004", "2:2 nan()")


def test_an_error_with_a_place_keeps_it() -> None:
    inner = FakeHost().error("5 / 0")

    def other(value: Any) -> Any:
        raise inner

    error = FakeHost({"other": other}).error("SELECT other(this) FROM [1]")
    assert error is inner
    assert place(error) == "1:3 /"


def test_errors_inside_of_eval_have_both_places() -> None:
    script = "SELECT this\nFROM [1] WHERE eval('1 + this[0]')"
    error = FakeHost().error(script)
    assert (error.code, place(error)) == ("X001", "1:10 0")
    assert [(span.place, label) for span, label in error.related] == [("<script>:2:16", EVAL_LABEL)]
    assert "<eval>:1:10" in str(error)
    assert "<script>:2:16" in str(error)


def test_texts_that_do_not_fit_the_grammar_have_both_places() -> None:
    error = FakeHost().error("x = 1; eval('1 +')")
    assert error.code[0] == "P"
    assert error.span is not None
    assert error.span.source.name == "<eval>"
    assert [span.place for span, _ in error.related][-1] == "<script>:1:8"


def test_evals_inside_of_evals_are_all_named() -> None:
    error = FakeHost(inner="1 / 0").error("eval('eval(inner)')")
    assert place(error) == "1:3 /"
    assert [span.place for span, _ in error.related] == ["<eval>:1:1", "<script>:1:1"]


def test_a_late_list_of_another_script_points_there() -> None:
    host = FakeHost()
    host.run("\n\npairs = [[a.this / 0]]")
    with pytest.raises(ExecutionError) as raised:
        host.run("SELECT (SELECT this FROM pairs AS list) FROM a = [1]")
    assert place(raised.value) == "3:18 /"


def test_an_error_is_raised_without_a_second_one_around_it() -> None:
    error = FakeHost(l=[1]).error("IF(1 == 2; late = 1); SELECT late FROM l")
    assert isinstance(error, Error)
    assert (error.code, error.__cause__, error.__suppress_context__) == ("R001", None, True)


def test_without_columns_in_tracebacks_the_line_is_still_known(monkeypatch: pytest.MonkeyPatch) -> None:
    from ss2sql.runtime.native import locate

    whole = locate.Page.span
    monkeypatch.setattr(locate.Page, "span", lambda page, at: whole(page, (at[0], at[1], None, None)))
    error = FakeHost().error("1 +\n2;\n3 / 0")
    assert error.span is not None
    assert error.span.line == 3


def test_a_field_that_raises() -> None:
    @dataclass
    class Body:
        mass: Any = None

        def __getattribute__(self, name: str) -> Any:
            if name == "mass":
                raise OSError("gone")
            return super().__getattribute__(name)

    with pytest.raises(OSError, match="gone") as raised:
        FakeHost(bodies=[Body()]).run("SELECT\nmass FROM bodies")
    assert raised.value.__notes__[0].startswith("raised by the function 'mass', called at <script>:2:1")
