"""Colors of the input: names of the terminal's own colors, which suit light and dark ones."""

from __future__ import annotations

import re
from collections.abc import Iterator

from pygments.lexer import Lexer
from pygments.token import Generic, Keyword, Text
from pygments.token import _TokenType as Type

from ss2sql.editor.lexer import SelectScriptLexer
from ss2sql.shell.statement_splitter import split_statements

STYLE = {
    "pygments.keyword": "ansiblue bold",
    "pygments.keyword.constant": "ansicyan",
    "pygments.keyword.type": "ansicyan",
    "pygments.keyword.pseudo": "ansimagenta bold",
    "pygments.operator.word": "ansiblue bold",
    "pygments.name.builtin.pseudo": "ansicyan",
    "pygments.name.function": "ansigreen",
    "pygments.literal.string": "ansiyellow",
    "pygments.literal.number": "ansimagenta",
    "pygments.comment": "italic",
    "pygments.error": "ansired underline",
    "argument": "bold underline",
}
PROMPTS = ("ss> ", "..> ")


class ShellLexer(Lexer):
    """Statements as SelectScriptLexer colors them, and dot commands between them."""

    name = "ss2sql shell"

    def get_tokens_unprocessed(self, text: str) -> Iterator[tuple[int, Type, str]]:
        """Every token of the text with its place and its kind."""
        position = 0
        for piece in split_statements(text):
            if piece.is_command:
                yield from _color_statements(text[position : piece.start], position)
                name = piece.text.split()[0]
                yield piece.start, Keyword.Pseudo, name
                position = piece.start + len(name)
                if name not in (".sql", ".explain"):
                    yield position, Text, text[position : piece.end]
                    position = piece.end
        yield from _color_statements(text[position:], position)


class TranscriptLexer(Lexer):
    """A session of the shell: input after prompts, and output."""

    name = "ss2sql transcript"

    def get_tokens_unprocessed(self, text: str) -> Iterator[tuple[int, Type, str]]:
        """Every token of the text with its place and its kind. The lines of one input are colored together."""
        for part in re.finditer(r"(?:^(?:ss|\.\.)> .*\n?)+|(?:^(?!(?:ss|\.\.)> ).*\n?)+", text, re.MULTILINE):
            if not part[0].startswith(PROMPTS):
                yield part.start(), Generic.Output, part[0]
                continue
            lines = part[0].splitlines(keepends=True)
            found = ShellLexer().get_tokens_unprocessed("".join(line[4:] for line in lines))
            place, prompts = part.start(), [line[:4] for line in lines]
            starts = True  # whether a line of input starts here
            for _, kind, piece in found:
                for line in piece.splitlines(keepends=True):
                    if starts:
                        yield place, Generic.Prompt, prompts.pop(0)
                        place += 4
                    yield place, kind, line
                    place, starts = place + len(line), line.endswith("\n")
            yield place, Generic.Prompt, "".join(prompts)


def _color_statements(text: str, start: int) -> Iterator[tuple[int, Type, str]]:
    for position, kind, part in SelectScriptLexer().get_tokens_unprocessed(text):
        yield start + position, kind, part
