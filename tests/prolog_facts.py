"""What a text of Prolog facts says, read by the rules of the ISO standard."""

from __future__ import annotations

import re
from typing import Any

TOKEN = re.compile(
    r"\s*(?:(?P<number>-?\d+(?:\.\d+(?:e[+-]\d+)?)?)|(?P<word>[a-z][A-Za-z0-9_]*)|(?P<mark>[][(),.-])"
    r"|'(?P<quoted>(?:[^'\\\n]|\\[\\'ntr]|\\x[0-9a-f]+\\)*)')"
)
ESCAPED = {"n": "\n", "t": "\t", "r": "\r"}

Tokens = list[tuple[str, str]]


def facts(text: str) -> list[tuple[Any, ...]]:
    """The facts in order, each a name and its arguments: atoms are strings, pairs tuples. Directives are left out."""
    return [fact(line) for line in text.splitlines() if not line.startswith(":- ")]


def fact(line: str) -> tuple[Any, ...]:
    end = 0
    tokens: Tokens = []
    while end < len(line):
        found = TOKEN.match(line, end)
        assert found, f"not Prolog: {line[end:]}"
        end = found.end()
        tokens.append((str(found.lastgroup), found[str(found.lastgroup)]))
    name = term(tokens)
    assert isinstance(name, str)
    arguments = terms(tokens, ")") if tokens.pop(0)[1] == "(" else None
    assert arguments is None or tokens.pop(0)[1] == "."
    assert not tokens
    return name, *(arguments or ())


def terms(tokens: Tokens, closing: str) -> list[Any]:
    """Terms and commas up to a bracket; what is read is taken away."""
    found = []
    while tokens[0] != ("mark", closing):
        found.append(term(tokens))
        assert tokens[0][1] in (",", closing)
        del tokens[: tokens[0][1] == ","]
    del tokens[0]
    return found


def term(tokens: Tokens) -> Any:
    kind, read = tokens.pop(0)
    value: Any = read
    match kind:
        case "number":
            value = float(read) if "." in read else int(read)
        case "quoted":
            value = re.sub(r"\\(?:x([0-9a-f]+)\\|(.))", unescaped, read)
        case "mark":
            assert read == "["
            value = terms(tokens, "]")
    if tokens[:1] == [("mark", "-")]:
        del tokens[:2]
        value = (value, *terms(tokens, ")"))
    return value


def unescaped(escape: re.Match[str]) -> str:
    return chr(int(escape[1], 16)) if escape[1] else ESCAPED.get(escape[2], escape[2])
