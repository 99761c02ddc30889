"""`ss2sql list`: what scripts can use, and the errors."""

from __future__ import annotations

import inspect
import json
import sys
from collections.abc import Callable, Iterable, Sequence
from importlib.util import find_spec
from typing import TYPE_CHECKING, TypeAlias

import click

from ss2sql.cli.endings import reports_errors
from ss2sql.cli.given import NOTHING_GIVEN, Given, uses_options
from ss2sql.cli.output import console, echo

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

    from ss2sql.language.operations import Operation
    from ss2sql.runtime.functions import UserFunction
    from ss2sql.runtime.session import Session

Entry: TypeAlias = dict[str, str]  # the first value is the name, the last may be long


def _functions(session: Session) -> Iterable[Entry]:
    from ss2sql.language.operations import WRITTEN

    own = {**session.host.world_functions, **session.host.functions}
    yield from (_registered(entry) for entry in own.values())
    yield from (_built_in(entry) for name, entry in WRITTEN.items() if name not in own)


def _built_in(row: Operation) -> Entry:
    least, most = row.arity
    arguments = f"{least}" if least == most else f"{least} or more" if most is None else f"{least} to {most}"
    return {"name": row.name, "arguments": arguments, "volatility": row.volatility, "text": row.about}


def _registered(entry: UserFunction) -> Entry:
    text = (entry.function.__doc__ or "").strip().splitlines() or [""]
    arguments = ", ".join(entry.parameters) or _built_in_size(entry)
    told = "; ".join(part for part in (text[0].rstrip("."), f"{entry.volatility}: {entry.reason}") if part)
    return {"name": entry.name, "arguments": arguments, "volatility": entry.volatility, "text": told}


def _built_in_size(entry: UserFunction) -> str:
    return f"{entry.minimum}" if entry.minimum == entry.maximum else f"{entry.minimum} or more"


def _representations(session: Session) -> Iterable[Entry]:
    for name, function in session.host.shapes.functions.items():
        module = inspect.getmodule(function)
        about = (function.__doc__ or "").strip()
        if module is not None and module.__name__.startswith("ss2sql.runtime.representations."):
            about = (module.__doc__ or "").partition(": ")[2]
        yield {"name": name, "text": about.strip().split("\n")[0].rstrip(".")}


def _strategies() -> Iterable[Entry]:
    from ss2sql.lowering.strategies import GUARDS, ORDERS

    for order in ORDERS.values():
        yield {"name": order.keyword, "decides": "order", "engine": "any", "text": order.promise}
    for guard in GUARDS.values():
        engine = "any" if guard.lowered else "native"
        yield {"name": guard.keyword or "(none)", "decides": "repeats", "engine": engine, "text": guard.promise}


def _worlds() -> Iterable[Entry]:
    from ss2sql.vtables import known_types

    for name in known_types():
        package = name.partition(".")[0]
        needed = "pybullet" if package == "ss2sql" else package.removesuffix("_utils").removesuffix("_int")
        yield {"name": name, "text": f"{needed}, {'installed' if find_spec(needed) else 'not installed'}"}


def _errors() -> Iterable[Entry]:
    from ss2sql.errors import CODES

    for code in CODES.values():
        yield {"name": code.code, "title": code.title, "text": code.explanation}


def _rewrites() -> Iterable[Entry]:
    from ss2sql.runtime.session import SWITCHES

    for name, text in SWITCHES.items():
        yield {"name": name, "text": text}


TOPICS = {
    "functions": "what scripts can call; with --functions and --world those of the user, too",
    "representations": "what AS can make of rows",
    "strategies": "options of CONNECT BY: the order of a search, and what happens to rows that repeat",
    "worlds": "types of Python objects that are tables; with --world the tables of one",
    "errors": "codes of errors and what they mean",
    "rewrites": "what makes queries cheaper; connect(disable=[...]) switches it off",
}
OF_SESSION: dict[str, Callable[[Session], Iterable[Entry]]] = {
    "functions": _functions,
    "representations": _representations,
}
FIXED: dict[str, Callable[[], Iterable[Entry]]] = {
    "strategies": _strategies,
    "worlds": _worlds,
    "errors": _errors,
    "rewrites": _rewrites,
}


def entries_of(topic: str, given: Given = NOTHING_GIVEN) -> list[Entry]:
    """The entries of a topic, with those of the user's inputs."""
    if topic in FIXED:
        return list(FIXED[topic]())
    with given.session() as session:
        return list(OF_SESSION[topic](session))


def _complete_name(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Names of the topic with this prefix, without running the user's code."""
    from click.shell_completion import CompletionItem

    topic = context.params.get("topic")
    if topic not in TOPICS:
        return []
    return [
        CompletionItem(entry["name"], help=entry.get("title", entry["text"]))
        for entry in entries_of(topic)
        if entry["name"].lower().startswith(incomplete.lower())
    ]


@click.command("list")
@click.argument("topic", required=False, type=click.Choice(tuple(TOPICS)), metavar="[TOPIC]")
@click.argument("words", nargs=-1, metavar="[NAME]", shell_complete=_complete_name)
@uses_options
@click.option("--format", "form", type=click.Choice(("table", "json")), default="table", show_default=True,
              help="How the list is printed.")  # fmt: skip
@reports_errors
def command(
    topic: str | None,
    words: tuple[str, ...],
    given: Given,
    form: str,
) -> None:
    """Lists functions, representations, strategies, worlds, errors, rewrites.

    TOPIC is one of these words; without it they are told. With NAME only the one of that name.
    """
    name = " ".join(words) or None  # such as NO CYCLE
    if topic == "worlds" and given.worlds:
        with given.session() as session:
            _describe(session, name, form)
        return
    if topic is None:
        entries: list[Entry] = [{"name": word, "text": text} for word, text in TOPICS.items()]
    else:
        entries = _named(entries_of(topic, given), name, topic)
    if form == "json":
        echo(json.dumps(entries, ensure_ascii=False, indent=2))
    elif name is not None:
        for key, text in entries[0].items():
            echo(f"{key}: {text}")
    else:
        _print(entries)


def _named(entries: list[Entry], name: str | None, topic: str) -> list[Entry]:
    if name is None:
        return entries
    found = [entry for entry in entries if entry["name"].lower() == name.lower()]
    if not found:
        from ss2sql.errors import did_you_mean

        hint = "".join(f" ({text})" for text in did_you_mean(name, (entry["name"] for entry in entries)))
        raise click.UsageError(f"there is no '{name}' among the {topic}{hint}", click.get_current_context())
    return found


def _describe(session: Session, name: str | None, form: str) -> None:
    """Prints the tables of attached worlds, as `Session.describe` does."""
    names = list(session.host.names.worlds) if name is None else [name]
    texts = {word: session.describe(word) for word in names}
    echo(json.dumps(texts, ensure_ascii=False, indent=2) if form == "json" else "\n\n".join(texts.values()))


def _print(entries: Sequence[Entry]) -> None:
    """Prints a table: on a terminal with wrapped texts, elsewhere with a line for each entry."""
    keys = list(entries[0])
    if sys.stdout.isatty():
        from rich.table import Table
        from rich.text import Text

        table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
        for key in keys:
            table.add_column(key, no_wrap=key != "text", header_style="bold", style="cyan" if key == "name" else "")
        for entry in entries:
            table.add_row(*(Text(entry[key]) for key in keys))
        console().print(table)
        return
    rows = [dict(zip(keys, keys, strict=True)), *entries]
    widths = {key: max(len(row[key]) for row in rows) for key in keys}
    for row in rows:
        echo("  ".join(row[key].ljust(widths[key]) for key in keys).rstrip())
