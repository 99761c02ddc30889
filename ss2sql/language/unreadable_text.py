"""A text of a table that is not UTF-8: natively it stands in its row, and is an error only where somebody reads it."""

from __future__ import annotations

from typing import Any, NoReturn

from ss2sql.errors import ExecutionError
from ss2sql.language.kinds import Opaque


def build_utf8_error(raw: bytes) -> ExecutionError:
    """The error for a text that Python cannot read."""
    written = repr(raw) if len(raw) <= 60 else f"{raw[:50]!r}..."
    hint = "read its bytes, by a view in the file with CAST(column AS BLOB), or write it anew as UTF-8"
    return ExecutionError("X009", f"SQLite: a text is not UTF-8: {written}", hints=(hint,))


def decode_text(raw: bytes, encoding: str) -> Any:
    """The text with these bytes, or what stands for it."""
    try:
        return raw.decode(encoding)
    except UnicodeDecodeError:
        return UnreadableText(raw)


def is_unreadable(error: Exception) -> bool:
    """Whether such a text is why there is this error."""
    return isinstance(error, ExecutionError) and isinstance(error.__cause__, UnicodeDecodeError)


class UnreadableText(Opaque):
    """Equals texts of the same bytes, is true, and raises ExecutionError X009 for any other operation."""

    __slots__ = ()

    def __init__(self, raw: bytes) -> None:
        self.key = (UnreadableText, raw)

    def make_error(self) -> ExecutionError:
        return build_utf8_error(self.key[1])  # type: ignore[index]

    def _refuse_use(self, *_: Any) -> NoReturn:
        raise self.make_error()

    def __reduce__(self) -> Any:
        return UnreadableText, (self.key[1],)  # type: ignore[index]

    def __bool__(self) -> bool:
        return True

    object = property(_refuse_use)
    __lt__ = __le__ = __gt__ = __ge__ = __add__ = __radd__ = __mod__ = _refuse_use
    __len__ = __iter__ = __contains__ = __getitem__ = __repr__ = __str__ = __format__ = _refuse_use
    __hash__ = Opaque.__hash__

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        raise self.make_error()
