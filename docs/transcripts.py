"""The colors of transcripts: sessions of the shell, as pages show them."""

from __future__ import annotations

import re
from collections.abc import Iterator

from pygments.lexer import Lexer
from pygments.token import Generic
from pygments.token import _TokenType as Type

from ss2sql.shell.terminal import PROMPTS, ShellLexer


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
