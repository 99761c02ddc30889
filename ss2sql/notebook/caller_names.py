"""Functions and values of the notebook for unknown names of a script.

Only names in the script that the session does not know are looked up, so a variable `add` of the notebook never becomes
the operator `+`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from difflib import get_close_matches
from types import ModuleType
from typing import Any

from ss2sql.errors import ResolveError, Source
from ss2sql.frontend.resolve.resolver import resolve
from ss2sql.frontend.syntax import ast
from ss2sql.frontend.syntax.parser import parse
from ss2sql.language.recursion_limit import retry_with_stack
from ss2sql.language.values import SCALARS
from ss2sql.session.session import Session

MISSING = object()
UNKNOWN = ("R001", "R002", "R003")  # the codes for unknown names, functions and sources


class NotebookNames:
    """The names that one session got from a notebook, so that changes are passed on.

    `names` is the notebook's namespace, `hidden` are the names in it that are IPython's own.
    """

    def __init__(self, session: Session, names: Mapping[str, Any], hidden: Mapping[str, Any]) -> None:
        self.session = session
        self._names = names
        self._hidden = hidden
        self._functions: dict[str, Any] = {}
        self._values: dict[str, Any] = {}  # as they are in the notebook
        self._kept: dict[str, Any] = {}  # the same in the session

    def provide_names(self, script: Source) -> None:
        """Gives the session the notebook's values for names of the script that it does not know.

        Raises ParseError, and SessionError for what a session cannot take.
        """
        tree = parse(script)
        self._remove_outdated()
        for name in dict.fromkeys(_find_called_functions(tree)):
            found = self._find_value(name)
            if callable(found) and self._is_new(name, found):
                self._provide_function(name, found)
        provided = True
        while provided:  # new values may have columns, which changes the unknown names
            provided = self._provide_all(self._list_unknown(tree))

    def add_hints(self, error: ResolveError) -> ResolveError:
        """The error, with hints at names of the notebook that are close to unknown ones."""
        usable = [name for name in self._names if self._find_value(name) is not MISSING]
        for one in error.errors:
            unknown = one.span.text if one.code in UNKNOWN and one.span is not None else ""
            for name in get_close_matches(unknown, usable, n=1):
                if not any(f"'{name}'" in hint for hint in one.hints):
                    one.with_hint(f"the notebook has '{name}'")
        return error

    def _find_value(self, name: str) -> Any:
        """The notebook's value of a name; MISSING where it has none that a script could use."""
        found = self._names.get(name, MISSING)
        own = name in self._hidden and found is self._hidden[name]
        return MISSING if own or name.startswith("_") or isinstance(found, ModuleType) else found

    def _is_new(self, name: str, function: Any) -> bool:
        """Whether the session has no function of the name, or a former one from the notebook."""
        host = self.session.host
        if name in self._functions:
            current = host.functions.get(name)
            ours = current is not None and current.function is self._functions[name]
            return ours and function is not self._functions[name]
        return name not in host.make_catalog().functions and name not in host.world_functions

    def _list_unknown(self, tree: ast.Script) -> tuple[str, ...]:
        catalog = self.session.host.make_catalog(open_names=True)
        try:
            return retry_with_stack(lambda: resolve(tree, catalog)).parameters
        except ResolveError:
            return ()  # running the script raises the error

    def _provide_all(self, names: Iterable[str]) -> bool:
        return sum(map(self._provide_name, names)) > 0

    def _provide_name(self, name: str) -> bool:
        """Gives the session one name; False where the notebook does not have it."""
        found = self._find_value(name)
        if found is MISSING:
            return False
        if callable(found):
            if not self._is_new(name, found):
                return False
            self._provide_function(name, found)
            return True
        if type(found) in SCALARS:
            self.session.set(name, found)
        else:
            self.session.attach(name, found)
        self._values[name] = found
        self._kept[name] = self._get_session_value(name)
        return True

    def _provide_function(self, name: str, function: Any) -> None:
        self.session.function(name, function)
        self._functions[name] = function

    def _remove_outdated(self) -> None:
        """Removes values that the notebook no longer has; values set by a script stay."""
        for name, value in list(self._values.items()):
            if self._get_session_value(name) is not self._kept[name]:
                del self._values[name], self._kept[name]  # it is the session's own now
            elif self._find_value(name) is not value:
                self._remove_name(name)
                del self._values[name], self._kept[name]

    def _get_session_value(self, name: str) -> Any:
        names = self.session.host.names
        return names.attached.get(name, names.values.get(name, MISSING))

    def _remove_name(self, name: str) -> None:
        if name in self.session.host.names.values:
            self.session.host.names.forget_name(name)
        else:
            self.session.detach(name)


def _find_called_functions(tree: Any) -> Iterator[str]:
    stack = [tree]
    while stack:
        node = stack.pop()
        if isinstance(node, ast.Call) and node.owner is None:
            yield node.function
        if isinstance(node, tuple):
            stack.extend(node)
        elif is_dataclass(node) and type(node).__module__ == ast.__name__:
            stack.extend(getattr(node, field.name) for field in fields(node))
