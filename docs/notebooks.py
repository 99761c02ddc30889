"""Notebooks as pages: `<!-- notebook: FILE -->` in a page becomes the cells of the notebook and what they show."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

MARK = re.compile(r"<!-- notebook: (\S+) -->")
COLOURS = re.compile(r"\x1b\[[\d;]*m")


def setup(app: Any) -> dict[str, bool]:
    app.connect("source-read", _with_cells)
    return {"parallel_read_safe": True}


def _with_cells(app: Any, page: str, source: list[str]) -> None:
    folder = Path(app.srcdir) / Path(page).parent

    def cells(mark: re.Match[str]) -> str:
        app.env.note_dependency(str(folder / mark[1]))
        return markdown(json.loads((folder / mark[1]).read_text("utf-8")))

    source[0] = MARK.sub(cells, source[0])


def markdown(notebook: dict[str, Any]) -> str:
    """The cells as a page, without the title, which the page has already."""
    parts = []
    for cell in notebook["cells"]:
        text = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(re.sub(r"\A# .*\n", "", text))
            continue
        parts.append(_fenced("selectscript" if text.startswith("%%ss") else "python", text))
        parts += [shown for output in cell["outputs"] for shown in _shown(output)]
    return "\n\n".join(parts)


def _shown(output: dict[str, Any]) -> Iterator[str]:
    if output["output_type"] == "stream":
        yield _fenced("text", "".join(output["text"]))
    elif output["output_type"] == "error":
        yield _fenced("text", COLOURS.sub("", "\n".join(output["traceback"])))
    elif "image/png" in output["data"]:
        picture = "".join(output["data"]["image/png"]).replace("\n", "")
        yield _fenced("{raw} html", f'<p><img alt="a picture" src="data:image/png;base64,{picture}"></p>')
    elif "text/html" in output["data"]:
        html = "".join(output["data"]["text/html"]).replace('class="ss2sql', 'class="docutils')
        yield _fenced("{raw} html", f'<div class="table-wrapper" style="margin-bottom: 1em">{html}</div>')
    else:
        yield _fenced("text", "".join(output["data"]["text/plain"]))


def _fenced(language: str, text: str) -> str:
    return f"````{language}\n{text.rstrip()}\n````"
