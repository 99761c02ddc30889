"""`ss2sql list`: what scripts can use, and the errors; `ss2sql completion`: what makes a shell complete commands."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from typing import TYPE_CHECKING, TypeAlias

import click

from ss2sql.cli.output import exit_with_code_on_error, print_line
from ss2sql.cli.script_options import NO_INPUTS, ScriptInputs, add_uses_options
from ss2sql.errors import CODES, suggest_names

if TYPE_CHECKING:
    from ss2sql.session.descriptions import FunctionAbout


Entry: TypeAlias = dict[str, str]  # the first value is the name, the last may be long


TOPICS = {
    "functions": "what scripts can call; with --functions and --world those of the user, too",
    "representations": "what AS can make of rows",
    "strategies": "options of CONNECT BY: the order of a search, and what happens to rows that repeat",
    "worlds": "types of Python objects that are tables; with --world the tables of one",
    "errors": "codes of errors and what they mean",
    "rewrites": "what makes queries cheaper; connect(disable=[...]) switches it off",
}


def list_topic(topic: str, inputs: ScriptInputs = NO_INPUTS) -> Iterator[Entry]:
    """The entries of a topic, with those of the user's inputs."""
    match topic:
        case "functions":
            from ss2sql.session.descriptions import describe_functions

            with inputs.open_session() as session:
                yield from map(_make_function_entry, describe_functions(session.host).values())
        case "representations":
            from ss2sql.session.descriptions import describe_representations

            with inputs.open_session() as session:
                for name, entry in describe_representations(session.host).items():
                    yield {"name": name, "text": entry.about}
        case "strategies":
            from ss2sql.lowering.strategies import ORDERS, REPEAT_RULES

            for order in ORDERS.values():
                yield {"name": order.keyword, "decides": "order", "engine": "any", "text": order.promise}
            for rule in REPEAT_RULES.values():
                engine = "any" if rule.lowered else "native"
                yield {"name": rule.keyword or "(none)", "decides": "repeats", "engine": engine, "text": rule.promise}
        case "worlds":
            from ss2sql.vtables.contract import list_adapter_types

            for name in list_adapter_types():
                package = name.partition(".")[0]
                needed = "pybullet" if package == "ss2sql" else package.removesuffix("_utils").removesuffix("_int")
                yield {"name": name, "text": f"{needed}, {'installed' if find_spec(needed) else 'not installed'}"}
        case "errors":
            yield from ({"name": one.code, "title": one.title, "text": one.explanation} for one in CODES.values())
        case "rewrites":
            from ss2sql.session.session import OFF_SWITCHES

            yield from ({"name": name, "text": text} for name, text in OFF_SWITCHES.items())


def _make_function_entry(entry: FunctionAbout) -> Entry:
    text, arguments = entry.about, ", ".join(entry.parameters or ())
    if entry.reason:
        text = "; ".join(filter(None, (text.rstrip("."), f"{entry.volatility}: {entry.reason}")))
    return {"name": entry.name, "arguments": arguments, "volatility": entry.volatility, "text": text}


@click.command("list")
@click.argument("topic", required=False, type=click.Choice(tuple(TOPICS)), metavar="[TOPIC]")
@click.argument("words", nargs=-1, metavar="[NAME]")
@add_uses_options
@click.option("--format", "form", type=click.Choice(("table", "json")), default="table", show_default=True,
              help="How the list is printed.")  # fmt: skip
@exit_with_code_on_error
def list_command(topic: str | None, words: tuple[str, ...], inputs: ScriptInputs, form: str) -> None:
    """Lists functions, representations, strategies, worlds, errors, rewrites.

    TOPIC is one of these words; without it they are told. With NAME only the one of that name.
    """
    name = " ".join(words) or None  # such as NO CYCLE
    if topic == "worlds" and inputs.worlds:
        with inputs.open_session() as session:
            # As `Session.describe` does.
            texts = {word: session.describe(word) for word in ([name] if name else session.host.names.worlds)}
        print_line(json.dumps(texts, ensure_ascii=False, indent=2) if form == "json" else "\n\n".join(texts.values()))
        return
    if topic is None:
        entries: list[Entry] = [{"name": word, "text": text} for word, text in TOPICS.items()]
    else:
        entries = _select_entries(list(list_topic(topic, inputs)), name, topic)
    if form == "json":
        print_line(json.dumps(entries, ensure_ascii=False, indent=2))
    elif name is not None:
        for key, text in entries[0].items():
            print_line(f"{key}: {text}")
    else:
        _print_entries(entries)


def _select_entries(entries: list[Entry], name: str | None, topic: str) -> list[Entry]:
    if name is None:
        return entries
    found = [entry for entry in entries if entry["name"].lower() == name.lower()]
    if not found:
        hint = "".join(f" ({text})" for text in suggest_names(name, (entry["name"] for entry in entries)))
        raise click.UsageError(f"there is no '{name}' among the {topic}{hint}", click.get_current_context())
    return found


def _print_entries(entries: Sequence[Entry]) -> None:
    """Prints a table with a line for each entry."""
    keys = list(entries[0])
    rows = [dict(zip(keys, keys, strict=True)), *entries]
    widths = {key: max(len(row[key]) for row in rows) for key in keys}
    for row in rows:
        print_line("  ".join(row[key].ljust(widths[key]) for key in keys).rstrip())


# --- `ss2sql completion`
SHELLS = ("bash", "zsh", "fish")


@click.command("completion", epilog='For bash, put this line into ~/.bashrc: eval "$(ss2sql completion bash)"')
@click.argument("shell", type=click.Choice(SHELLS))
@exit_with_code_on_error
def completion_command(shell: str) -> None:
    """Prints what makes bash, zsh or fish complete commands of ss2sql."""
    from click.shell_completion import get_completion_class

    kind = get_completion_class(shell)
    assert kind is not None
    print_line(kind(click.get_current_context().find_root().command, {}, "ss2sql", "_SS2SQL_COMPLETE").source())
