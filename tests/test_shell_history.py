"""The file that keeps what was typed in the shell."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from ss2sql.shell import history


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path


def test_the_history_is_for_its_owner_alone(folder: Path) -> None:
    before = os.umask(0)
    try:
        path = history.history_file()
    finally:
        os.umask(before)
    assert path == folder / "state" / "ss2sql" / "history"
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700
    path.chmod(0o644)
    assert stat.S_IMODE(history.history_file().stat().st_mode) == 0o600


def test_the_history_follows_no_link(folder: Path) -> None:
    path = history.history_file()
    path.unlink()
    (folder / "other").write_text("precious")
    path.symlink_to(folder / "other")
    with pytest.raises(OSError, match="history"):
        history.history_file()
    assert (folder / "other").read_text() == "precious"


def test_the_history_is_in_the_home_where_xdg_says_nothing(folder: Path, monkeypatch) -> None:
    monkeypatch.setenv("HOME", str(folder))
    for value in ("", "relative/folder"):
        monkeypatch.setenv("XDG_STATE_HOME", value)
        assert history.state_folder() == folder / ".local" / "state" / "ss2sql"


def test_the_history_does_not_grow_for_ever(monkeypatch) -> None:
    from prompt_toolkit.history import FileHistory

    monkeypatch.setattr(history, "KEPT", 10)
    path = history.history_file()
    for number in range(25):
        FileHistory(str(path)).store_string(f"{number};\n{number} again;")
    kept = list(FileHistory(str(history.history_file())).load_history_strings())
    assert kept == [f"{number};\n{number} again;" for number in range(24, 14, -1)]


def test_what_begins_with_a_blank_is_not_kept() -> None:
    assert [history.is_kept(text) for text in ("1;", " 1;", "", "\n")] == [True, False, False, False]
