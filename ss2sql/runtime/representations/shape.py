"""From rows to the value that AS asks for."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from inspect import signature
from itertools import chain
from typing import Any

from ss2sql.errors import Error, RepresentationError, note_place_on_exception
from ss2sql.language import plan
from ss2sql.language.cancellation import ITEMS_PER_CHECK, Check, iterate_with_check
from ss2sql.language.conversion import format_value
from ss2sql.language.rows import HIDDEN_COLUMNS_ATTRIBUTE, Path, Row, Rows, Table, iterate_checked_paths
from ss2sql.language.values import Opaque, convert_value, copy_for_python
from ss2sql.runtime import representations
from ss2sql.runtime.run.run_state import pause_collector
from ss2sql.runtime.run.search_paths import SearchPaths, measure_path_lengths
from ss2sql.runtime.run.value_sizes import CELL_SIZE, MAX_SIZE, ValueSizes

# What the language makes of rows so that scripts go on with it: lists where `AS rows` gives tuples.
SHARED_FORMS: dict[str, Callable[[Table], Any]] = {
    "dict": representations.ALL["dict"],
    "list": representations.ALL["list"],
    "rows": lambda table: list(map(list, table)),
    "value": representations.ALL["value"],
}
PATH_FORMS = frozenset(SHARED_FORMS)  # which cannot fail
BUILT_IN_FORMS = PATH_FORMS | {"set", "void"}  # of values of the language
PLAIN_TYPES = (bool, int, float, str, list, dict, type(None))


class Representations:
    """The representations of a session, those of the language and the user's, by their names in lower case.

    What they make of rows has at most `most` bytes.
    """

    def __init__(self, most: int = MAX_SIZE) -> None:
        self.most = most
        self.functions: dict[str, Callable[..., Any]] = dict(representations.ALL)

    def represent_rows(
        self,
        form: plan.Representation,
        rows: Rows,
        arguments: Sequence[Any],
        named: Mapping[str, Any],
        check: Check | None = None,
    ) -> Any:
        """The value that AS makes of rows, as the user gets it: nothing in it is shared.

        Of a search it is a list with one value per path; of a partition a dict from group value to that. `check` is
        called every few thousand rows and raises where the run has to end.
        """

        if form.name == "void":
            return None
        sizes, size = ValueSizes(self.most), 0

        def copy_values(some: Sequence[Any]) -> list[Any]:
            nonlocal size
            size = sizes.measure_rows([some], size)
            copies: list[Any] = copy_for_python(list(some))
            if check is not None:
                check()
            return copies

        def copy_portions(some: Iterable[Path]) -> Iterator[Path]:
            """Copies of rows, of paths, or of their cells, if there is room for them: until then they share values.

            Some thousand cells at once: of paths with a dozen lists each takes 2 us, one by one 8.
            """
            for portion in _split_into_portions(some):
                if len(portion) > 1:
                    yield from copy_values(portion)
                    continue
                (long,) = portion
                starts = range(0, len(long), ITEMS_PER_CHECK)
                parts = (copy_values(long[start : start + ITEMS_PER_CHECK]) for start in starts)
                yield type(long)(chain.from_iterable(parts))  # type: ignore[call-arg]

        def represent_paths(positions: Sequence[int] | None) -> Any:
            results: Sequence[Any] = rows.rows if rows.paths is None else rows.paths  # type: ignore[assignment]
            if positions is None:
                chosen = results
            elif isinstance(results, SearchPaths):
                chosen = results.choose_paths(positions)
            else:
                chosen = [results[index] for index in positions]
            if rows.paths is None:
                if form.name == "value" and self.is_built_in(form):
                    chosen = chosen[:1]
                own = list(chosen if rows.plain else copy_portions(chosen))
                return self._call_representation(form, rows.columns, own, arguments, named, check)
            if not (arguments or named or form.hidden) and self.is_built_in(form) and form.name in PATH_FORMS:
                if form.name == "list":
                    flat = (
                        chosen.iterate_cells()
                        if isinstance(chosen, SearchPaths)
                        else map(list, map(chain.from_iterable, chosen))
                    )
                    return list(iterate_checked_paths(flat if rows.plain else copy_portions(flat), check))
                represent, columns = representations.ALL[form.name], rows.columns
                paths = chosen if rows.plain else copy_portions(chosen)
                return [represent(Table(columns, path, check=check)) for path in iterate_checked_paths(paths, check)]
            paths = map(list, chosen if rows.plain else copy_portions(chosen))
            return [
                self._call_representation(form, rows.columns, path, arguments, named, check)
                for path in iterate_checked_paths(paths, check)
            ]

        with pause_collector() if form.name in BUILT_IN_FORMS and self.is_built_in(form) else nullcontext():
            if rows.groups is None:
                return represent_paths(None)
            return {_make_group_key(key, form): represent_paths(positions) for key, positions in rows.groups}

    def represent_subquery(
        self, query: plan.Query, rows: Rows, arguments: Sequence[Any], named: Mapping[str, Any], sizes: ValueSizes
    ) -> Any:
        """The value of a query inside of a script, as a value of the language."""
        rows = represent_starred_columns(query, rows, sizes.pause)
        if self.is_shared(query.representation, rows):
            return self.share_values(query.representation, rows, sizes)
        value = self.represent_rows(query.representation, rows, arguments, named, sizes.pause)
        return sizes.check_value(self.make_language_value(query.representation.name, value))

    def is_shared(self, form: plan.Representation, rows: Rows) -> bool:
        """Whether what the script goes on with is a list of the values that the rows hold, and no copy of them."""
        return self._shares_values(form) and rows.groups is None

    def _shares_values(self, form: plan.Representation) -> bool:
        extended = bool(form.arguments or form.named or form.hidden)
        return form.name in SHARED_FORMS and self.is_built_in(form) and not extended

    def find_row_shape(
        self, form: plan.Representation, columns: tuple[str, ...], sizes: ValueSizes
    ) -> Callable[[list[Row]], Any] | None:
        """What makes such a value of rows with these columns; None where it takes more than the rows."""
        return self._make_row_shape(form, columns, sizes) if self._shares_values(form) else None

    @staticmethod
    def _make_row_shape(
        form: plan.Representation, columns: tuple[str, ...], sizes: ValueSizes
    ) -> Callable[[list[Row]], Any]:
        make, check, pause = SHARED_FORMS[form.name], sizes.check_value, sizes.pause
        short = ITEMS_PER_CHECK if form.name == "list" else -1  # lists without a table: 0.4 us in place of 1.2

        def shape_rows(rows: list[Row]) -> Any:
            plain = len(rows) <= short
            return check(list(chain.from_iterable(rows)) if plain else make(Table(columns, rows, check=pause)))

        return shape_rows

    def share_values(self, form: plan.Representation, rows: Rows, sizes: ValueSizes) -> Any:
        """Such a value.

        Nobody changes it in place, so a query of queries of queries of four rows each takes as long as its rows do:
        of ten of them in each other copies took 18 s and 1.4 GB.
        """
        make, columns, check = SHARED_FORMS[form.name], rows.columns, sizes.pause
        if rows.paths is None:
            return self._make_row_shape(form, columns, sizes)(rows.rows or [])
        if form.name != "value":
            sizes.check_room(
                CELL_SIZE * len(columns) * sum(iterate_with_check(measure_path_lengths(rows.paths), check))
            )
        paths = iterate_checked_paths(map(list, rows.paths), check)
        return sizes.check_value([make(Table(columns, path, check=check)) for path in paths])

    def _call_representation(
        self,
        form: plan.Representation,
        columns: tuple[str, ...],
        own: list[Row],
        arguments: Sequence[Any],
        named: Mapping[str, Any],
        check: Check | None,
    ) -> Any:
        table = Table(columns, own, check=check)
        if form.hidden:
            shown = -form.hidden
            seen, told = [row[:shown] for row in own], [row[shown:] for row in own]
            table = Table(columns[:shown], seen, told, form.facts, form.labels, check)
        copies = {name: copy_for_python(value) for name, value in named.items()}
        try:
            return self.functions[form.name](table, *map(copy_for_python, arguments), **copies)
        except Error as error:
            raise error.with_span(form.span) from None
        except TypeError as error:
            if error.__traceback__ is not None and error.__traceback__.tb_next is not None:
                self._add_place(error, form)
                raise  # it was raised inside the function, not by the call of it
            message = f"AS {form.name} {self._explain_refusal(form.name, len(arguments), str(error))}"
            raise RepresentationError("V001", message, form.span, (self._describe_usage(form.name),)) from error
        except Exception as error:
            self._add_place(error, form)
            raise

    def _add_place(self, error: Exception, form: plan.Representation) -> None:
        """Says on an exception of the user where its representation is called."""
        note_place_on_exception(error, form.name, [form.span] if form.span else [], "representation")

    def _explain_refusal(self, name: str, number: int, reason: str) -> str:
        """What is wrong with the arguments: Python counts the table, which nobody wrote, among them."""
        _, *parameters = signature(self.functions[name]).parameters.values()
        most = sum(p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD) for p in parameters)
        if number > most and not any(p.kind is p.VAR_POSITIONAL for p in parameters):
            return f"takes {f'at most {most}' if most else 'no'} argument{'' if most == 1 else 's'}, not {number}"
        return f"cannot take these arguments: {reason.partition('() ')[2] or reason}"

    def _describe_usage(self, name: str) -> str:
        _, *parameters = signature(self.functions[name]).parameters.values()
        names = [p.name if p.default is p.empty else f"[{p.name}]" for p in parameters]
        return f"it is called as AS {name}({', '.join(names)})" if names else "leave them out"

    def list_hidden_columns(self) -> dict[str, str]:
        """What representations request beside the columns, by name; see `request_hidden_columns`."""
        found = {name: getattr(function, HIDDEN_COLUMNS_ATTRIBUTE, "") for name, function in self.functions.items()}
        return {name: wanted for name, wanted in found.items() if wanted}

    def is_built_in(self, form: plan.Representation) -> bool:
        """Whether the representation is one of the language, not replaced by the user."""
        return self.functions.get(form.name) is representations.ALL.get(form.name)

    def make_language_value(self, name: str, value: Any) -> Any:
        """A representation's value as scripts go on with it; what the user's own made stays the object that it is."""
        if name in BUILT_IN_FORMS or isinstance(value, PLAIN_TYPES):
            return convert_value(value, f"AS {name}")
        try:
            hash(value)
        except TypeError:
            return Opaque(value)
        return value


def represent_starred_columns(query: plan.Query, rows: Rows, check: Check | None = None) -> Rows:
    """The rows of a query, with those columns taken apart that SELECT * could not know beforehand."""
    stars = frozenset(index for index, output in enumerate(query.columns) if output.star)
    return rows.expand_stars(stars, check) if stars else rows


def _split_into_portions(some: Iterable[Path]) -> Iterator[list[Path]]:
    """Lists of rows or paths with some thousand cells or rows together; one that has as many alone stands alone."""
    portion: list[Path] = []
    room = ITEMS_PER_CHECK
    for one in some:
        room -= len(one) + 1
        if room < 0 and portion:
            yield portion
            portion, room = [], ITEMS_PER_CHECK - len(one) - 1
        portion.append(one)
    if portion:
        yield portion


def _make_group_key(value: Any, form: plan.Representation) -> Any:
    own = copy_for_python(value)
    try:
        hash(own)
    except Exception as error:
        hint = "group by its parts, or by its text"
        raise RepresentationError(
            "V001", f"{format_value(own)} cannot be the key of a group", form.span, (hint,)
        ) from error
    return own
