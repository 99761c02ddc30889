"""How Sphinx builds the documentation: MyST pages, the furo theme, and colours for SelectScript."""

import sys
from importlib import metadata
from pathlib import Path
from typing import Any

from ss2sql.editor.lexer import SelectScriptLexer
from ss2sql.editor.sql import BoundSqlLexer
from ss2sql.shell.colors import TranscriptLexer

project = "ss2sql"
author = "the ss2sql authors"
project_copyright = "2026, the ss2sql authors"
release = metadata.version("ss2sql")

sys.path.insert(0, str(Path(__file__).parent))
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "railroad", "notebooks"]
source_suffix = {".md": "markdown"}
exclude_patterns = ["_build"]
myst_heading_anchors = 3
default_role = "code"  # of single backticks in docstrings
html_theme = "furo"
html_static_path = ["_static"]
html_css_files = ["pages.css"]
html_title = f"ss2sql {release}"
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_class_signature = "separated"
autodoc_typehints_format = "short"


def setup(app: Any) -> None:
    app.add_lexer("selectscript", SelectScriptLexer)
    app.add_lexer("ss2sql", TranscriptLexer)
    app.add_lexer("sql", BoundSqlLexer)
