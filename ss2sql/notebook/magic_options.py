"""The first line of `%%ss`: options, a name for the result, and the beginning of the script."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from ss2sql.errors import suggest_names
from ss2sql.fast_dataclasses import dataclass
from ss2sql.session.engines import ENGINES, Engine

WORD = re.compile(r"\s*(-o|--?[a-z][\w-]*)(?=\s|=|$)")
VALUE = re.compile(r"(?:\s*=\s*|\s+)(?!-)(\S+)")
TARGET = re.compile(r"\s*([^\W\d]\w*)\s*<<(?=\s|$)")


class WrongOption(Exception):  # noqa: N818 - told by IPython as wrong usage
    """An unknown option, or an invalid value of one."""


@dataclass(frozen=True, slots=True)
class Options:
    """The options of the first line.

    `output` is the variable for the result; `quiet`: it was named with `<<`, so nothing is shown. `rest` comes after.
    """

    engine: Engine = "auto"
    timeout: float | None = None
    maximum: int | None = None
    session: str | None = None
    show: int | None = None
    explain: bool = False
    play: bool = False
    sql: bool = False
    output: str | None = None
    quiet: bool = False
    rest: str = ""


def _parse_engine(text: str) -> str:
    if text not in ENGINES:
        raise WrongOption(f"--engine is one of {', '.join(ENGINES)}, not {text}")
    return text


def _parse_seconds(text: str) -> float:
    try:
        seconds = float(text)
    except ValueError:
        seconds = -1.0
    if not 0 <= seconds < float("inf"):
        raise WrongOption(f"--timeout takes seconds, not {text}")
    return seconds


def _make_count_parser(name: str, least: int) -> Callable[[str], int]:
    def parse_text(text: str) -> int:
        if not text.isdecimal() or int(text) < least:
            raise WrongOption(f"{name} takes a whole number of at least {least}, not {text}")
        return int(text)

    return parse_text


def _parse_name(text: str) -> str:
    if not text.isidentifier():
        raise WrongOption(f"{text} is not a name for a variable")
    return text


# The parser of each option's value; None for those without one.
READERS: dict[str, tuple[str, Callable[[str], Any] | None]] = {
    "--engine": ("engine", _parse_engine),
    "--timeout": ("timeout", _parse_seconds),
    "--maximum": ("maximum", _make_count_parser("--maximum", 1)),
    "--session": ("session", _parse_name),
    "--show": ("show", _make_count_parser("--show", 0)),
    "--explain": ("explain", None),
    "--play": ("play", None),
    "--sql": ("sql", None),
    "-o": ("output", _parse_name),
    "--output": ("output", _parse_name),
}


def read_magic_options(line: str) -> Options:
    """The options of a line. Raises WrongOption."""
    found: dict[str, Any] = {}
    position = 0
    while word := WORD.match(line, position):
        if word[1] not in READERS:
            hints = suggest_names(word[1], READERS) or (f"the options are {', '.join(READERS)}",)
            raise WrongOption(f"%ss knows no option {word[1]}; {hints[0]}")
        field, reader = READERS[word[1]]
        position = word.end()
        if reader is None:
            found[field] = True
            continue
        value = VALUE.match(line, position)
        if value is None:
            raise WrongOption(f"{word[1]} needs a value")
        found[field] = reader(value[1])
        position = value.end()
    options = Options(**found)
    if target := TARGET.match(line, position):
        if options.output is not None:
            raise WrongOption(f"the result has two names, {options.output} and {target[1]}")
        options = replace(options, output=target[1], quiet=True)
        position = target.end()
    return replace(options, rest=line[position:])
