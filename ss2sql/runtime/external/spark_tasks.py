"""What the executors of Spark are to call."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from typing import Any, TypeAlias

Task: TypeAlias = Callable[[Iterator[Any]], Iterator[Any]]


def make_task(function: Callable[..., Iterator[Any]], *arguments: Any) -> Task:
    """What Spark calls with batches: a function of a module here, with more arguments.

    It is sent by value, because ss2sql can be imported there only after it has told where modules are found here; on
    other machines such folders may be missing. So the arguments are nothing of ss2sql.
    """
    module, name = function.__module__, function.__name__
    paths = [os.path.abspath(path) for path in sys.path]

    def run_task(batches: Iterator[Any]) -> Iterator[Any]:
        import sys
        from importlib import import_module

        sys.path.extend(path for path in paths if path not in sys.path)
        found: Iterator[Any] = getattr(import_module(module), name)(batches, *arguments)
        return found

    return run_task
