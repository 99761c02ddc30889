"""How a command ends: errors as messages on stderr, and the exit code that belongs to them."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any, TypeVar

import click

from ss2sql.errors import Cancelled, Error, Timeout

F = TypeVar("F", bound=Callable[..., Any])


def reports_errors(command: F) -> F:
    """Prints errors to stderr and ends with the exit code that belongs to them."""

    @wraps(command)
    def run(*arguments: Any, **options: Any) -> None:
        try:
            command(*arguments, **options)
        except Timeout as error:
            _fail(str(error), 124)
        except (Cancelled, KeyboardInterrupt):
            _fail("cancelled", 130)
        except Error as error:
            _fail(str(error), 1)
        except UserError as error:
            _fail(str(error), 1)

    return run  # type: ignore[return-value]


class UserError(Exception):
    """What Python code of the user raised, as text; without the frames of ss2sql."""

    def __init__(self, error: Exception) -> None:
        shown = traceback.TracebackException.from_exception(error)
        own = (str(Path(__file__).parent.parent), "src/", "<frozen runpy>")  # src/ is apsw
        frames = [frame for frame in shown.stack if not frame.filename.startswith(own)]
        shown.stack = traceback.StackSummary.from_list(frames)
        super().__init__("".join(shown.format()).rstrip())


def _fail(message: str, code: int) -> None:
    click.echo(message, err=True)
    sys.exit(code)
