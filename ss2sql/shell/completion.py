"""Completions at the cursor: keywords that the grammar accepts there, and names that are visible.

The grammar's own automaton runs over the statement up to the cursor and gives the tokens that fit. Names come from the
whole statement, since FROM follows the columns.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import field
from pathlib import Path
from typing import Literal, TypeAlias

from ss2sql.editor.keywords import ONE_OF, Keyword, keywords, list_words, mark_keywords
from ss2sql.errors import ParseError, Source
from ss2sql.fast_dataclasses import dataclass
from ss2sql.frontend.syntax import tokenizer
from ss2sql.frontend.syntax.parse_failure import CLAUSES, ParseFailure
from ss2sql.frontend.syntax.parse_table import load_parse_table
from ss2sql.frontend.syntax.parser import run_automaton
from ss2sql.frontend.syntax.tokenizer import CLOSING, OPENING, Token
from ss2sql.frontend.syntax.tree_builder import Builder
from ss2sql.shell.dot_commands import COMMANDS, SETTINGS
from ss2sql.shell.statement_splitter import find_statement_at
from ss2sql.shell.symbols import Function, SymbolTable


@dataclass(frozen=True, slots=True)
class SourceName:
    """A source of FROM: its name in the query, and its origin: a table's or variable's name, or a query's columns."""

    name: str
    origin: str
    columns: tuple[str, ...] = ()


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
    sources: list[SourceName] = field(default_factory=list)
    states: list[str] = field(default_factory=list)

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
    _collect_names_at_cursor(found, statement, cursor)
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
    outcome = run_automaton(load_parse_table(), Builder(source), tokens, 0, len(tokens) - 1)
    if isinstance(outcome, ParseFailure) and outcome.index == len(tokens) - 1:
        found.expected, found.clause = outcome.expected, outcome.clause


def _collect_names_at_cursor(found: CompletionContext, statement: str, cursor: int) -> None:
    tokens = mark_keywords(statement)
    groups = _find_brackets_at_cursor(tokens)
    around = _list_brackets_at_cursor(tokens, cursor)
    start = cursor - len(found.word)
    own = [token for token, group in zip(tokens, groups, strict=True) if group == around[-1]]
    begun = max((token.start for token in own if token.kind == "SELECT" and token.start < start), default=-1)
    found.seen = tuple(token.kind for token in own if begun <= token.start < start and token.kind in list_words())
    for group in reversed(around):  # the innermost query first
        for index, token in enumerate(tokens):
            if groups[index] == group and token.kind == "FROM":
                found.sources += _find_typed_sources(tokens, groups, index)
            elif groups[index] == group and token.kind == "START":
                found.states += _find_typed_variables(tokens, groups, index)


def _find_brackets_at_cursor(tokens: Sequence[Token]) -> list[int]:
    """For each token the index of the bracket around it, or -1; a bracket is outside of itself."""
    groups: list[int] = []
    stack = [-1]
    for index, token in enumerate(tokens):
        if token.kind in CLOSING and len(stack) > 1:
            stack.pop()
        groups.append(stack[-1])
        if token.kind in OPENING:
            stack.append(index)
    return groups


def _list_brackets_at_cursor(tokens: Sequence[Token], cursor: int) -> list[int]:
    """The indices of the brackets around the cursor, the outermost first, after a -1."""
    stack = [-1]
    for index, token in enumerate(tokens):
        if token.start >= cursor:
            break
        if token.kind in OPENING:
            stack.append(index)
        elif token.kind in CLOSING and len(stack) > 1:
            stack.pop()
    return stack


def _split_typed_clause(
    tokens: Sequence[Token], groups: Sequence[int], start: int, group: int, ends: Sequence[str] = CLAUSES
) -> list[list[int]]:
    """The parts between the commas of a clause from `start` on: indices of tokens, without the inside of brackets."""
    found: list[list[int]] = [[]]
    for index in range(start, len(tokens)):
        kind = tokens[index].kind
        if groups[index] < group or (groups[index] == group and (kind in ends or kind == ";")):
            break
        if groups[index] == group and kind in (",", "JOIN"):
            found.append([])
        elif groups[index] == group:
            found[-1].append(index)
    return [part for part in found if part]


def _find_typed_sources(tokens: Sequence[Token], groups: Sequence[int], place: int) -> list[SourceName]:
    found = []
    for part in _split_typed_clause(tokens, groups, place + 1, groups[place]):
        kinds = [tokens[index].kind for index in part]
        named = kinds[:2] == ["NAME", "="]
        name = tokens[part[0]].text if kinds[0] == "NAME" else ""
        rest = part[2:] if named else part
        words_of_rest = [tokens[index].text for index in rest]
        kinds = kinds[2:] if named else kinds
        if kinds[:3] == ["NAME", ".", "NAME"]:
            found.append(SourceName(name if named else words_of_rest[2], ".".join(words_of_rest[::2][:2])))
        elif kinds[:1] == ["NAME"]:
            found.append(SourceName(name, words_of_rest[0]))
        elif kinds[:1] == ["("]:
            found.append(SourceName(name, "", _find_typed_columns(tokens, groups, rest[0])))
        elif named:
            found.append(SourceName(name, ""))
    return found


