"""Fuzzes parser and compiler: `python tests/fuzz.py`, for SS2SQL_FUZZ_SECONDS, twenty minutes without it.

Texts grow from the golden cases and `corpus/`, by changes of their tokens and trees (`fuzz_mutations`) and of their
bytes (libFuzzer's own); Atheris keeps those that reach new code. `fuzz_judge` says what has to hold for each. What
breaks it is written to out/fuzz/found/, one file for each place in the code that it breaks at, and the run goes on; a
crash of the interpreter, more than 1.5 GiB, or a minute for one text end it. The exit code is 1 if anything was found.
"""

from __future__ import annotations

import hashlib
import io
import os
import shutil
import subprocess
import sys
import traceback
from contextlib import redirect_stderr
from pathlib import Path
from random import Random
from typing import Any

HERE = Path(__file__).parent
CORPUS = HERE / "corpus"
OUT = HERE.parent / "out" / "fuzz"
FOUND, GROWN, SEEDS = OUT / "found", OUT / "grown", OUT / "seeds"
SECONDS = int(os.environ.get("SS2SQL_FUZZ_SECONDS", "1200"))
CHILD = "SS2SQL_FUZZ_CHILD"  # set where libFuzzer runs, which starts itself again with arguments of its own
LONGEST = 8192  # bytes of a text
SESSION = 500  # texts before a new session is made, so that a session's memory is no growth
COMPILER = ["ss2sql.frontend", "ss2sql.lowering", "ss2sql.errors", "ss2sql.runtime.python"]  # what is instrumented
LIMITS = ["-rss_limit_mb=1536", "-malloc_limit_mb=1024", "-timeout=60", "-report_slow_units=60", f"-max_len={LONGEST}"]


def seeds() -> list[str]:
    """The scripts of the golden cases and of the corpus."""
    from golden import cases
    from listings import HANOI, ROBOT, SPACE

    kept = [path.read_bytes().decode("utf-8", "replace") for path in sorted(CORPUS.glob("*.ss"))]
    return [*(case.script for case in cases()), *HANOI.values(), ROBOT, SPACE, *kept]


def write(folder: Path, texts: list[str]) -> None:
    """Each text as a file of its own, named by its content."""
    folder.mkdir(parents=True, exist_ok=True)
    for text in texts:
        content = text.encode("utf-8", "surrogatepass")
        (folder / f"{hashlib.sha256(content).hexdigest()[:12]}.ss").write_bytes(content)


class Target:
    """What Atheris calls for each text."""

    def __init__(self) -> None:
        from fuzz_judge import judge, session

        self.judge, self.session = judge, session
        self.made: Any = session()
        self.asked = 0

    def __call__(self, data: bytes) -> None:
        text = data.decode("utf-8", "replace")
        self.asked += 1
        if self.asked % SESSION == 0:
            self.made.close()
            self.made = self.session()
        try:
            self.judge(self.made, text)
        except Exception as error:
            note(text, error)


def note(text: str, error: Exception) -> None:
    """Writes down a text, once for each place that it breaks at, the shortest one."""
    frames = traceback.extract_tb(error.__traceback__)
    frames = [frame for frame in frames if "/ss2sql/" in Path(frame.filename).as_posix()] or frames
    place = f"{type(error).__name__}-{Path(frames[-1].filename).stem}-{frames[-1].lineno}"
    if isinstance(error, AssertionError):
        place += "-" + hashlib.sha256(str(error)[:20].encode()).hexdigest()[:4]
    file = FOUND / f"{place}.ss"
    if not file.exists() or len(file.read_bytes()) > len(text.encode("utf-8", "surrogatepass")):
        file.write_text(text, encoding="utf-8", errors="surrogatepass", newline="")
        reason = "".join(traceback.format_exception(error))
        file.with_suffix(".txt").write_text(f"{text!r}\n\n{reason}", encoding="utf-8", errors="backslashreplace")


def child(arguments: list[str]) -> None:
    """Runs libFuzzer in this process; it never comes back."""
    import atheris

    with redirect_stderr(io.StringIO()), atheris.instrument_imports(include=COMPILER, enable_loader_override=False):
        import fuzz_judge  # noqa: F401 - with it all that is instrumented
        from fuzz_mutations import Donors, Mutator
    mutator = Mutator(Donors(seeds()))

    def changed(data: bytes, most: int, seed: int) -> bytes:
        dice = Random(seed)
        if dice.random() < 0.15:
            return bytes(atheris.Mutate(data, most))
        text = mutator.changed(data.decode("utf-8", "replace"), dice)
        return text.encode("utf-8", "surrogatepass")[:most]

    again = f"{sys.executable} {Path(__file__)}"  # libFuzzer starts itself by a line for the shell
    atheris.Setup([again, *arguments], Target(), custom_mutator=changed)
    atheris.Fuzz()


def fuzz() -> int:
    """A run in a process of its own; prints what it found."""
    shutil.rmtree(FOUND, ignore_errors=True)
    for folder in (FOUND, GROWN):
        folder.mkdir(parents=True, exist_ok=True)
    shutil.rmtree(SEEDS, ignore_errors=True)
    write(SEEDS, seeds())
    options = [*LIMITS, f"-max_total_time={SECONDS}", "-print_final_stats=1", "-verbosity=1", "-reload=0"]
    seed = ["-seed=" + os.environ["SS2SQL_SEED"]] if "SS2SQL_SEED" in os.environ else []
    folders = [str(GROWN), str(SEEDS)]
    command = [sys.executable, str(Path(__file__)), *options, *seed, f"-artifact_prefix={FOUND}/", *folders]
    code = subprocess.run(command, env=os.environ | {CHILD: "1"}, check=False).returncode
    found = sorted(path for path in FOUND.iterdir() if path.suffix != ".txt")
    for path in found:
        reason = path.with_suffix(".txt")
        print(f"\n--- {path.name}\n{reason.read_text(encoding='utf-8') if reason.exists() else 'ended the run'}")
    print(f"fuzz: {SECONDS} s, {len(list(GROWN.iterdir()))} texts reach new code, {len(found)} found, exit code {code}")
    return 1 if found or code else 0


if __name__ == "__main__":
    match sys.argv[1:]:
        case arguments if CHILD in os.environ:
            child(arguments)
        case []:
            sys.exit(fuzz())
        case _:
            sys.exit(__doc__)
