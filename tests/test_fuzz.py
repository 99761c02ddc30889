"""The texts that fuzzing has kept, judged again; and the fuzzer's own parts."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Iterator

import pytest
from fuzz import CORPUS
from fuzz_judge import judge, session
from fuzz_mutations import NESTING
from trees import calls_of

import ss2sql

TEXTS = sorted(CORPUS.glob("*.ss"))


@pytest.fixture(name="ss", scope="module")
def fixture_ss() -> Iterator[ss2sql.Session]:
    with session() as made:
        yield made


def never() -> float:
    """A clock that stands still: tests measure no time."""
    return 0.0


def test_the_texts_that_were_kept_keep_every_promise(ss: ss2sql.Session) -> None:
    stages = Counter(judge(ss, path.read_bytes().decode("utf-8"), never) for path in TEXTS)
    assert min(stages[stage] for stage in ("nothing", "parsed", "compiled")) > 5, stages


# --- time that grows with the nesting ------------------------------------------------------------------


def around(text: str) -> str:
    """An expression in a script: a query as the next state of a search, whose type is asked for; else a condition."""
    if text.startswith("(SELECT"):
        return f"SELECT 1 FROM a = xs START WITH p = 0 CONNECT BY NO CYCLE p = {text}"
    return f"SELECT 1 FROM a = xs WHERE {text}"


def compiled(ss: ss2sql.Session, script: str) -> None:
    """Compiles a script as far as it is one."""
    with contextlib.suppress(ss2sql.Error):
        ss.compile(script).statements()


def nested(form: str, depth: int) -> str:
    text = "this"
    for _ in range(depth):
        text = form.replace("{}", text)
    return text


DEEP = {"NOT {}": 12, "(SELECT {} FROM xs)": 8}  # where it shows only deep inside


@pytest.mark.parametrize("form", NESTING)
def test_compiling_what_is_nested_takes_no_exponential_time(ss: ss2sql.Session, form: str) -> None:
    """From 5 levels to 10 the calls grow at most as the third power does, eightfold; doubling each level gives 32."""
    levels = DEEP.get(form, 5)

    def calls(depth: int) -> int:
        script = around(nested(form, depth))
        return calls_of(lambda: compiled(ss, script))

    compiled(ss, "SELECT this FROM xs")
    assert calls(2 * levels) < 9 * calls(levels)
