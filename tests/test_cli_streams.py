"""Standard streams that are closed, full or endless: one line says so, and the exit code tells it."""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from golden import each_row

import ss2sql

pytestmark = pytest.mark.skipif(not Path("/dev/full").exists(), reason="Linux has /dev/full")

FULL = "the result cannot be written: No space left on device"


def shell(line: str, folder: Path, **variables: str) -> tuple[int, str, str]:
    """The exit code, the output and the messages of a command line, in which `ss2sql` is ours; it gets 2 GB."""
    line = f"ulimit -v 2000000; {line.replace('ss2sql', f'{sys.executable} -m ss2sql', 1)}"
    environment = {**os.environ, "PYTHONPATH": str(Path(ss2sql.__file__).parents[1]), **variables}
    done = subprocess.run(
        ["sh", "-c", line], capture_output=True, text=True, timeout=60, check=False, cwd=folder, env=environment
    )
    return done.returncode, done.stdout, done.stderr


@each_row("command_line/streams", "line", "told")
def test_streams_that_are_closed_full_or_endless(tmp_path: Path, line: str, told: str) -> None:
    ss2sql.connect(tmp_path / "data.db").close()
    (tmp_path / "statement.ss").write_text("1 + 1;\n", encoding="utf-8")
    with (tmp_path / "large.ss").open("wb") as file:
        file.truncate(1_500_000_000)
    found, _, messages = shell(line, tmp_path)
    first, *help_lines = messages.splitlines() or [""]
    assert f"{found} {first}".rstrip() == told
    assert all(extra.startswith("  = help: ") for extra in help_lines)


def test_another_stream_that_is_closed_and_a_full_disk_as_json(tmp_path: Path) -> None:
    for line in ("ss2sql run -e 1+1 <&-", "ss2sql run -e 1+1 2>&-", "ss2sql run -e 1+1 <&- 2>&-"):
        assert shell(line, tmp_path) == (0, "2\n", "")
    code, _, messages = shell("ss2sql run -e 1+1 --error-format json >/dev/full", tmp_path)
    assert code == 1
    assert f'"message": "{FULL}"' in messages


def test_long_lines_of_complete_statements_are_read_in_parts(tmp_path: Path) -> None:
    line = f"'' == '{'ä' * 40_000}'; " * 4 + "\n1 + 'x';\n"
    (tmp_path / "statements.ss").write_text(line, encoding="utf-8")
    code, output, messages = shell("ss2sql repl <statements.ss | sort | uniq -c", tmp_path)
    assert (code, output.split()) == (0, ["4", "False"])
    assert "<stdin>:2:3" in messages


def test_the_largest_script_is_read(tmp_path: Path) -> None:
    for name, size in (("fits.ss", 256 * 1024), ("large.ss", 256 * 1024 + 1)):
        (tmp_path / name).write_bytes(b"1 + 1" + b" " * (size - 5))
    with ss2sql.connect() as ss:
        assert ss.eval(tmp_path / "fits.ss") == 2
        with pytest.raises(ss2sql.ParseError, match="P004"):
            ss.eval(tmp_path / "large.ss")


WORKERS = """
import ss2sql
assert ".zip" in ss2sql.__file__
if __name__ == "__main__":
    ss = ss2sql.connect()
    assert ss.eval("SELECT this + 1 FROM [1, 2] AS list;") == [2, 3]
    import sys
    assert "lark" not in sys.modules
    from ss2sql.package_data import find_package_file
    for package, name in (("ss2sql.scenes", "youbot.urdf"), ("ss2sql.runtime.parallel", "worker_process.py")):
        assert find_package_file(package, name).is_file()
    print("imported")
"""


def test_the_package_runs_from_a_zip_file(tmp_path: Path) -> None:
    package = Path(ss2sql.__file__).parent
    packed = tmp_path / "packed.zip"
    with zipfile.ZipFile(packed, "w") as file:
        for path in package.rglob("*"):
            if "__pycache__" not in path.parts:
                file.write(path, Path("ss2sql") / path.relative_to(package))
    (tmp_path / "uses.py").write_text(WORKERS, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "uses.py"], capture_output=True, text=True, check=False, cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(packed)},
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (0, "imported\n", "")
    assert shell("ss2sql run -e 1+1", tmp_path, PYTHONPATH=str(packed)) == (0, "2\n", "")
    assert shell("ss2sql run -e 1+", tmp_path, PYTHONPATH=str(packed))[0] == 1
