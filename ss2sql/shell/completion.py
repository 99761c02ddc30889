"""Completions at the cursor: keywords that the grammar accepts there, and visible names."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Literal, TypeAlias

from ss2sql.editor.keywords import ONE_OF, Keyword, keywords
from ss2sql.fast_dataclasses import dataclass
from ss2sql.shell.completion_context import CompletionContext, find_context, find_open_call
from ss2sql.shell.dot_commands import COMMANDS
from ss2sql.shell.settings import SETTINGS
from ss2sql.shell.statement_splitter import find_statement_at
from ss2sql.shell.symbols import Function, SymbolTable

Kind: TypeAlias = Literal["keyword", "function", "variable", "table", "column", "representation", "command", "value"]

IN_ORDER = ("WHERE", "START", "CONNECT", "STOP")  # clauses that stand in this order
SORTS = ("clause", "option", "other", "operator", "constant")  # the order of keywords in lists
ANY_ORDER = ("GROUP", "ORDER", "LIMIT")  # clauses after them in any order


@dataclass(frozen=True, slots=True)
class Suggestion:
    """A text that replaces the last `length` characters before the cursor."""

    text: str
    length: int
    kind: Kind
    about: str = ""
    shown: str = ""  # the text in the list, where it differs


def suggest_completions(text: str, cursor: int, symbols: SymbolTable) -> list[Suggestion]:
    """The suggestions at the cursor of the text, the likeliest first."""
    piece = find_statement_at(text, cursor)
    if piece.is_command:
        head = piece.text.split(maxsplit=1)
        statement = COMMANDS[head[0]].takes == "script" if head[0] in COMMANDS else False
        begun = text[piece.start : cursor]
        if not (statement and " " in begun):
            return list(_suggest_for_command(begun, symbols))
        start = piece.start + len(head[0])
        return list(_suggest_in_statement(text[start : piece.end], cursor - start, symbols))
    if not text[piece.start : cursor].strip("."):
        dots = cursor - piece.start
        first = [] if dots else _suggest_in_statement("", 0, symbols)
        return [*(Suggestion(name, dots, "command", entry.about) for name, entry in COMMANDS.items() if dots), *first]
    return list(_suggest_in_statement(text[piece.start : max(piece.end, cursor)], cursor - piece.start, symbols))


def find_signature(text: str, cursor: int, symbols: SymbolTable) -> tuple[Function, int] | None:
    """The function or representation whose call the cursor is in, and which argument is being written."""
    piece = find_statement_at(text, cursor)
    call = find_open_call(text[piece.start : cursor], cursor - piece.start)
    if call is None:
        return None
    found = (
        symbols.representations.get(call.name.lower()) if call.is_representation else symbols.functions.get(call.name)
    )
    return None if found is None else (found, call.argument)


def _suggest_in_statement(statement: str, cursor: int, symbols: SymbolTable) -> Iterable[Suggestion]:
    here = find_context(statement, cursor)
    if here.in_string:
        return []
    if here.owner or here.after == ".":
        return _filter_prefix(here.word, _suggest_members(here, symbols))
    words = list(_filter_prefix(here.word, _suggest_keywords(here)))
    names = list(_filter_prefix(here.word, _suggest_names(here, symbols)))
    first = here.word.isupper() or not here.wants_value or not here.after
    return [*words, *names] if first else [*names, *words]


def _filter_prefix(word: str, found: Iterable[Suggestion]) -> Iterator[Suggestion]:
    """Suggestions that begin with the word in any case, each once, without the word itself."""
    written = set()
    for one in found:
        if one.text.lower().startswith(word.lower()) and one.text != word and one.text not in written:
            written.add(one.text)
            yield Suggestion(one.text, len(word), one.kind, one.about, one.shown)


def _suggest_keywords(here: CompletionContext) -> Iterator[Suggestion]:
    for word, keyword in sorted(keywords().items(), key=lambda item: SORTS.index(item[1].sort)):
        if (here.expected is None or word in here.expected) and not _is_spent(word, keyword, here.seen):
            text = f"{keyword.text}(" if word == "IF" else keyword.text
            yield Suggestion(text, 0, "keyword", keyword.about, keyword.text)
    for keyword in keywords().values():  # the second of two words
        first, _, second = keyword.text.partition(" ")
        if second and here.after == first and (here.expected is None or second in here.expected):
            yield Suggestion(second, 0, "keyword", keyword.about)


def _is_spent(word: str, keyword: Keyword, written: tuple[str, ...]) -> bool:
    """Whether this query cannot have the clause or option (again)."""
    if keyword.sort == "option":
        return word in written or any(keyword.text in group and _contains_any(group, written) for group in ONE_OF)
    if word in IN_ORDER:
        later = IN_ORDER[IN_ORDER.index(word) :] + ANY_ORDER
        return any(clause in written for clause in later) or (word == "STOP" and "CONNECT" not in written)
    return word in ANY_ORDER and word in written


def _contains_any(group: Iterable[str], written: tuple[str, ...]) -> bool:
    return any(text.split()[0] in written for text in group)


def _suggest_names(here: CompletionContext, symbols: SymbolTable) -> Iterator[Suggestion]:
    if here.after == "AS" and here.clause == "SELECT":
        return  # a new name
    if here.after == "AS":
        for entry in symbols.representations.values():
            bracket = "(" if entry.parameters else ""
            yield Suggestion(entry.name + bracket, 0, "representation", entry.about, entry.call)
        return
    if here.expected is not None and "NAME" not in here.expected:
        return
    if not here.wants_value:  # only a name that is assigned to can stand here
        if "CONNECT" in here.seen:
            yield from (Suggestion(name, 0, "variable", "of START WITH") for name in here.states)
        return
    if here.clause == "FROM":
        yield from _suggest_tables(symbols)
        yield from _suggest_variables(here, symbols)
    else:
        yield from _suggest_columns(here, symbols)
        yield from _suggest_variables(here, symbols)
        yield from _suggest_aliases(here)
    yield from _suggest_functions(symbols)
    if here.clause != "FROM":
        yield from _suggest_tables(symbols)


def _suggest_columns(here: CompletionContext, symbols: SymbolTable) -> Iterator[Suggestion]:
    for source in here.sources:
        found = dict.fromkeys(source.columns, "") or symbols.list_columns(source.origin)
        for name, about in found.items():
            yield Suggestion(name, 0, "column", f"{source.name}: {about}" if about else f"of {source.name}")


def _suggest_variables(here: CompletionContext, symbols: SymbolTable) -> Iterator[Suggestion]:
    yield from (Suggestion(name, 0, "variable", "of START WITH") for name in here.states)
    yield from (Suggestion(name, 0, "variable", about) for name, about in symbols.variables.items())


def _suggest_aliases(here: CompletionContext) -> Iterator[Suggestion]:
    yield from (Suggestion(one.name, 0, "table", f"source {one.origin}".rstrip()) for one in here.sources if one.name)


def _suggest_functions(symbols: SymbolTable) -> Iterator[Suggestion]:
    for entry in symbols.functions.values():
        yield Suggestion(f"{entry.name}(", 0, "function", entry.about, entry.call)


def _suggest_tables(symbols: SymbolTable) -> Iterator[Suggestion]:
    for name, about in symbols.tables.items():
        text, bracket, _ = name.partition("(")
        yield Suggestion(text + bracket, 0, "table", about, name)


def _suggest_members(here: CompletionContext, symbols: SymbolTable) -> Iterator[Suggestion]:
    """Suggestions after `owner.`: columns of a source, or tables of a world or file."""
    sources = [one for one in here.sources if one.name == here.owner]
    if here.owner.lower() == "this":
        sources = here.sources[:1]
    if here.clause != "FROM" or here.owner not in symbols.owners:
        for source in sources:
            found = dict.fromkeys(source.columns, "") or symbols.list_columns(source.origin)
            yield from (Suggestion(name, 0, "column", about) for name, about in found.items())
        if sources and here.owner.lower() != "this":
            yield Suggestion("this", 0, "keyword", f"the element of {here.owner}")
    if not sources or here.clause == "FROM":
        for table in symbols.owners.get(here.owner, ()):
            full = next((name for name in symbols.tables if name.partition("(")[0] == f"{here.owner}.{table}"), "")
            bracket = "(" if "(" in full else ""
            yield Suggestion(table + bracket, 0, "table", symbols.tables.get(full, ""), full.partition(".")[2] or table)


def _suggest_for_command(begun: str, symbols: SymbolTable) -> Iterator[Suggestion]:
    name, blank, rest = begun.partition(" ")
    if not blank:
        found = (Suggestion(one, 0, "command", entry.about) for one, entry in COMMANDS.items())
        yield from _filter_prefix(name, found)
        return
    command = COMMANDS.get(name)
    if command is None:
        return
    rest = rest.lstrip()
    match command.takes:
        case "setting":
            entry = SETTINGS[name[1:]]
            yield from _filter_prefix(rest, (Suggestion(choice, 0, "value") for choice in entry.choices))
        case "file":
            yield from _suggest_files(rest.rpartition(" ")[2])
        case "function":
            every = {**symbols.functions, **symbols.representations}
            yield from _filter_prefix(rest, (Suggestion(one, 0, "function", every[one].about) for one in every))
        case "table":
            names = dict.fromkeys([*symbols.owners, *(name.partition("(")[0] for name in symbols.tables)])
            yield from _filter_prefix(rest, (Suggestion(one, 0, "table", symbols.tables.get(one, "")) for one in names))
        case "variable" if " " not in rest:
            yield from _filter_prefix(rest, (Suggestion(one, 0, "variable", t) for one, t in symbols.variables.items()))
        case "help":
            every = {**symbols.functions, **symbols.representations}
            texts = {**{one: entry.about for one, entry in COMMANDS.items()},
                     **{word.text: word.about for word in keywords().values()},
                     **{one: every[one].about for one in every}}  # fmt: skip
            yield from _filter_prefix(rest, (Suggestion(one, 0, "value", text) for one, text in texts.items()))
        case _:
            return


def _suggest_files(begun: str) -> Iterator[Suggestion]:
    """Files and folders whose paths begin so."""
    folder, slash, name = begun.rpartition("/")
    try:
        found = sorted(Path(f"{folder}/" if slash else ".").expanduser().iterdir())
    except OSError:
        return
    for path in found:
        if path.name.startswith(name) and (name.startswith(".") or not path.name.startswith(".")):
            yield Suggestion(path.name + ("/" if path.is_dir() else ""), len(name), "value")
