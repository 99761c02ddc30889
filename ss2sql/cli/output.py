"""Results on stdout."""

from __future__ import annotations

import click

from ss2sql.runtime.result import Result


def echo(text: str) -> None:
    """Prints a result; what no terminal can show is written as an escape."""
    click.echo(text.encode("utf-8", "backslashreplace").decode("utf-8"))


def print_result(result: Result, form: str) -> None:
    if form == "json":
        echo(str(result.json()))
    elif form == "csv":
        echo(str(result.csv()).rstrip("\n"))
    elif result.answer is None:
        echo(str(result.value))
    else:
        result.show()
