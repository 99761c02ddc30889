"""How values travel through SQLite: None, ints, floats and strings as themselves, all else as a handle.

A handle is a short BLOB that stands for one exact value, so 10, 10.0 and True inside of lists come back as
they were put in. Equality is another matter: `make_key` gives equal values one SQL value.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from itertools import chain, islice
from marshal import dumps, loads
from os import urandom
from typing import Any

from ss2sql.language.conversion import (
    SCALARS,
    build_depth_error,
    convert_value,
    is_marshalled_value,
    is_shallow_list_value,
)
from ss2sql.language.kinds import INT_MAX, INT_MIN, is_encodable
from ss2sql.language.values import Opaque, copy_for_python, find_several_forms, get_truth, make_hashable
from ss2sql.runtime.run.value_sizes import ValueSizes

# SQLite takes the number that a BLOB begins with for its truth. The zero byte ends this number, and makes
# it one digit in a database whose text is UTF-16 (little-endian) too.
_TRUTHY, _FALSY = b"1\0~", b"0\0~"

TRUE = _TRUTHY + b"ss2sql-true"
FALSE = _FALSY + b"ss2sql-false"
_EMPTY = dumps([], 2)

SMALL_BYTES = 1000  # bytes of marshal: what has fewer is neither large nor deep
_LARGE_PADDING = bytes(SMALL_BYTES)
VALUES_LIMIT = 100_000  # decoded values that are kept beside their bytes


class OtherFormError(Exception):
    """A value equals another that was taken for the only form: [3.0] beside [3]. It never leaves an execution."""


class Interning:
    """The structured values of one run; they live as long as the Interning.

    Every method takes or gives *SQL values*: None, int, float, str, or bytes, which are a handle, or a BLOB
    of somebody's table, an opaque bytes object. TRUE and FALSE are the same handles in every Interning; the
    others begin with six random bytes, so that no stored BLOB can be taken for one.
    """

    __slots__ = (
        *("_classes", "_handles", "_made", "_objects", "_tags", "_unkeyed", "_values", "_walked"),
        *("keys", "marshalled", "sizes", "watched"),
    )

    def __init__(self, sizes: ValueSizes | None = None) -> None:
        self.sizes = sizes or ValueSizes()
        tag = urandom(6)
        self._tags = (_FALSY + tag, _TRUTHY + tag)
        self._made = 0
        # What tells values apart -> handle: marshal bytes; of objects, which have none, see _make_handle_key.
        self._handles: dict[Hashable, bytes] = {}
        self.watched: frozenset[Any] = frozenset()  # handles that must stand for all values that equal theirs
        self.marshalled = {TRUE: dumps(True, 2), FALSE: dumps(False, 2)}
        self._values: dict[bytes, Any] = {}  # of plain data, as long as there is room
        self._objects: dict[bytes, Any] = {}
        self._walked: set[bytes] = set()
        self.keys: dict[Any, int | bytes] = {}  # of handles that equal another SQL value: the one for both
        self._classes: dict[Hashable, bytes] = {}
        self._unkeyed: set[bytes] | None = set()  # handles that nobody has compared yet; None where all are compared

    def encode(self, value: Any) -> Any:
        """The SQL value of a value of the language."""
        kind = type(value)
        if kind is int or kind is float or value is None:
            return value
        if kind is str and (value.isascii() or is_encodable(value)):
            return value
        if kind is bool:
            handle = TRUE if value else FALSE
            self.keys[handle] = int(value)
            return handle
        try:
            marshalled = dumps(value, 2)
        except ValueError:
            return self._encode_objects(value)
        return self._handles.get(marshalled) or self._add_handle(marshalled, marshalled, value)

    def encode_made(self, value: Any) -> Any:
        """The same of a list or dict that the script made. Raises ExecutionError X014 or X004 where it is too large."""
        encoded = self.encode(value)
        if type(encoded) is bytes and len(self.marshalled.get(encoded, _LARGE_PADDING)) >= SMALL_BYTES:
            self.sizes.check_value(value)
        return encoded

    def encode_frame(self, source: Any) -> bytes:
        """A handle for a data frame or a list, which is walked and never compared; the same for the same object."""
        handle = self._handles.get(id(source)) or self._make_handle(id(source), None, True)
        self._objects[handle] = source
        self._walked.add(handle)
        return handle

    def encode_object(self, value: Any, giver: str) -> Any:
        """`encode(convert_value(value, giver))`, without a look at the value where it is known already.

        Args:
            value: what a Python function returned, or a variable holds.
            giver: who hands it over, for errors.

        Raises:
            ExecutionError: X004, as `convert_value` does.
        """
        kind = type(value)
        if kind is list:
            if not value:  # what functions of moves say most often
                return self._handles.get(_EMPTY) or self.encode(value)
        elif kind is int and INT_MIN <= value <= INT_MAX:
            return value
        elif kind is bool:
            return self.encode(value)
        elif kind is not tuple or not value:
            return self.encode(convert_value(value, giver))
        if type(value[0]) is int:
            try:
                hash(tuple(value))  # 0.06 us for nine numbers; `dumps` might follow a list inside for ever
            except TypeError:
                return self.encode(convert_value(value, giver))
        elif not is_shallow_list_value(value):
            return self.encode(convert_value(value, giver))
        marshalled = dumps(value, 2)
        handle = self._handles.get(marshalled)
        if handle is not None:
            return handle
        if kind is list and not marshalled[::5].strip(b"[i"):  # lists and small integers: five bytes each
            return self._make_handle(marshalled, marshalled, True)
        if kind is list and is_marshalled_value(marshalled):
            return self._add_handle(marshalled, marshalled, value)
        handle = self.encode(convert_value(value, giver))
        if is_shallow_list_value(value):  # else these bytes may be those of another object, such as a scalar of NumPy
            self._handles[marshalled] = handle
        return handle

    @property
    def is_plain(self) -> bool:
        """Whether there are no objects among the values so far, but what is only walked."""
        return self._objects.keys() <= self._walked

    def decode(self, value: Any) -> Any:
        """The value of the language; it is shared and must not be changed."""
        if type(value) is not bytes:
            return value
        found = self._objects.get(value)  # first, for to fail takes 0.5 us, and joins of worlds come here for each pair
        if found is not None:
            return found
        try:
            return self.decode_plain(value)
        except KeyError:
            return value

    def decode_plain(self, handle: bytes) -> Any:
        """The value of a handle of plain data, for who does not change it. KeyError for all other BLOBs."""
        try:
            return self._values[handle]
        except KeyError:
            value = loads(self.marshalled[handle])
        if len(self._values) >= VALUES_LIMIT:
            self._values.clear()
        self._values[handle] = value
        return value

    def keep_values(self, encoded: Sequence[Any], values: Sequence[Any]) -> None:
        """Keeps values, which nobody changes, beside their handles: to load one again takes 0.3 us."""
        if len(values) + len(self._values) < VALUES_LIMIT:
            self._values.update(pair for pair in zip(encoded, values, strict=True) if pair[0] in self.marshalled)

    def decode_copy(self, value: Any) -> Any:
        """A copy of the value for Python code, which may change it; opaque objects are the same objects."""
        marshalled = self.marshalled.get(value) if type(value) is bytes else None
        if marshalled is not None:
            return loads(marshalled)
        found = self._objects.get(value)
        return value if found is None else copy_for_python(found)

    def decode_read_only(self, value: Any) -> Any:
        """The same for Python code that changes nothing; what holds objects is a copy all the same."""
        if type(value) is not bytes:
            return value
        try:
            return self.decode_plain(value)
        except KeyError:
            return self.decode_copy(value)

    def make_key(self, value: Any) -> Any:
        """One SQL value for all equal values: SQLite's `IS` and Python's `==` on keys are the language's equality.

        The key of True is 1. Keys of structured values are handles. They are hashable.
        """
        if self._unkeyed and value in self._unkeyed:
            self._unkeyed.remove(value)
            self._find_key(value)
        return self.keys.get(value, value)

    def key_all_values(self) -> None:
        """Finds keys when values are interned, from now on; to find those of 16,000 dicts takes 40 ms."""
        unkeyed, self._unkeyed = self._unkeyed, None
        for handle in unkeyed or ():
            self._find_key(handle)

    def are_equal(self, left: Any, right: Any) -> bool:
        """Whether two SQL values stand for equal values."""
        return bool(self.make_key(left) == self.make_key(right))

    def _add_handle(self, exact: Hashable, marshalled: bytes | None, value: Any) -> bytes:
        """A new handle for what `exact` tells from all other values.

        Raises OtherFormError if the value equals one whose handle stands for all that do.
        """
        several = marshalled is None or type(value) is bytes or find_several_forms(marshalled)
        if several and self.watched:
            frozen = make_hashable(value)
            if type(frozen) is bytes and self._handles.get(frozen) in self.watched:
                raise OtherFormError  # nothing of the value is kept yet
        handle = self._make_handle(exact, marshalled, get_truth(value))
        if several and self._unkeyed is not None:
            self._unkeyed.add(handle)
        elif several:
            self._note_key(handle, value)
        return handle

    def _find_key(self, handle: bytes) -> None:
        self._note_key(handle, self._objects[handle] if handle in self._objects else self.decode_copy(handle))

    def _note_key(self, handle: bytes, value: Any) -> None:
        """Notes the SQL value that stands for all values that equal one, where that is not its handle."""
        frozen = make_hashable(value)
        key: bytes
        if type(value) is bytes:
            key = value  # as a BLOB of a table is
        elif type(frozen) is bytes:  # the marshal bytes of a list, which is the key of all lists that equal it
            key = self._handles.get(frozen) or self._add_handle(frozen, frozen, loads(frozen))
        else:
            key = self._classes.setdefault(frozen, handle)
        if key is not handle:
            self.keys[handle] = key

    def _make_handle(self, exact: Hashable, marshalled: bytes | None, truthy: bool) -> bytes:
        """The same of a value that is equal to no other in another form."""
        self._made = made = self._made + 1
        handle = self._handles[exact] = self._tags[truthy] + made.to_bytes(5, "big")
        if marshalled is not None:
            self.marshalled[handle] = marshalled
        return handle

    def _encode_objects(self, value: Any) -> bytes:
        """The handle of an object, or of a list or dict with objects inside, which this keeps alive."""
        try:
            exact = _make_handle_key(value)
        except RecursionError:
            raise build_depth_error("the script made") from None
        handle = self._handles.get(exact)
        if handle is None:
            handle = self._add_handle(exact, None, value)
            self._objects[handle] = value
        return handle


def _make_handle_key(value: Any) -> Hashable:
    """What tells a value with objects inside from all others: the structure, marshal bytes, identities of objects."""
    kind = type(value)
    if kind is list or kind is tuple:
        return kind, *map(_make_handle_key, value)
    if kind is dict:
        return kind, *map(_make_handle_key, chain.from_iterable(value.items()))
    if kind in SCALARS or kind is bytes:
        return dumps(value, 2)
    return id(value.object if kind is Opaque else value)


Decoder = Callable[[Sequence[Any]], tuple[Any, ...]]


def make_decoder(interning: Interning, flags: Sequence[bool]) -> Decoder:
    """What turns a row of SQL values into values of the language; `flags` are the columns where bools are 0 or 1."""
    decode = interning.decode
    if not any(flags):
        return lambda raw: tuple([value if type(value) is not bytes else decode(value) for value in raw])
    return lambda raw: tuple([bool(value) if flag else decode(value) for flag, value in zip(flags, raw, strict=True)])


def make_row_decoder(interning: Interning, parts: Sequence[int]) -> Decoder:
    """What turns a step's row into values: `parts` says of each column how many of them are a list, 0 for no list."""

    def read_row(raw: Sequence[Any]) -> tuple[Any, ...]:
        values = map(interning.decode, raw)
        return tuple([list(islice(values, size)) if size else next(values) for size in parts])

    return read_row
