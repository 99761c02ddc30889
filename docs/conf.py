"""How Sphinx builds the documentation: MyST pages, the furo theme, and colours for SelectScript."""

import sys
from importlib import metadata
from pathlib import Path
from typing import Any

from docutils import nodes

from ss2sql.editor.lexer import BoundSqlLexer, SelectScriptLexer

project = "ss2sql"
author = "the ss2sql authors"
project_copyright = "2026, the ss2sql authors"
release = metadata.version("ss2sql")

sys.path.insert(0, str(Path(__file__).parent))
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode", "sphinx_copybutton",
              "railroad", "notebooks"]  # fmt: skip
source_suffix = {".md": "markdown"}
exclude_patterns = ["_build"]
myst_heading_anchors = 3
default_role = "code"  # of single backticks in docstrings
html_theme = "furo"
html_static_path = ["_static"]
html_css_files = ["pages.css"]
html_js_files = ["code.js"]
copybutton_prompt_text = r"\$ |ss> |\.\.> "  # only what is typed is copied
copybutton_prompt_is_regexp = True
html_title = f"ss2sql {release}"
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_class_signature = "separated"
autodoc_typehints_format = "short"


# Lines on white ground; pages.css shows them so that they suit the dark theme. All other pictures are scenes.
PLOTS = ("images/plots/", "images/roads.png", "images/watching.png", "benchmarks.png")


def mark_plots(_app: Any, tree: nodes.document) -> None:
    """Gives pictures of lines the class `plot`."""
    for image in tree.findall(nodes.image):
        if any(part in image["uri"] for part in PLOTS):
            image["classes"].append("plot")


def setup(app: Any) -> None:
    from transcripts import TranscriptLexer  # beside this file

    app.connect("doctree-read", mark_plots)
    app.add_lexer("selectscript", SelectScriptLexer)
    app.add_lexer("ss2sql", TranscriptLexer)
    app.add_lexer("sql", BoundSqlLexer)
