"""SelectScript for Pygments: the tokens of the language itself, as colours."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import ClassVar

from pygments.lexer import Lexer
from pygments.token import Comment, Error, Keyword, Name, Number, Operator, Punctuation, String, Text, Whitespace
from pygments.token import _TokenType as Type

from ss2sql.editor.keywords import find_comments, keywords, list_words, mark_keywords
from ss2sql.frontend.syntax.tokenizer import Token

_KINDS: dict[str, Type] = {
    "INTEGER": Number.Integer, "FLOAT": Number.Float, "STRING": String, "OPEN_STRING": String,
    "OPEN_COMMENT": Comment.Multiline, "BAD_NUMBER": Error, "OTHER": Error, "THIS": Name.Builtin.Pseudo,
}  # fmt: skip
_SORTS = {"constant": Keyword.Constant, "operator": Operator.Word}
_PUNCTUATION = frozenset("()[]{},;:.")


class SelectScriptLexer(Lexer):
    """Colours for Pygments, under the names `selectscript` and `ss` and for files `*.ss`."""

    name = "SelectScript"
    url = "https://pypi.org/project/ss2sql/"
    aliases: ClassVar = ["selectscript", "ss"]
    filenames: ClassVar = ["*.ss"]
    mimetypes: ClassVar = ["text/x-selectscript"]

    def get_tokens_unprocessed(self, text: str) -> Iterator[tuple[int, Type, str]]:
        """Every token of the text with its place and its kind."""
        position = 0
        tokens = mark_keywords(text)
        for index, token in enumerate(tokens):
            yield from _split_comments(text, position, token.start)
            yield token.start, _choose_token_type(tokens, index), text[token.start : token.end]
            position = token.end
        yield from _split_comments(text, position, len(text))

    @staticmethod
    def analyse_text(text: str) -> float:
        """How likely a text is SelectScript; Scheme has files of the same ending."""
        if re.search(r"\b(START|STOP)\s+WITH\b|\bAS\s+(dict|list|rows|value|set|void)\b", text, re.IGNORECASE):
            return 0.9
        return 0.6 if re.search(r"\bSELECT\b.*\bFROM\b", text, re.IGNORECASE | re.DOTALL) else 0.0


def _choose_token_type(tokens: list[Token], index: int) -> Type:
    token = tokens[index]
    kind = token.kind
    if kind in _KINDS:
        return _KINDS[kind]
    if kind in list_words():
        keyword = keywords().get(kind)
        return Keyword if keyword is None else _SORTS.get(keyword.sort, Keyword)
    if kind != "NAME":
        return Punctuation if kind in _PUNCTUATION else Operator
    ahead = tokens[index - 1].kind if index else ""
    if ahead == "AS":
        return Keyword.Type
    if index + 1 < len(tokens) and tokens[index + 1].kind == "(":
        return Name.Function
    return Name.Attribute if ahead == "." else Name


def _split_comments(text: str, start: int, end: int) -> Iterator[tuple[int, Type, str]]:
    for begin, stop in find_comments(text, start, end):
        if begin > start:
            yield start, Whitespace, text[start:begin]
        yield begin, Comment.Single if text[begin] in "#-" else Comment.Multiline, text[begin:stop]
        start = stop
    if end > start:
        yield start, Text if text[start] == "\ufeff" else Whitespace, text[start:end]
