"""PyBullet on demand, and calls of it: importing this module does not import it, so that ss2sql works without it."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from functools import cache, partial
from inspect import isbuiltin
from typing import Any
from uuid import uuid4

from ss2sql.errors import require_package


@cache
def import_pybullet() -> Any:
    return require_package("pybullet", "sim", "PyBullet's world or scene")


@cache
def _make_client_type() -> Any:
    bullet = import_pybullet()
    base: Any = require_package("pybullet_utils.bullet_client", "sim", "a scene").BulletClient

    class Client(base):  # type: ignore[misc]
        """A BulletClient without a window.

        It connects itself, because BulletClient passes options to Bullet, which then writes `argv[0]=`
        to the standard output.
        """

        def __init__(self) -> None:
            self._shapes: dict[int, int] = {}
            self._pid = os.getpid()
            self._client = bullet.connect(bullet.DIRECT)

    return Client


def start_bullet() -> Any:
    """A new simulation without a window, a `pybullet_utils.bullet_client.BulletClient`."""
    return _make_client_type()()


# --- calls of the simulator
class NumberedClient:
    """A `BulletClient` for a client that is known by its number alone; it never disconnects it."""

    def __init__(self, number: int) -> None:
        self._client = number

    def __getattr__(self, name: str) -> Any:
        attribute = getattr(import_pybullet(), name)
        return partial(attribute, physicsClientId=self._client) if isbuiltin(attribute) else attribute


def get_client_number(client: Any) -> int:
    """The number by which PyBullet knows a client; -1 once it has been disconnected."""
    return int(client._client)


class Calls:
    """The functions and constants of a client, each looked up once: `BulletClient` takes 3 us for each look-up."""

    def __init__(self, client: Any) -> None:
        self._client = client
        self.number = get_client_number(client)

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._client, name)
        setattr(self, name, found)
        return found

    def get_numbered_call(self, name: str) -> Callable[..., Any]:
        """A function that takes `number` as its last argument, by its position.

        A call takes 0.2 to 0.4 us less than with the keyword, which clients use.
        """
        found = getattr(self, name)
        if isinstance(found, partial) and not found.args and found.keywords == {"physicsClientId": self.number}:
            return found.func
        return lambda *arguments: found(*arguments[:-1])


class BodyNotes(Mapping[int, Any]):
    """What the user says of bodies, by their ids. It ends with its body, although a later body may get the same id.

    PyBullet keeps a mark with each body, as its user data, and drops it with the body.
    """

    def __init__(self, calls: Calls, notes: Mapping[int, Any]) -> None:
        self._notes = dict(notes)
        self._mark = f"ss2sql {uuid4()}"
        self._client = calls.number
        self._find_mark = calls.get_numbered_call("getUserDataId")
        for body in self._notes:
            calls.addUserData(body, self._mark, "")

    def __getitem__(self, body: int) -> Any:
        note = self._notes[body]
        if self._find_mark(body, self._mark, -1, -1, self._client) < 0:
            raise KeyError(body)
        return note

    def __iter__(self) -> Iterator[int]:
        return (body for body in self._notes if body in self)

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __bool__(self) -> bool:
        """Whether any was given: to count those that are left takes a call for each."""
        return bool(self._notes)
