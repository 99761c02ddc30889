"""Names shared by virtual tables of worlds and the SQL that reads them."""

from collections.abc import Iterable

PLACE = "place in the walk"  # a hidden column; the blanks distinguish it from users' names


def quoted(names: Iterable[str]) -> str:
    """Names of columns, quoted for a declaration."""
    return ", ".join('"' + name.replace('"', '""') + '"' for name in names)
