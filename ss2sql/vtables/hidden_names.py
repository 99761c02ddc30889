"""Names shared by virtual tables of worlds and the SQL that reads them."""

from collections.abc import Iterable

ROW_NUMBER = "place in the walk"  # a hidden column; the blanks distinguish it from users' names


def quote_names(names: Iterable[str]) -> str:
    """Names of columns, quoted for a declaration."""
    return ", ".join('"' + name.replace('"', '""') + '"' for name in names)
