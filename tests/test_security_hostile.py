"""Many hostile scripts: each ends with a value or an error of ss2sql, and leaves everything as it was.

SS2SQL_HOSTILE=10000 tries so many.
"""

from __future__ import annotations

import contextlib
import io
import os
from pathlib import Path

import apsw
import pytest

import ss2sql
from ss2sql.errors import Error
from tests import hostile

COUNT = int(os.environ.get("SS2SQL_HOSTILE", "1000"))
AT_ONCE = 250  # scripts of one session


def test_the_canary_sings() -> None:
    hostile.reached.clear()
    assert hostile.Canary().secret == "secret"
    assert hostile.reached == {"secret"}


@pytest.mark.parametrize("first", range(0, COUNT, AT_ONCE))
def test_hostile_scripts_reach_nothing_and_change_nothing(
    first: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "data.db"
    connection = apsw.Connection(str(path))
    connection.execute(
        "CREATE TABLE t(a, b); INSERT INTO t VALUES (1, 'x'), (2, 'y'); CREATE VIEW v AS SELECT a FROM t"
    )
    connection.close()
    before, folder = path.read_bytes(), tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    with ss2sql.connect(path, progress=False, max_size=2**20) as ss:
        ss.function("f", lambda x=None: x, volatility="immutable")
        ss.set("xs", [1, [2, "b"], None])
        canary = hostile.Canary()
        ss.attach("objects", [canary])
        ss.set("canary", canary)
        variables = ss.variables()
        hostile.reached.clear()
        for seed in range(first, min(first + AT_ONCE, COUNT)):
            script = hostile.Maker(seed).script()
            for engine in ("auto", "native"):
                output = io.StringIO()
                with contextlib.redirect_stdout(output), contextlib.suppress(Error):
                    ss.run(script, engine=engine, timeout=2.0, max_rows=10_000)  # type: ignore[arg-type]
                assert "\x1b" not in output.getvalue(), script
                assert not hostile.reached, (script, hostile.reached)
        assert ss.variables() == variables
        assert ss.eval("SELECT a FROM t AS list") == [1, 2]
    assert path.read_bytes() == before
    assert list(folder.iterdir()) == []
    assert list(tmp_path.glob("data.db?*")) == []
