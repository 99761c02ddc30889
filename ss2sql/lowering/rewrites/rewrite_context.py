"""What rewrites may ask of the session: values of script variables, and the meaning of texts for `eval`."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import field
from marshal import dumps
from types import NoneType
from typing import Any

from ss2sql.errors import Error
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.kinds import Type, is_covering, type_of

MAX_ELEMENTS = 1_000
_PLAIN = frozenset({NoneType, bool, int, float, str})
_NO_VARIABLES: dict[str, Any] = {}


@dataclass(slots=True)
class RewriteContext:
    """The session while one query is rewritten, and what the rewritten query relies on."""

    variable: Callable[[str], Any] = _NO_VARIABLES.__getitem__  # raises where the value is unknown
    read: Callable[[str, Any], plan.Expr | None] = lambda text, scope: None  # resolves a text of `eval`
    replaced: Collection[str] = ()  # names of functions of the user
    fixed: bool = True
    lists: dict[str, bytes | None] = field(default_factory=dict)  # fingerprints of the values that it relies on
    types: dict[str, Type] = field(default_factory=dict)  # the types of the variables that texts of `eval` mention

    def get_list(self, name: str) -> list[Any] | None:
        """The value of a variable if it is a short list of plain values; the query then relies on it."""
        if not self.fixed:
            return None
        value = _get_value_or_none(self.variable, name)
        known = self.lists[name] = fingerprint_list(value)
        return None if known is None else list(value)

    def forget_values(self) -> None:
        """Relies on no values: the query may change its variables itself.

        That a list is not known is still relied on: with its value, texts could be read that may change variables.
        """
        self.fixed = False
        self.lists = {name: None for name, known in self.lists.items() if known is None}

    def is_still_valid(self, variable: Callable[[str], Any]) -> bool:
        """Whether all that the query relies on is so, with the values that `variable` gives."""
        for name, known in self.lists.items():
            if fingerprint_list(_get_value_or_none(variable, name)) != known:
                return False
        for name, kind in self.types.items():
            try:
                if not is_covering(kind, type_of(variable(name))):
                    return False
            except (Error, KeyError):
                return False
        return True


def _get_value_or_none(variable: Callable[[str], Any], name: str) -> Any:
    try:
        return variable(name)
    except (Error, KeyError):
        return None


def fingerprint_list(value: Any) -> bytes | None:
    """What tells a short list of plain values from all others, 1 from 1.0 and True too; None for any other value."""
    if type(value) is not list or len(value) > MAX_ELEMENTS or not is_plain_value(value):
        return None
    return dumps(value, 2)


def is_plain_value(value: Any) -> bool:
    """Whether the value is None, a bool, a number, a string, or a list of such values."""
    return type(value) in _PLAIN or (type(value) is list and all(map(is_plain_value, value)))
