"""What comes back, and what it can become: text, frames, files, graphs, plots, explanations.

result is what users hold, and what a person should know of it. show makes text, frames and files tables of other
programs, graph_plot graphs; plots draws, with plot_style. Packages of the extras are imported where they are needed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from ss2sql.language.cancellation import iterate_with_check
from ss2sql.language.rows import Row
from ss2sql.language.values import copy_for_python

if TYPE_CHECKING:
    from ss2sql.results.result import Result


def count_words(number: int, word: str) -> str:
    """`1 path`, `1,200 paths`."""
    return f"{number:,} {word}{'' if number == 1 else 's'}"


def cut_text(text: str, most: int, end: str = "...") -> str:
    """At most so many characters of a text; `end` stands for what is left out."""
    return text if len(text) <= most else text[: most - len(end)] + end


def cut_script(text: str, most: int) -> str:
    """A piece of a script, or another text, on one line of at most so many characters."""
    return cut_text(" ".join(text.split()), most)


def get_result_rows(result: Result) -> Iterator[Row]:
    """Copies of the rows of a result as plain tuples."""
    if result.answer is None:
        yield (result.value,)
    elif result.answer.rows.paths is not None:
        for number, path in enumerate(result.answer.rows.paths, 1):
            for step, row in enumerate(path, 1):
                yield (number, step, *copy_result_row(row))
    else:
        rows = result.answer.rows.rows or ()
        yield from rows if result.answer.rows.plain else map(copy_result_row, rows)


def get_all_result_rows(result: Result) -> list[Row]:
    """All these rows at once. Raises Timeout or OutOfMemory beyond the remaining limits of the run."""
    with result.while_reading() as check:
        return list(iterate_with_check(get_result_rows(result), check))


def copy_result_row(row: Row) -> Row:
    return tuple(map(copy_for_python, row))


def get_result_paths(result: Result) -> Sequence[Sequence[Row]] | None:
    """The paths of a search without copies, not to be changed; None of other results."""
    return None if result.answer is None else result.answer.rows.paths