def _find_typed_columns(tokens: Sequence[Token], groups: Sequence[int], bracket: int) -> tuple[str, ...]:
    """The names of the columns of a query in parentheses, as far as they are written."""
    if bracket + 1 >= len(tokens) or tokens[bracket + 1].kind != "SELECT":
        return ()
    found = []
    for part in _split_typed_clause(tokens, groups, bracket + 2, bracket, ("FROM",)):
        kinds = [tokens[index].kind for index in part]
        if kinds[-2:] == ["AS", "NAME"] or kinds == ["NAME"] or kinds == ["NAME", ".", "NAME"]:
            found.append(tokens[part[-1]].text)
        elif kinds[:3] == ["NAME", "(", ")"]:
            naming = tokens[part[0]].text == "to" and tokens[part[-1] - 1].kind == "NAME"
            found.append(tokens[part[-1] - 1].text if naming else tokens[part[0]].text)
    return tuple(found)


def _find_typed_variables(tokens: Sequence[Token], groups: Sequence[int], place: int) -> list[str]:
    """The names that START WITH at an index assigns to; its `WITH` may be missing."""
    start = place + 2 if place + 1 < len(tokens) and tokens[place + 1].kind == "WITH" else place + 1
    parts = _split_typed_clause(tokens, groups, start, groups[place])
    return [tokens[part[0]].text for part in parts if [tokens[index].kind for index in part[:2]] == ["NAME", "="]]


@dataclass(frozen=True, slots=True)
class OpenCall:
    """The call around the cursor: its name, the number of the current argument, whether it follows AS."""

    name: str
    argument: int
    is_representation: bool


def find_call_at_cursor(statement: str, cursor: int) -> OpenCall | None:
    """The innermost call around a position of a statement."""
    tokens = list(tokenizer.iterate_tokens(statement[:cursor]))
    for bracket in reversed(_list_brackets_at_cursor(tokens, cursor + 1)[1:]):
        ahead = tokens[bracket - 1] if bracket else None
        if tokens[bracket].kind != "(" or ahead is None or ahead.kind != "NAME":
            continue
        groups = _find_brackets_at_cursor(tokens)
        commas = sum(token.kind == "," and group == bracket for token, group in zip(tokens, groups, strict=True))
        return OpenCall(ahead.text, commas, bracket > 1 and tokens[bracket - 2].kind == "AS")
    return None


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
        return list(_complete_statement(text[start : piece.end], cursor - start, symbols))
    if not text[piece.start : cursor].strip("."):
        dots = cursor - piece.start
        first = [] if dots else _complete_statement("", 0, symbols)
        return [*(Suggestion(name, dots, "command", entry.about) for name, entry in COMMANDS.items() if dots), *first]
    return list(_complete_statement(text[piece.start : max(piece.end, cursor)], cursor - piece.start, symbols))


def find_signature_at_cursor(text: str, cursor: int, symbols: SymbolTable) -> tuple[Function, int] | None:
    """The function or representation whose call the cursor is in, and which argument is being written."""
    piece = find_statement_at(text, cursor)
    call = find_call_at_cursor(text[piece.start : cursor], cursor - piece.start)
    if call is None:
        return None
    found = (
        symbols.representations.get(call.name.lower()) if call.is_representation else symbols.functions.get(call.name)
    )
    return None if found is None else (found, call.argument)


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
    if word in IN_ORDER:
        later = IN_ORDER[IN_ORDER.index(word) :] + ANY_ORDER
        return any(clause in written for clause in later) or (word == "STOP" and "CONNECT" not in written)
    return word in ANY_ORDER and word in written


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
            yield from (Suggestion(name, 0, "variable", "of START WITH") for name in here.states)
        return
    if here.clause == "FROM":
        yield from _complete_tables(symbols)
        yield from _complete_variables(here, symbols)
    else:
        yield from _complete_columns(here, symbols)
        yield from _complete_variables(here, symbols)
        named = (one for one in here.sources if one.name)
        yield from (Suggestion(one.name, 0, "table", f"source {one.origin}".rstrip()) for one in named)
    yield from _complete_functions(symbols)
    if here.clause != "FROM":
        yield from _complete_tables(symbols)


def _complete_columns(here: CompletionContext, symbols: SymbolTable) -> Iterator[Suggestion]:
    for source in here.sources:
        found = dict.fromkeys(source.columns, "") or symbols.list_columns(source.origin)
        for name, about in found.items():
            yield Suggestion(name, 0, "column", f"{source.name}: {about}" if about else f"of {source.name}")


def _complete_variables(here: CompletionContext, symbols: SymbolTable) -> Iterator[Suggestion]:
    yield from (Suggestion(name, 0, "variable", "of START WITH") for name in here.states)
    yield from (Suggestion(name, 0, "variable", about) for name, about in symbols.variables.items())


def _complete_functions(symbols: SymbolTable) -> Iterator[Suggestion]:
    for entry in symbols.functions.values():
        yield Suggestion(f"{entry.name}(", 0, "function", entry.about, entry.call)


def _complete_tables(symbols: SymbolTable) -> Iterator[Suggestion]:
    for name, about in symbols.tables.items():
        text, bracket, _ = name.partition("(")
        yield Suggestion(text + bracket, 0, "table", about, name)


def _complete_members(here: CompletionContext, symbols: SymbolTable) -> Iterator[Suggestion]:
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
            yield from _complete_files(rest.rpartition(" ")[2])
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
