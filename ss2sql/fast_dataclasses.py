"""Dataclasses that are made quickly: `dataclass` as in the standard library, without `order` and `unsafe_hash`.

A first query needs some 130 classes, most of which it never makes. The standard library compiles up to seven functions
for each, 0.3 ms; here `__init__` is compiled when it is first looked up, and the others are closures, 0.1 ms.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from operator import attrgetter
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dataclasses import dataclass as dataclass
else:

    def dataclass(cls=None, /, **options):
        return _build_class(cls) if cls is not None else lambda cls: _build_class(cls, **options)


def _build_class(cls: type, frozen: bool = False, eq: bool = True, repr: bool = True, **others: bool) -> Any:
    """Builds the class: fields and slots by the standard library, the methods from here."""
    own, cls.__doc__ = vars(cls), cls.__doc__ or cls.__name__  # the library would write a signature
    made: Any = dataclasses.dataclass(cls, init=False, repr=False, eq=False, **others)
    known = dataclasses.fields(made)
    made.__init__ = _LateInit(made, known, frozen)
    if frozen:
        made.__setattr__ = made.__delattr__ = _refuse_change
        made.__getstate__, made.__setstate__ = _get_state, _set_state  # for pickle, which sets attributes
    if eq and "__eq__" not in own:
        values = _write_field_values([one.name for one in known if one.compare])
        made.__eq__ = _make_field_equality(values)
        if "__hash__" not in own:
            made.__hash__ = (lambda self: hash(values(self))) if frozen else None
    if repr and "__repr__" not in own:
        made.__repr__ = _make_repr([one.name for one in known if one.repr])
    return made


class _Factory:
    """Stands for a value that is made anew, in the signature of a class."""

    def __repr__(self) -> str:
        return "<factory>"


_FACTORY = _Factory()


class _LateInit:
    """In the place of `__init__`: writes it when it is first looked up."""

    def __init__(self, made: Any, known: tuple[dataclasses.Field[Any], ...], frozen: bool) -> None:
        self.made, self.known, self.frozen = made, known, frozen

    def __get__(self, instance: Any, owner: Any) -> Any:
        if isinstance(self.made.__dict__["__init__"], _LateInit):
            self.made.__init__ = _write_init(self.made, self.known, self.frozen)
        return self.made.__init__ if instance is None else self.made.__init__.__get__(instance)


def _write_init(made: Any, known: tuple[dataclasses.Field[Any], ...], frozen: bool) -> Callable[..., None]:
    """`def __init__(self, name, other=default): ...`, in the annotations of the fields."""
    defaults: dict[str, Any] = {"set_field": object.__setattr__, "FACTORY": _FACTORY}
    plain, named, lines = list[str](), list[str](), list[str]()
    for field in known:
        value, optional = field.name, ""
        if field.default is not dataclasses.MISSING:
            defaults[f"default_{field.name}"] = field.default
            value, optional = field.name if field.init else f"default_{field.name}", f"=default_{field.name}"
        elif field.default_factory is not dataclasses.MISSING:
            defaults[f"make_{field.name}"] = field.default_factory
            value, optional = f"make_{field.name}()", "=FACTORY"
            if field.init:
                value = f"{value} if {field.name} is FACTORY else {field.name}"
        elif not field.init:
            continue
        if field.init:
            (named if field.kw_only else plain).append(field.name + optional)
        lines.append(f'set_field(self, "{field.name}", {value})' if frozen else f"self.{field.name} = {value}")
    if hasattr(made, "__post_init__"):
        lines.append("self.__post_init__()")
    parameters = ", ".join(["self", *plain, *(["*", *named] if named else [])])
    body = "\n    ".join(lines or ["pass"])
    exec(f"def __init__({parameters}):\n    {body}", defaults)
    init: Any = defaults["__init__"]
    init.__qualname__ = f"{made.__qualname__}.__init__"
    init.__annotations__ = {field.name: field.type for field in known if field.init} | {"return": None}
    return init  # type: ignore[no-any-return]


def _refuse_change(self: Any, name: str, *value: Any) -> None:
    raise dataclasses.FrozenInstanceError(f"cannot change field {name!r}")


def _get_state(self: Any) -> list[Any]:
    return [getattr(self, field.name) for field in dataclasses.fields(self)]


def _set_state(self: Any, state: list[Any]) -> None:
    for field, value in zip(dataclasses.fields(self), state, strict=True):
        object.__setattr__(self, field.name, value)


def _write_field_values(names: list[str]) -> Callable[[Any], tuple[Any, ...]]:
    """What gives the values of fields."""
    if len(names) > 1:
        return attrgetter(*names)
    return (lambda made: (getattr(made, names[0]),)) if names else (lambda made: ())


def _make_field_equality(values: Callable[[Any], tuple[Any, ...]]) -> Callable[[Any, Any], bool]:
    def are_equal(self: Any, other: Any) -> bool:
        return values(self) == values(other) if other.__class__ is self.__class__ else NotImplemented

    return are_equal


def _make_repr(names: list[str]) -> Callable[[Any], str]:
    def format_repr(self: Any) -> str:
        return f"{type(self).__qualname__}({', '.join(f'{name}={getattr(self, name)!r}' for name in names)})"

    return format_repr
