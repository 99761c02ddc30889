"""The oldest and the newest packages that pyproject.toml allows, under every Python that is here: `make compat`.

    python tests/compat.py [3.13 ...] [--ages oldest] [--with sqlglot==30.5.0] [--tests tests/test_sql.py]

Each combination gets an environment of its own in out/compat, filled by uv from its cache; a package that has no wheel
for a Python is taken in the oldest release that has one. A line is printed for each: the versions, and what pytest came
to. `--with` puts other versions in, to find the true oldest one.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path

ROOT = Path(__file__).parent.parent
ENVIRONMENTS = ROOT / "out" / "compat"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
PACKAGES = tuple(re.split(r"[<>=~!\[ ]", line)[0] for line in PROJECT["dependencies"])
TOOLS = ("pytest", "hypothesis", "hatchling")
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
AGES = {"oldest": "lowest-direct", "newest": "highest"}
PROGRAMS = 200  # random ones
TESTS = (
    *("test_cases.py", "test_parser.py", "test_parse_errors.py", "test_agreement.py", "test_package.py", "test_cli.py"),
    *("test_explain.py", "test_results.py", "test_remembered.py", "test_compat.py"),
)

LEFT_OUT = "not test_paths_of_random_searches"  # which wants more programs


def main() -> int:
    given = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    given.add_argument("pythons", nargs="*", default=PYTHONS)
    given.add_argument("--ages", nargs="+", choices=AGES, default=[*AGES])
    given.add_argument("--with", dest="others", nargs="+", default=[], metavar="PACKAGE==VERSION")
    given.add_argument("--tests", nargs="+", default=[f"tests/{name}" for name in TESTS])
    chosen = given.parse_args()
    if find_spec("uv") is None:
        sys.exit("uv is missing: python -m pip install uv")
    failed = 0
    for version in chosen.pythons:
        python = interpreter(version)
        if python is None:
            print(f"Python {version}: not here")
            continue
        for age in chosen.ages:
            failed += not combination(python, version, age, chosen.others, chosen.tests)
    return failed


def interpreter(version: str) -> str | None:
    """The Python of this version on the path, or among those of pyenv."""
    root = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"))
    found = [shutil.which(f"python{version}"), *sorted(map(str, root.glob(f"versions/{version}.*/bin/python")))]
    return next((python for python in found if python and works(python)), None)


def works(python: str) -> bool:
    """Whether it is one, and not the placeholder that pyenv puts on the path."""
    return subprocess.run([python, "-c", ""], capture_output=True, check=False).returncode == 0


def combination(python: str, version: str, age: str, others: Sequence[str], tests: Sequence[str]) -> bool:
    """Installs and tests one combination, prints its line, and says whether all went well."""
    installed = ENVIRONMENTS / f"{version}-{age}"
    inside = str(installed / "bin" / "python")
    into = ("pip", "install", "--quiet", "--python", inside)
    wheels = ("--only-binary", ":all:")
    uv("venv", "--quiet", "--clear", "--python", python, str(installed))
    uv(*into, *wheels, "--resolution", AGES[age], "--requirements", "pyproject.toml")
    uv(*into, *wheels, *TOOLS, *others)
    uv(*into, "--no-deps", "--editable", ".")
    environment = {**os.environ, "SS2SQL_PROGRAMS": str(PROGRAMS)}
    command = [inside, "-m", "pytest", "--tb=short", "-p", "no:cacheprovider", "-k", LEFT_OUT, *tests]
    ran = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    output = (ran.stdout + ran.stderr).splitlines()
    if ran.returncode:
        print(*output[-60:], sep="\n")
    print(f"Python {version}, {age}: {', '.join(versions(inside))}: {summary(output)}", flush=True)
    return ran.returncode == 0


def uv(*command: str) -> None:
    """Runs uv, without Pythons that it would download."""
    done = subprocess.run(
        [sys.executable, "-m", "uv", "--no-python-downloads", *command], cwd=ROOT, capture_output=True, text=True
    )
    if done.returncode:
        sys.exit(done.stderr)


def versions(python: str) -> Iterator[str]:
    """The packages that ss2sql needs, with the versions that are installed."""
    code = "import sys; from importlib.metadata import version; print(*map(version, sys.argv[1:]))"
    found = subprocess.run([python, "-c", code, *PACKAGES], capture_output=True, text=True, check=True).stdout.split()
    return (f"{name} {number}" for name, number in zip(PACKAGES, found, strict=True))


def summary(output: Sequence[str]) -> str:
    """The last line of pytest that counts, without the time."""
    counted = [line for line in output if re.search(r"\d+ (passed|failed|error)", line)]
    return re.sub(r" in [\d.]+s.*", "", counted[-1]).strip("= ") if counted else "no test ran"


if __name__ == "__main__":
    sys.exit(main())
