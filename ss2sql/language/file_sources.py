"""Paths of files as sources: the endings that mark a string as a path, and hints for such files."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

# How to read files that cannot be attached by their paths, by their ending; `{0}` is the path, `rows` a list of dicts.
READ_IN_PYTHON: Mapping[str, str] = {
    ".csv": 'pandas.read_csv("{0}")',
    ".tsv": 'pandas.read_csv("{0}", sep="\\t")',
    ".json": 'json.load(open("{0}"))',
    ".jsonl": 'pandas.read_json("{0}", lines=True)',
    ".ndjson": 'pandas.read_json("{0}", lines=True)',
    ".xlsx": 'pandas.read_excel("{0}")',
    ".feather": 'pandas.read_feather("{0}")',
    **dict.fromkeys((".mcap", ".db3", ".bag", ".nc", ".zarr", ".vtu"), "rows"),
}
ATTACHED = (".db", ".sqlite", ".sqlite3", ".parquet")
"""Endings of files that `attach` opens."""


def find_file_ending(source: Any) -> str | None:
    """The known ending of a string or path; None where it is no path, or has another ending."""
    if not isinstance(source, (str, os.PathLike)):
        return None
    ending = os.path.splitext(os.fspath(source))[1]
    known = ending.lower() if isinstance(ending, str) else ""
    return known if known in READ_IN_PYTHON or known in ATTACHED else None


def suggest_source(path: str, name: str) -> str:
    """The hint for a file: how it becomes a source."""
    ending = find_file_ending(path)
    if ending is None or ending in ATTACHED:
        return f'attach("{name}", "{path}")'
    read = READ_IN_PYTHON[ending].format(path)
    return f'read it in Python{" into a list of dicts" if read == "rows" else ""}: attach("{name}", {read})'
