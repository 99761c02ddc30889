"""How Sphinx builds the documentation: MyST pages, the furo theme, and colours for SelectScript."""

import re
from importlib import metadata
from typing import Any

from pygments.lexer import RegexLexer, words
from pygments.token import Comment, Keyword, Name, Number, Operator, Punctuation, String, Text

project = "ss2sql"
author = "the ss2sql authors"
project_copyright = "2026, the ss2sql authors"
release = metadata.version("ss2sql")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
source_suffix = {".md": "markdown"}
exclude_patterns = ["_build"]
myst_heading_anchors = 3
html_theme = "furo"
html_title = f"ss2sql {release}"
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_class_signature = "separated"
autodoc_typehints_format = "short"

KEYWORDS = """SELECT FROM AS IF AND OR XOR NOT IN WHERE START CONNECT BY STOP WITH GROUP HAVING ORDER LIMIT ASC DESC NO
CYCLE UNIQUE MEMORIZE MAXIMUM COST HEURISTIC PROBABILITY DEPTH BREADTH FIRST"""


class SelectScriptLexer(RegexLexer):
    """Colours only; the language itself is in ss2sql/frontend."""

    name = "SelectScript"
    aliases = ("selectscript",)
    flags = re.IGNORECASE | re.MULTILINE
    tokens = {  # noqa: RUF012 - pygments reads it from the class
        "root": [
            (r"\s+", Text),
            (r"#.*?$", Comment.Single),
            (r"/\*(.|\n)*?\*/", Comment.Multiline),
            (r"'(\\.|[^'\\])*'|\"(\\.|[^\"\\])*\"", String),
            (r"\d+\.?\d*(e[+-]?\d+)?|\.\d+", Number),
            (words(KEYWORDS.split(), prefix=r"\b", suffix=r"\b"), Keyword),
            (r"\b(this|True|False|None)\b", Keyword.Constant),
            (r"[A-Za-z_]\w*(?=\s*\()", Name.Function),
            (r"[A-Za-z_]\w*", Name),
            (r"[-+*/%^=!<>]+", Operator),
            (r"[][(){},;.:]", Punctuation),
        ]
    }


def setup(app: Any) -> None:
    app.add_lexer("selectscript", SelectScriptLexer)
