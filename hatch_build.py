"""The readme as packages show it: its links lead into the repository, or are words where its address is not known."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

LINK = re.compile(r"(!?)\[((?:[^\[\]]|!\[[^]]*\]\([^)]*\))*)\]\((?!https?:|#)([^)]+)\)")


def linked(text: str, repository: str | None) -> str:
    """The Markdown `text` with each relative link made absolute; without a repository only its words stay.

    >>> linked("[the guide](docs/a.md) ![a map](a.png)", "https://example.org/it")
    '[the guide](https://example.org/it/blob/HEAD/docs/a.md) ![a map](https://example.org/it/raw/HEAD/a.png)'
    >>> linked("[the guide](docs/a.md) ![a map](a.png)", None)
    'the guide *a map*'
    """

    def absolute(link: re.Match[str]) -> str:
        picture, words, target = link.groups()
        if repository is None:
            return f"*{words}*" if picture else words
        return f"{picture}[{words}]({repository}/{'raw' if picture else 'blob'}/HEAD/{target})"

    return LINK.sub(absolute, text)


class ReadmeHook(MetadataHookInterface):
    """Fills in the dynamic field `readme`; the address is that of `Repository` in `project.urls`."""

    def update(self, metadata: dict[str, Any]) -> None:
        text = (Path(self.root) / "README.md").read_text("utf-8")
        repository = metadata.get("urls", {}).get("Repository")
        metadata["readme"] = {"content-type": "text/markdown", "text": linked(text, repository)}
