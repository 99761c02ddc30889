"""What tests of functions that take arrays share: such functions, which note their blocks, and runs with them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from agreement import exact

import ss2sql


class Blocks:
    """A function of rows as one that takes arrays; `sizes` are those of its blocks, `seen` all rows in them."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = function
        self.sizes: list[int] = []
        self.seen: list[tuple[Any, ...]] = []

    def __call__(self, *columns: Any) -> Any:
        assert all(type(column) is np.ndarray and column.ndim == 1 for column in columns)
        rows = list(zip(*(column.tolist() for column in columns), strict=True))
        self.sizes.append(len(rows))
        self.seen += rows
        return [self.function(*row) for row in rows]


def blocks(function: Callable[..., Any]) -> Any:
    """A function of one or two parameters, with its `Blocks` as `made`."""
    made = Blocks(function)
    takes = function.__code__.co_argcount
    wrapper: Any = (lambda a: made(a)) if takes == 1 else (lambda a, b: made(a, b))
    wrapper.made = made
    return wrapper


def run(engine: Any, script: str, sources: dict[str, Any], **functions: Any) -> ss2sql.Result:
    with ss2sql.connect(disable=["inline"]) as ss:  # which would make others of calls row by row
        for name, function in functions.items():
            ss.function(name, function, volatility="immutable", vectorized=hasattr(function, "made"))
        for name, source in sources.items():
            ss.attach(name, source)
        return ss.run(script, engine=engine)


def outcome(engine: Any, script: str, sources: dict[str, Any], **functions: Any) -> Any:
    try:
        return exact(run(engine, script, sources, **functions).value)
    except ss2sql.Error as error:
        return error.code, error.span and error.span.place
    except Exception as error:
        return type(error), str(error), getattr(error, "__notes__", [])
