"""How values look in messages, and the errors for values that the language does not have."""

from __future__ import annotations

from math import isfinite
from typing import Any, NoReturn

from ss2sql.errors import ExecutionError
from ss2sql.language.kinds import INT_MAX, INT_MIN, Opaque

# A list nested deeper than this, or one that contains itself, is refused: Python's own == and repr recurse
# into lists on a stack of 1,000 frames, which they share with the code that calls them.
DEPTH_LIMIT = 500


def format_value(value: Any, limit: int = 60) -> str:
    """The value as the language writes it; longer than `limit` characters, it is cut with `...`."""
    text = _write_value(value, limit)
    return text if len(text) <= limit else text[: limit - 3] + "..."


def _write_value(value: Any, room: int) -> str:
    """The text of a value; once it is longer than `room` it may be broken off anywhere."""
    if room <= 0:
        return "..."
    if isinstance(value, Opaque):
        value = value.object
    kind = type(value)
    if kind is str:
        return repr(value[: room + 1])
    if kind is int and value.bit_length() > 512:
        return f"<integer of {value.bit_length()} bits>"
    if kind is list or kind is dict:
        text = "[" if kind is list else "{"
        for item in value:
            text += ", " if len(text) > 1 else ""
            if kind is dict:
                text += _write_value(item, room - len(text)) + ": "
                item = value[item]
            text += _write_value(item, room - len(text))
            if len(text) > room:
                break
        return text + ("]" if kind is list else "}")
    try:
        return " ".join(repr(value).split())
    except Exception:  # the object is the user's, and so is its repr
        return f"<{kind.__name__}>"


def build_depth_error(subject: str) -> ExecutionError:
    """The error for a value that is nested too deeply; `subject` begins the sentence, verb included."""
    return ExecutionError(
        "X004",
        f"{subject} a value nested deeper than {DEPTH_LIMIT} levels",
        hints=("a list or dict must not contain itself; keep long chains flat, as one list",),
    )


FLOAT_CURE = "make one of the operands a float, for example with float(...)"
# What to do about an integer that is too large, where these functions gave it.
CURES = {
    "int": "an integer has 64 bits; float(...) holds larger numbers",
    "abs": "write abs(float(x)): a float can be larger",
    "sum": "add floats, for example SELECT float(x)",
}


def check_arithmetic(value: Any, cure: str = FLOAT_CURE) -> Any:
    """The result of arithmetic, if it is a value: integers within 64 bits, finite floats.

    Args:
        value: the result.
        cure: what to do about an integer that is too large.

    Raises:
        ExecutionError: X004 for any other number.
    """
    kind = type(value)
    if kind is int:
        if INT_MIN <= value <= INT_MAX:
            return value
        raise ExecutionError(
            "X004", f"integer overflow: {format_value(value)} does not fit into 64 bits", hints=(cure,)
        )
    if kind is float and not isfinite(value):
        raise build_overflow_error()
    if kind is complex:
        raise build_complex_error(f"the result {format_value(value)}")
    return value


def build_complex_error(what: str) -> ExecutionError:
    """The error for a power that is no real number."""
    hint = "a negative number has no real fractional power; use abs(...) or a whole exponent"
    return ExecutionError("X004", f"{what} is a complex number", hints=(hint,))


def build_overflow_error() -> ExecutionError:
    """The error for a float result beyond all floats."""
    return ExecutionError(
        "X004",
        "float overflow: the result is beyond the largest float, about 1.8e308",
        hints=("scale the values down, or add logarithms instead of multiplying",),
    )


# --- a text of a table that is not UTF-8: natively it stands in its row, and is an error only where somebody reads it
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
