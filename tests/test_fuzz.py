"""The texts that fuzzing has kept, judged again; and the fuzzer's own parts."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Iterator
from random import Random
from unittest.mock import Mock

import pytest
from fuzz import CORPUS, LONGEST, seeds
from fuzz_judge import SECONDS_PER_KIB, judge, session
from fuzz_mutations import NESTING, PHRASES, Donors, Mutator, parts_of
from trees import calls_of

import ss2sql
from ss2sql.errors import ParseError, Source, Span

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


def test_the_corpus_is_small() -> None:
    assert TEXTS
    assert sum(path.stat().st_size for path in TEXTS) < 64 * 1024
    assert all(path.stat().st_size <= LONGEST for path in TEXTS)


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


# --- the judge -----------------------------------------------------------------------------------------


def test_the_judge_sees_what_breaks_a_promise(ss: ss2sql.Session, monkeypatch: pytest.MonkeyPatch) -> None:
    assert judge(ss, "SELECT this FROM xs", never) == "compiled"
    assert judge(ss, "SELECT nobody(1) FROM xs", never) == "parsed"
    assert judge(ss, "SELECT", never) == "nothing"

    ticks = iter((0.0, SECONDS_PER_KIB + 0.1))
    with pytest.raises(AssertionError, match=r"2\.1 s"):
        judge(ss, "1", lambda: next(ticks))

    source = Source("1")
    parse = Mock(side_effect=ParseError("P002", "no", Span(source, 0, 1), ["x"]))
    monkeypatch.setattr("fuzz_judge.parse", parse)
    judge(ss, "1", never)
    for error, words in (
        (ParseError("P002", "no", Span(source, 0, 9), ["x"]), "a place outside of the text"),
        (ParseError("P002", "no", Span(source, 0, 1)), "not what to do"),
        (ParseError("P002", "no", None, ["x"]), "no place"),
        (ParseError("P002", "no", Span(Source("other"), 0, 1), ["x"]), "does not have"),
        (RecursionError("deep"), "deep"),
    ):
        parse.side_effect = error
        with pytest.raises((AssertionError, RecursionError), match=words):
            judge(ss, "1", never)


def test_the_judge_asks_sqlite_whether_it_is_sql(ss: ss2sql.Session, monkeypatch: pytest.MonkeyPatch) -> None:
    from ss2sql.lowering import sql_builder

    plain = sql_builder.Dialect.print_tree
    monkeypatch.setattr(sql_builder.Dialect, "print_tree", lambda self, tree: plain(self, tree).replace("FROM", "FRM"))
    with pytest.raises(AssertionError, match="syntax error"):
        judge(ss, "SELECT this FROM xs AS list", never)


# --- the changes ---------------------------------------------------------------------------------------


def test_changes_are_the_same_for_the_same_seed() -> None:
    scripts = seeds()
    mutator = Mutator(Donors(scripts))

    def made() -> list[str]:
        return [mutator.changed(script, Random(number)) for number, script in enumerate(scripts[:150])]

    first = made()
    assert first == made()
    assert any(parts_of(text) for text in first)


def test_every_change_is_made() -> None:
    mutator = Mutator(Donors([*PHRASES, "SELECT a FROM b WHERE c", "x = [1, 2]; y"]))
    script = "SELECT this, n FROM xs WHERE this > 1 AND n; x = [1, 2]"
    for change in (*mutator.by_parts, *mutator.by_tokens):
        assert any(change(script, Random(number)) != script for number in range(20)), change
        assert isinstance(change("", Random(1)), str)


def test_a_part_takes_the_place_of_one_of_its_kind() -> None:
    mutator = Mutator(Donors(["SELECT a FROM b ORDER BY c DESC"]))
    kinds = {kind for kind, _ in parts_of("SELECT this FROM xs ORDER BY this")}
    assert {"script", "expression", "source", "key"} <= kinds
    changed = {mutator.with_a_part_of_another("SELECT this FROM xs ORDER BY this", Random(n)) for n in range(60)}
    assert {"SELECT this FROM xs ORDER BY c DESC", "SELECT this FROM b ORDER BY this"} <= changed
