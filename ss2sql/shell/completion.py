"""Completions at the cursor: keywords that the grammar accepts there, and names that are visible.

The grammar's own automaton runs over the statement up to the cursor and gives the tokens that fit. Names come from the
whole statement, since FROM follows the columns, its inner queries included.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import field
from itertools import pairwise
from pathlib import Path
from typing import Literal, TypeAlias

from ss2sql.editor.keywords import ONE_OF, Keyword, keywords, list_words, mark_keywords
from ss2sql.errors import ParseError, Source
from ss2sql.fast_dataclasses import dataclass
from ss2sql.frontend.syntax import tokenizer
from ss2sql.frontend.syntax.parse_failure import ParseFailure
from ss2sql.frontend.syntax.parser import run_automaton
from ss2sql.frontend.syntax.tokenizer import CLOSING, OPENING, Token
from ss2sql.frontend.syntax.tree_builder import Builder
from ss2sql.session.descriptions import FunctionAbout
from ss2sql.shell.dot_commands import COMMANDS, SETTINGS
from ss2sql.shell.statement_splitter import find_statement_at
from ss2sql.shell.symbols import SymbolTable


@dataclass(slots=True)
class CompletionContext:
    """The context of the cursor."""

    word: str = ""  # the beginning of the word at the cursor
    owner: str = ""  # the name before its dot
    in_string: bool = False
    expected: frozenset[str] | None = None  # tokens that the grammar accepts; None: the text before does not fit it
    clause: str = ""  # the current clause, as errors name it
    after: str = ""
    seen: tuple[str, ...] = ()  # the keywords of this query before the cursor
    sources: dict[str, str] = field(default_factory=dict)  # what may be one: its name, and a table's or variable's name
    assigned: tuple[str, ...] = ()  # names before =

    @property
    def wants_value(self) -> bool:
        """Whether an expression could begin here."""
        return self.expected is None or {"NAME", "INTEGER"} <= self.expected


def find_context(statement: str, cursor: int) -> CompletionContext:
    """The context of a position in a statement."""
    before = list(tokenizer.iterate_tokens(statement[:cursor]))
    if _is_cursor_in_string(before, statement, cursor):
        return CompletionContext(in_string=True)
    found = CompletionContext()
    if before and before[-1].end == cursor and (before[-1].kind == "NAME" or before[-1].kind in list_words()):
        found.word = before.pop().text
    if before and before[-1].kind == ".":
        found.owner = before[-2].text if len(before) > 1 and before[-2].kind in ("NAME", "THIS") else "?"
    found.after = (before[-1].keyword or before[-1].kind) if before else ""
    _find_completable_tokens(found, statement[: before[-1].end if before else 0])
    tokens = mark_keywords(statement)
    found.seen = tuple(_list_query_words([token for token in tokens if token.start < cursor - len(found.word)]))
    found.sources = _find_typed_sources(tokens)
    pairs = pairwise(tokens)
    found.assigned = tuple(one.text for one, other in pairs if (one.kind, other.kind) == ("NAME", "="))
    return found


def _is_cursor_in_string(before: Sequence[Token], statement: str, cursor: int) -> bool:
    """Whether the cursor is in a string or a comment, or after a number that may continue."""
    if before and before[-1].kind in ("OPEN_STRING", "OPEN_COMMENT", "BAD_NUMBER"):
        return True
    if before and before[-1].kind in ("INTEGER", "FLOAT") and before[-1].end == cursor:
        return True
    line = statement.rfind("\n", 0, cursor) + 1
    start = max(line, before[-1].end if before else 0)
    return bool(re.search(tokenizer.COMMENT, statement[start:cursor]))


def _find_completable_tokens(found: CompletionContext, before: str) -> None:
    source = Source(before)
    try:
        tokens = tokenizer.tokenize(source)
    except ParseError:
        return
    outcome = run_automaton(Builder(source), tokens, 0, len(tokens) - 1)
    if isinstance(outcome, ParseFailure) and outcome.index == len(tokens) - 1:
        found.expected, found.clause = outcome.expected, outcome.clause


def _list_query_words(before: Sequence[Token]) -> Iterator[str]:
    """The keywords of the query that the cursor is in, from the last one back to its SELECT."""
    depth = 0
    for token in reversed(before):
        depth += (token.kind in CLOSING) - (token.kind in OPENING)
        if depth < 0:
            return
        if depth == 0 and token.kind in list_words():
            yield token.kind
            if token.kind == "SELECT":
                return


def _find_typed_sources(tokens: Sequence[Token]) -> dict[str, str]:
    """The names that may be sources, wherever they stand: `people`, `p = people`, `work.staff`."""
    found: dict[str, str] = {}
    kinds, texts = [token.kind for token in tokens], [token.text for token in tokens]
    for index, kind in enumerate(kinds):
        if kind == "NAME" and kinds[index - 1 : index] != ["."]:
            dotted = kinds[index + 1 : index + 3] == [".", "NAME"]
            origin = f"{texts[index]}.{texts[index + 2]}" if dotted else texts[index]
            if kinds[max(index - 2, 0) : index] == ["NAME", "="]:
                found[texts[index - 2]] = origin
            elif kinds[index + 1 : index + 2] != ["="]:
                found.setdefault(origin.rpartition(".")[2], origin)
    return found


Kind: TypeAlias = Literal["keyword", "function", "variable", "table", "column", "representation", "command", "value"]

SORTS = ("clause", "option", "other", "operator", "constant")  # the order of keywords in lists


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
        return list(_complete_statement(text[start : piece.end], cursor - start, symbols))
    if not text[piece.start : cursor].strip("."):
        dots = cursor - piece.start
        first = [] if dots else _complete_statement("", 0, symbols)
        return [*(Suggestion(name, dots, "command", entry.about) for name, entry in COMMANDS.items() if dots), *first]
    return list(_complete_statement(text[piece.start : max(piece.end, cursor)], cursor - piece.start, symbols))


def find_signature_at_cursor(text: str, cursor: int, symbols: SymbolTable) -> tuple[FunctionAbout, int] | None:
    """The function or representation of the innermost call around the cursor, and which argument is being written."""
    tokens = list(tokenizer.iterate_tokens(text[find_statement_at(text, cursor).start : cursor]))
    depth = commas = 0
    for index in range(len(tokens) - 1, -1, -1):
        kind = tokens[index].kind
        if depth == 0 and kind in OPENING:
            if kind == "(" and index and tokens[index - 1].kind == "NAME":
                name, after_as = tokens[index - 1].text, index > 1 and tokens[index - 2].kind == "AS"
                found = symbols.representations.get(name.lower()) if after_as else symbols.functions.get(name)
                return None if found is None else (found, commas)
            commas = 0
        elif depth == 0 and kind == ",":
            commas += 1
        else:
            depth += (kind in CLOSING) - (kind in OPENING)
    return None


def _complete_statement(statement: str, cursor: int, symbols: SymbolTable) -> Iterable[Suggestion]:
    here = find_context(statement, cursor)
    if here.in_string:
        return []
    if here.owner or here.after == ".":
        return _filter_prefix(here.word, _complete_members(here, symbols))
    words = list(_filter_prefix(here.word, _complete_keywords(here)))
    names = list(_filter_prefix(here.word, _complete_names(here, symbols)))
    first = here.word.isupper() or not here.wants_value or not here.after
    return [*words, *names] if first else [*names, *words]


def _filter_prefix(word: str, found: Iterable[Suggestion]) -> Iterator[Suggestion]:
    """Suggestions that begin with the word in any case, each once, without the word itself."""
    written = set()
    for one in found:
        if one.text.lower().startswith(word.lower()) and one.text != word and one.text not in written:
            written.add(one.text)
            yield Suggestion(one.text, len(word), one.kind, one.about, one.shown)


def _complete_keywords(here: CompletionContext) -> Iterator[Suggestion]:
    for word, keyword in sorted(keywords().items(), key=lambda item: SORTS.index(item[1].sort)):
        if (here.expected is None or word in here.expected) and not _is_clause_typed_already(word, keyword, here.seen):
            text = f"{keyword.text}(" if word == "IF" else keyword.text
            yield Suggestion(text, 0, "keyword", keyword.about, keyword.text)
    for keyword in keywords().values():  # the second of two words
        first, _, second = keyword.text.partition(" ")
        if second and here.after == first and (here.expected is None or second in here.expected):
            yield Suggestion(second, 0, "keyword", keyword.about)


def _is_clause_typed_already(word: str, keyword: Keyword, written: tuple[str, ...]) -> bool:
    """Whether this query cannot have the clause or option (again)."""
    if keyword.sort == "option":
        others = [text.split()[0] for group in ONE_OF if keyword.text in group for text in group]
        return word in written or any(other in written for other in others)
    if word == "STOP":
        return "CONNECT" not in written
    return word in ("GROUP", "ORDER", "LIMIT") and word in written


def _complete_names(here: CompletionContext, symbols: SymbolTable) -> Iterator[Suggestion]:
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
            yield from (Suggestion(name, 0, "variable", "of this statement") for name in here.assigned)
        return
    if here.clause == "FROM":
        yield from _complete_tables(symbols)
        yield from _complete_variables(here, symbols)
    else:
        yield from _complete_columns(here, symbols)
        yield from _complete_variables(here, symbols)
    for entry in symbols.functions.values():
        yield Suggestion(f"{entry.name}(", 0, "function", entry.about, entry.call)
    if here.clause != "FROM":
        yield from _complete_tables(symbols)


def _complete_columns(here: CompletionContext, symbols: SymbolTable) -> Iterator[Suggestion]:
    for source, origin in here.sources.items():
        for name, about in symbols.list_columns(origin).items():
            yield Suggestion(name, 0, "column", f"{source}: {about}" if about else f"of {source}")


def _complete_variables(here: CompletionContext, symbols: SymbolTable) -> Iterator[Suggestion]:
    yield from (Suggestion(name, 0, "variable", "of this statement") for name in here.assigned)
    yield from (Suggestion(name, 0, "variable", about) for name, about in symbols.variables.items())


def _complete_tables(symbols: SymbolTable) -> Iterator[Suggestion]:
    for name, about in symbols.tables.items():
        text, bracket, _ = name.partition("(")
        yield Suggestion(text + bracket, 0, "table", about, name)


def _complete_members(here: CompletionContext, symbols: SymbolTable) -> Iterator[Suggestion]:
    """Suggestions after `owner.`: tables of a world or file, or columns of a source."""
    if here.clause == "FROM" and here.owner in symbols.owners:
        for table in symbols.owners[here.owner]:
            full = next((name for name in symbols.tables if name.partition("(")[0] == f"{here.owner}.{table}"), "")
            bracket = "(" if "(" in full else ""
            yield Suggestion(table + bracket, 0, "table", symbols.tables.get(full, ""), full.partition(".")[2] or table)
    elif here.owner.lower() == "this":
        yield from _complete_columns(here, symbols)
    elif here.owner in here.sources:
        found = symbols.list_columns(here.sources[here.owner])
        yield from (Suggestion(name, 0, "column", about) for name, about in found.items())
        yield Suggestion("this", 0, "keyword", f"the element of {here.owner}")


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
    functions = {one: entry.about for one, entry in {**symbols.functions, **symbols.representations}.items()}
    kind: Kind = "value"
    texts: Mapping[str, str] = {}
    match command.takes:
        case "setting":
            texts = dict.fromkeys(SETTINGS[name[1:]].choices, "")
        case "file":
            yield from _complete_files(rest.rpartition(" ")[2])
        case "function":
            kind, texts = "function", functions
        case "table":
            names = [*symbols.owners, *(name.partition("(")[0] for name in symbols.tables)]
            kind, texts = "table", {one: symbols.tables.get(one, "") for one in names}
        case "variable" if " " not in rest:
            kind, texts = "variable", symbols.variables
        case "help":
            texts = {**{one: entry.about for one, entry in COMMANDS.items()},
                     **{word.text: word.about for word in keywords().values()}, **functions}  # fmt: skip
    yield from _filter_prefix(rest, (Suggestion(one, 0, kind, text) for one, text in texts.items()))


def _complete_files(begun: str) -> Iterator[Suggestion]:
    """Files and folders whose paths begin so."""
    folder, slash, name = begun.rpartition("/")
    try:
        found = sorted(Path(f"{folder}/" if slash else ".").expanduser().iterdir())
    except OSError:
        return
    for path in found:
        if path.name.startswith(name) and (name.startswith(".") or not path.name.startswith(".")):
            yield Suggestion(path.name + ("/" if path.is_dir() else ""), len(name), "value")
