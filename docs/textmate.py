"""The TextMate grammar, for VS Code, Sublime Text, GitHub and others that read such grammars.

`docs/generate.py` writes it; a test compares the file with the output. Regular expressions cannot
decide where a word is a keyword: words that may be names count as keywords unless a `=`, or immediately a `.`, `[` or
`{` follows, and pairs of words only together.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ss2sql.editor import keywords as table
from ss2sql.editor.keywords import Keyword, keywords

FILE = Path(table.__file__).with_name("selectscript.tmLanguage.json")
_SCOPES = {
    "clause": "keyword.control.clause", "option": "keyword.other.option", "operator": "keyword.operator.word",
    "constant": "constant.language", "other": "keyword.control",
}  # fmt: skip


def build_grammar() -> dict[str, Any]:
    """The grammar as JSON data."""
    return {
        "$schema": "https://raw.githubusercontent.com/martinring/tmlanguage/master/tmlanguage.json",
        "name": "SelectScript",
        "scopeName": "source.selectscript",
        "fileTypes": ["ss"],
        "patterns": [*_match_comments(), *_match_strings(), *_match_numbers(), *_match_keywords(), *_match_others()],
    }


def format_grammar() -> str:
    return json.dumps(build_grammar(), indent=2, ensure_ascii=False) + "\n"


def _name_textmate_scope(name: str) -> str:
    return f"{name}.selectscript"


def _match_comments() -> list[dict[str, Any]]:
    return [
        {"name": _name_textmate_scope("comment.line.number-sign"), "match": "#.*$"},
        {"name": _name_textmate_scope("comment.line.double-dash"), "match": r"--(?:\s.*)?$"},
        {"name": _name_textmate_scope("comment.block"), "begin": r"/\*", "end": r"\*/"},
    ]


def _match_strings() -> list[dict[str, Any]]:
    return [_match_string('"', "double"), _match_string("'", "single")]


def _match_string(quote: str, name: str) -> dict[str, Any]:
    """A string ends with its quote, or with a line without a backslash at its end."""
    escape = r"\\(?:x\h{2}|u\h{4}|U\h{8}|N\{[^}]*\}|.|$)"
    return {
        "name": _name_textmate_scope(f"string.quoted.{name}"),
        "begin": quote,
        "end": rf"{quote}|(?<!\\)$",
        "patterns": [{"name": _name_textmate_scope("constant.character.escape"), "match": escape}],
    }


def _match_numbers() -> list[dict[str, Any]]:
    point = r"(?:[0-9]+\.[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?|[0-9]+[eE][+-]?[0-9]+"
    return [
        {"name": _name_textmate_scope("constant.numeric.float"), "match": rf"(?<!\w)(?:{point})"},
        {"name": _name_textmate_scope("constant.numeric.integer"), "match": r"(?<!\w)[0-9]+"},
    ]


def _match_keywords() -> list[dict[str, Any]]:
    found = [{"name": _name_textmate_scope("support.type.representation"),
              "match": rf"(?i)(?<=\b{keywords()['AS'].text}\s)\s*[^\W\d]\w*"}]  # fmt: skip
    for reserved in (True, False):
        ahead, following = (r"(?<!\w)", "") if reserved else (r"(?<![\w.])", r"(?![.\[{]|\s*=(?!=))")
        for sort, scope in _SCOPES.items():
            selected = [word for word in keywords().values() if word.sort == sort and word.reserved == reserved]
            if selected:
                found.append(
                    {
                        "name": _name_textmate_scope(scope),
                        "match": rf"(?i){ahead}(?:{_join_keywords(selected)})(?!\w){following}",
                    }
                )
    return found


def _join_keywords(selected: Iterable[Keyword]) -> str:
    """One of the keywords. ORDER comes before SIBLINGS BY, too."""
    texts = [word.text.replace(" ", r"\s+") for word in selected]
    return "|".join(r"ORDER(?=\s+SIBLINGS)|" + text if text.startswith("ORDER") else text for text in texts)


def _match_others() -> list[dict[str, Any]]:
    return [
        {"name": _name_textmate_scope("entity.name.function"), "match": r"[^\W\d]\w*(?=\s*\()"},
        {"name": _name_textmate_scope("variable.other"), "match": r"[^\W\d]\w*"},
        {"name": _name_textmate_scope("keyword.operator"), "match": r"==|!=|<>|<=|>=|[-+*/%^=<>]"},
        {"name": _name_textmate_scope("punctuation"), "match": r"[()\[\]{},;:.]"},
    ]
