"""Names that virtual tables of worlds and the SQL that reads them have in common."""

from collections.abc import Iterable

PLACE = "place in the walk"  # a hidden column; the blanks keep it apart from the names of users


def quoted(names: Iterable[str]) -> str:
    """Names of columns, as a table is declared with them."""
    return ", ".join('"' + name.replace('"', '""') + '"' for name in names)
