"""docs/tutorial.ipynb shows what its cells give."""

from __future__ import annotations

import copy
import importlib.util
import json
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("ipykernel")
pytest.importorskip("matplotlib")
nbformat = pytest.importorskip("nbformat")
nbclient = pytest.importorskip("nbclient")

NOTEBOOK = Path(__file__).parent.parent / "docs" / "tutorial.ipynb"


def shown(cell: Any) -> list[str]:
    """What a cell shows, as text; of a picture that there is one. A stream may come in any number of parts."""
    found: list[str] = []
    stream = None
    for output in cell.get("outputs", ()):
        before, stream = stream, output.get("name")
        match output["output_type"]:
            case "stream" if stream == before:
                found[-1] += output["text"]
            case "stream":
                found.append(output["text"])
            case "error":
                found.append("\n".join(output["traceback"]))
            case _ if "image/png" in output["data"]:
                found.append("a picture")
            case _:
                found.append(output["data"].get("text/html", "") + output["data"]["text/plain"])
    return found


def test_the_tutorial_shows_what_its_cells_give(tmp_path: Path) -> None:
    written = nbformat.read(NOTEBOOK, as_version=4)
    nbformat.validate(written)
    played = copy.deepcopy(written)
    for cell in played.cells:
        if cell.cell_type == "code":
            cell.outputs, cell.execution_count = [], None
    folder = {"metadata": {"path": str(tmp_path)}}
    nbclient.NotebookClient(played, timeout=120, kernel_name="python3", resources=folder).execute()
    for before, after in zip(written.cells, played.cells, strict=True):
        assert shown(before) == shown(after), before.source


def test_the_tutorial_solves_its_problems() -> None:
    told = "\n".join(text for cell in nbformat.read(NOTEBOOK, as_version=4).cells for text in shown(cell))
    assert "[0, 2] → [0, 1] → [2, 1] → [0, 2] → [1, 0] → [1, 2] → [0, 2]" in told
    assert "3462 steps looked at" in told  # what the default search for seven moves generates
    assert "48 rows, the first 3 shown" in told
    assert told.count("a picture") == 2


def test_the_notebook_is_a_page() -> None:
    spec = importlib.util.spec_from_file_location("notebooks", NOTEBOOK.parent / "notebooks.py")
    assert spec is not None
    assert spec.loader is not None
    notebooks = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(notebooks)
    (mark,) = notebooks.MARK.findall((NOTEBOOK.parent / "notebook_tutorial.md").read_text("utf-8"))
    assert NOTEBOOK.parent / mark == NOTEBOOK
    page = notebooks.markdown(json.loads(NOTEBOOK.read_text("utf-8")))
    assert page.count("````selectscript\n%%ss") == 9
    assert page.count("data:image/png;base64,") == 2
    assert "error[R003]: unknown source 'movs'" in page
    assert "\x1b" not in page
    assert not page.startswith("# ")
