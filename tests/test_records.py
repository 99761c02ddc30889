"""Dataclasses of `ss2sql.fast_dataclasses` behave as those of the standard library."""

from __future__ import annotations

import copy
import dataclasses
import inspect
import pickle
from typing import Any, ClassVar

import pytest

from ss2sql.fast_dataclasses import dataclass


def classes(decorator: Any, **options: bool) -> tuple[type, type]:
    @decorator(**options)
    class Base:
        shared: ClassVar[int] = 7
        one: Any
        two: Any = dataclasses.field(default=None, kw_only=True, compare=False, repr=False)
        many: list[int] = dataclasses.field(default_factory=list)

    @decorator(**options)
    class Derived(Base):
        more: int = 3
        made: str = dataclasses.field(init=False, default="made")

        def __post_init__(self) -> None:
            object.__setattr__(self, "many", [*self.many, self.more])

        def __hash__(self) -> int:
            return 5

    return Base, Derived


def outcome(work: Any) -> Any:
    try:
        return work()
    except (TypeError, AttributeError) as error:
        return type(error)


@pytest.mark.parametrize(
    "options", [{}, {"frozen": True}, {"slots": True}, {"frozen": True, "slots": True}, {"eq": False}, {"repr": False},
                {"frozen": True, "slots": True, "kw_only": True}]
)  # fmt: skip
def test_records_are_dataclasses(options: dict[str, bool], monkeypatch: pytest.MonkeyPatch) -> None:
    found = []
    for decorator in (dataclasses.dataclass, dataclass):
        told: list[Any] = []
        for kind in classes(decorator, **options):
            monkeypatch.setitem(globals(), kind.__name__, kind)
            kind.__module__, kind.__qualname__ = __name__, kind.__name__
            made, same, other = kind(one=(1,), two=5), kind(one=(1,), two=6), kind(one=(1,), many=[2])
            told += [[made == same, made == other, made == (1,), made != same], repr(made).partition(" object at ")[0]]
            told += [dataclasses.astuple(dataclasses.replace(made, one=2)), dataclasses.asdict(made)]
            told += [[(f.name, f.type, f.kw_only, f.compare) for f in dataclasses.fields(made)], kind.__match_args__]
            told += [str(inspect.signature(kind)), hasattr(made, "__dict__"), kind.shared]
            told += [dataclasses.astuple(copy.deepcopy(made)), dataclasses.astuple(pickle.loads(pickle.dumps(made)))]
            told += [outcome(lambda made=made: setattr(made, "one", 3)), made.one, outcome(lambda kind=kind: kind())]
            unchanging = dataclasses.replace(made, many=())
            told += [outcome(lambda one=unchanging: hash(one) and 1), outcome(lambda made=made: delattr(made, "one"))]
        found.append(told)
    assert found[0] == found[1]
