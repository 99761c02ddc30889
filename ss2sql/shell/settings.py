"""The settings of the shell: a row each, changed by the dot command of its name."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

from ss2sql.cli.output import FORMATS, SHOWN
from ss2sql.cli.run_command import ENGINES
from ss2sql.fast_dataclasses import dataclass


class CommandError(Exception):
    """A dot command failed: the reason, and what to do."""

    def __init__(self, message: str, *hints: str) -> None:
        super().__init__(message)
        self.hints = hints

    def __str__(self) -> str:
        return "\n".join([f"error: {self.args[0]}", *(f"  = help: {hint}" for hint in self.hints)])


class FileFailed(Exception):  # noqa: N818 - the error itself has been told
    """A file that was read has failed."""


@dataclass(slots=True)
class Settings:
    """How statements run, and how results are shown."""

    engine: str = "auto"
    format: str = "table"
    show: int = SHOWN
    timeout: float | None = None
    maximum: int | None = None
    max_rows: int | None = None
    workers: int = 1
    timer: bool = False

    def make_run_options(self) -> dict[str, Any]:
        names = ("engine", "timeout", "maximum", "max_rows", "workers")
        return {name: getattr(self, name) for name in names}


@dataclass(frozen=True, slots=True)
class Setting:
    """A setting: its name, its values, their parser, and a description."""

    name: str
    form: str
    about: str
    read: Callable[[str], Any]
    choices: tuple[str, ...] = ()


def _make_choice(*choices: str) -> Callable[[str], Any]:
    def read_choice(text: str) -> str:
        if text.lower() not in choices:
            raise ValueError
        return text.lower()

    return read_choice


def _parse_integer(least: int, **words: Any) -> Callable[[str], Any]:
    """The parser of a number of at least `least`, or one of some words."""

    def read_integer(text: str) -> Any:
        if text.lower() in words:
            return words[text.lower()]
        number = int(text)
        if number < least:
            raise ValueError
        return number

    return read_integer


def _parse_seconds(text: str) -> float | None:
    if text.lower() == "off":
        return None
    number = float(text)
    if not 0 <= number < float("inf"):
        raise ValueError
    return number


def _parse_switch(text: str) -> bool:
    return {"on": True, "off": False}[text.lower()]


FORMS = tuple(form for form in FORMATS if form in ("table", "json", "csv"))  # others are not for terminals
SETTINGS = {
    entry.name: entry
    for entry in (
        Setting("engine", "|".join(ENGINES), "where queries run", _make_choice(*ENGINES), ENGINES),
        Setting("format", "|".join(FORMS), "how results are printed", _make_choice(*FORMS), FORMS),
        Setting(
            "show", "N|all", "how many rows or paths of a table are shown", _parse_integer(0, all=sys.maxsize), ("all",)
        ),
        Setting("timer", "on|off", "whether the time of a run is told", _parse_switch, ("on", "off")),
        Setting("timeout", "SECONDS|off", "when a run is broken off", _parse_seconds, ("off",)),
        Setting("maximum", "N|off", "at most so many results of a search", _parse_integer(1, off=None), ("off",)),
        Setting("workers", "N", "processes for the calls that MEMORIZE makes", _parse_integer(1)),
    )
}


def format_setting(value: Any) -> str:
    """A value in the notation of the command."""
    if value is None or value is False:
        return "off"
    if value is True:
        return "on"
    return "all" if value == sys.maxsize else f"{value:g}" if isinstance(value, float) else str(value)


def change_setting(settings: Settings, name: str, text: str) -> str:
    """Changes a setting; gives the line with its new value."""
    entry = SETTINGS[name]
    try:
        setattr(settings, name, entry.read(text))
    except (ValueError, KeyError):
        raise CommandError(f".{name} takes {entry.form.replace('|', ' or ')}, not {text}") from None
    return f"{name}: {format_setting(getattr(settings, name))}"


def describe_setting(settings: Settings, name: str) -> str:
    """The value of a setting, and its possible values."""
    entry = SETTINGS[name]
    return f"{name}: {format_setting(getattr(settings, name))}   (.{name} {entry.form}: {entry.about})"
