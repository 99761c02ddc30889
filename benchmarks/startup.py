"""What it costs to begin: `import ss2sql` and `ss2sql --help`, beside the packages that they rest on.

`python benchmarks/startup.py` prints a table of ratios: `import ss2sql`, a first session and first queries, to the
import of apsw, sqlglot, lark and numpy; `ss2sql --help` to that of click and rich. Every command runs in a process of
its own, all of them in turn, several times. Seconds are those of the processor, and the least of each command counts:
others that use the machine disturb neither much.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from dataclasses import dataclass

MAXIMUM = 1.3  # times what the core packages take
HELP_MAXIMUM, HELP_MORE = 1.5, 0.1  # times what click and rich take, and seconds beside it

CORE = "import apsw, sqlglot, lark, numpy"
LIST = "import ss2sql; ss = ss2sql.connect(); ss.run('SELECT this FROM [1, 2] WHERE this > 1;')"
SEARCH = "ss.run('SELECT this FROM [1, 2] START WITH x = 0 CONNECT BY UNIQUE x = x + this STOP WITH x > 3;')"
SHELL = "import click, rich"


@dataclass(frozen=True)
class Measured:
    """A command and what it is measured against, with the most that it may take; None where no bound was set."""

    name: str
    code: str
    against: str
    times: float | None
    more: float = 0.0


MEASURED = (
    Measured("import ss2sql", "import ss2sql", CORE, MAXIMUM),
    Measured("ss2sql.connect()", "import ss2sql; ss2sql.connect()", CORE, None),
    Measured("a query of a list", LIST, CORE, 1.0),
    Measured("a query in SQLite", LIST.replace("connect()", "connect(engine='database')"), CORE, None),
    Measured("a search in SQLite", f"import ss2sql; ss = ss2sql.connect(); {SEARCH}", LIST, 2.5),
    Measured("ss2sql --help", "from ss2sql.cli import main; main(['--help'])", SHELL, HELP_MAXIMUM, HELP_MORE),
    Measured(
        "ss2sql run --help", "from ss2sql.cli import main; main(['run', '--help'])", SHELL, HELP_MAXIMUM, HELP_MORE
    ),
)


def seconds_of(code: str) -> float:
    """The seconds of the processor that a new Python needs for the code."""
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f"it failed: {code}")
    return usage.ru_utime + usage.ru_stime


def measure(repeat: int) -> dict[str, float]:
    """The least seconds of each piece of code."""
    codes = list(dict.fromkeys(["pass", *(code for one in MEASURED for code in (one.against, one.code))]))
    least = dict.fromkeys(codes, float("inf"))
    for turn in range(repeat + 1):
        for code in codes:
            seconds = seconds_of(code)
            if turn:  # the first time files are read from the disk
                least[code] = min(least[code], seconds)
    return least


def table(least: dict[str, float]) -> tuple[list[str], bool]:
    """The lines of the table, and whether all is as quick as it has to be. Times are those beyond an empty Python."""
    empty = least["pass"]
    lines = [f"{'':20} {'seconds':>8} {'beside':>8} {'ratio':>7}  may take", f"{'python':20} {empty:8.3f}"]
    good = True
    for one in MEASURED:
        own, other = least[one.code] - empty, least[one.against] - empty
        allowed = "" if one.times is None else f"{one.times:g} times" + (f" + {one.more:g} s" if one.more else "")
        quick = one.times is None or own <= one.times * other + one.more
        good = good and quick
        verdict = "" if quick else ", TOO SLOW"
        lines.append(f"{one.name:20} {own:8.3f} {other:8.3f} {own / other:7.2f}  {allowed}{verdict}")
    return lines, good


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeat", type=int, default=7, help="how often each command runs (default: %(default)s)")
    lines, good = table(measure(parser.parse_args().repeat))
    print("\n".join(lines))
    print("`beside` is what the packages take: apsw, sqlglot, lark and numpy; click and rich for the command line")
    sys.exit(0 if good else 1)


if __name__ == "__main__":
    main()
