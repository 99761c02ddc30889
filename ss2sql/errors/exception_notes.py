"""The note on a user's exception with the place in the script; type and traceback stay."""

from __future__ import annotations

from collections.abc import Sequence

from ss2sql.errors.spans import Span


def note_place(
    exception: BaseException, called: str, spans: Sequence[Span], kind: str = "function", evals: Sequence[Span] = ()
) -> None:
    """Adds to a user's exception, once, the note with the function that raised it and its place in the script.

    Args:
        exception: what was raised; its type and its traceback stay.
        called: the name of what raised it.
        spans: where it is called.
        kind: what it is.
        evals: the places of the `eval` calls whose strings contain the call, the innermost first.
    """
    places = ", ".join(dict.fromkeys(span.place for span in spans)) or "<script>"
    lines = [f"raised by the {kind} '{called}', called at {places}", *_show_script_lines(spans)]
    for span in evals:
        lines += [f"in the text that eval reads at {span.place}", *_show_script_lines([span])]
    note_once(exception, "\n".join(lines))


def note_once(exception: BaseException, note: str) -> None:
    """Adds the note, unless the exception already has a more precise one."""
    if getattr(exception, "_ss2sql_noted", False):
        return
    exception.add_note(note)
    try:
        exception._ss2sql_noted = True  # type: ignore[attr-defined]
    except AttributeError:
        return  # exceptions with __slots__ cannot be marked and may get a second note


def _show_script_lines(spans: Sequence[Span]) -> list[str]:
    lines = dict.fromkeys((span.source, span.line) for span in spans)
    return [f"  {number} | {source.get_line(number)}" for source, number in lines]
