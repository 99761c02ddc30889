"""The variables of a session: what scripts assign, what Python sets or attaches, and temporal variables."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, Protocol

from ss2sql.errors import ExecutionError
from ss2sql.frontend.syntax import ast
from ss2sql.language import plan
from ss2sql.language.kinds import Type
from ss2sql.language.values import convert_value, copy_for_python
from ss2sql.runtime.run.run_state import Run
from ss2sql.session.temporal_variables import TemporalFile, TemporalStore
from ss2sql.vtables.attached_worlds import AttachedWorld
from ss2sql.vtables.frames import Frame, Reader


class OtherTables(Protocol):
    """The tables of the engine's own database."""

    def find_variable(self, name: str) -> str | None:
        """The variable as which the table `name` or `schema.name` is read, if there is one; scripts cannot name it."""

    def find_reader(self, variable: str) -> Reader | None:
        """The reader of the table of such a variable, if there is one."""

    def list_names(self) -> list[str]:
        """The tables that need no schema before their names."""

    def read_columns(self, name: str) -> tuple[tuple[str, Type], ...]:
        """The columns of the table `name` or `schema.name`; none if it is missing or unreadable."""


class Variables:
    """Values of the language by name.

    An attached object is read anew by every run, which then keeps what it has read. `late` holds list
    literals that are resolved where they are used. With a `file` temporal variables outlive the session.
    """

    def __init__(self, temporal_store: TemporalStore, file: TemporalFile | None = None) -> None:
        self.values: dict[str, Any] = {}
        self.attached: dict[str, Any] = {}
        self.worlds: dict[str, AttachedWorld] = {}  # those among what is attached
        self.frames: dict[str, Reader] = {}  # what reads the data frames among what is attached
        self.others: OtherTables | None = None  # what stands in FROM where nothing else has the name
        self.let_go: Callable[[AttachedWorld], None] = lambda world: None  # hears of worlds that make room
        self.late: dict[str, ast.ListLiteral] = {}
        self.temporal_store = temporal_store
        self.file = file
        self.values.update((name, temporal_store.get_latest(name)) for name in temporal_store.histories)

    def __contains__(self, name: str) -> bool:
        return name in self.values or name in self.attached

    def __iter__(self) -> Iterator[str]:
        yield from self.values
        yield from self.attached

    def get_value(self, name: str) -> Any:
        """The present value. Raises KeyError; ExecutionError X004 where an attached object holds no value."""
        source = self.get_source(name)
        return source.make_value() if isinstance(source, Frame) else source

    def get_source(self, name: str) -> Any:
        """The present value, or the data frame, as it stands in FROM. Raises what `value` raises."""
        if name in self.frames:
            return self.frames[name]()
        if name in self.attached:
            return convert_value(self.attached[name], f"the variable '{name}'", named=True)
        reader = None if self.others is None else self.others.find_reader(name)
        return self.values[name] if reader is None else reader()

    def is_frame(self, name: str) -> bool:
        """Whether a name stands for a data frame, or a table that is read as one."""
        return name in self.frames or (self.others is not None and self.others.find_reader(name) is not None)

    def read_value(self, name: str, run: Run) -> Any:
        """The value, or the data frame, in a run; raises ExecutionError R001 before the first assignment."""
        if name in run.snapshots:
            return run.snapshots[name]
        if name not in self and (self.others is None or self.others.find_reader(name) is None):
            hints = ("assign it before it is read",)
            raise ExecutionError("R001", f"the variable '{name}' has no value yet", hints=hints)
        value = self.get_source(name)
        if name in self.attached:
            # A function that the run calls may lengthen the list; the run keeps what it has read.
            value = run.snapshots[name] = list(value) if type(value) is list else value
        return value

    def copy_values(self) -> dict[str, Any]:
        """All script variables with copies of their values, sorted by name."""
        return {name: copy_for_python(value) for name, value in sorted(self.values.items())}

    def assign_value(self, name: str, value: Any) -> None:
        self.forget_name(name)
        self.values[name] = value

    def attach_source(self, name: str, source: Any) -> None:
        self.forget_name(name)
        self.attached[name] = source

    def attach_world(self, name: str, world: AttachedWorld) -> None:
        self.attach_source(name, world.world)
        self.worlds[name] = world

    def attach_frame(self, name: str, source: Any, reader: Reader) -> None:
        self.attach_source(name, source)
        self.frames[name] = reader

    def bind_late(self, name: str, literal: ast.ListLiteral) -> None:
        self.forget_name(name)
        self.late[name] = literal

    def forget_name(self, name: str) -> None:
        """Prepares a name for a new meaning. Raises ExecutionError X009, without a change, if the file fails."""
        if name in self.temporal_store.histories:
            self._change_history(name, lambda: self.temporal_store.drop_history(name))
        self._drop_meaning(name)

    def _drop_meaning(self, name: str) -> None:
        """Forgets the meaning of the name, but not its history."""
        self.values.pop(name, None)
        self.attached.pop(name, None)
        self.frames.pop(name, None)
        world = self.worlds.pop(name, None)
        if world is not None:
            self.let_go(world)
        self.late.pop(name, None)

    def clear_variables(self) -> None:
        for name in [*self.values, *self.late]:
            self.forget_name(name)

    # --- temporal variables ----------------------------------------------------------------------------

    def read_temporal(self, name: str, when: Any) -> Any:
        """`name{when}`; raises ExecutionError X007 if the variable is not temporal."""
        if name not in self.temporal_store.histories:
            hint = f"store it with {name}{{5.0}} = ..."
            raise ExecutionError("X007", f"'{name}' is not a temporal variable", hints=(hint,))
        return self.temporal_store.read_values(name, when)

    def store_temporal(self, name: str, keep: Any, value: Any) -> None:
        """`name{keep} = value`. Raises as `forget_name` does, and X007 for a wrong time."""
        self._change_history(name, lambda: self.temporal_store.store_value(name, keep, value))
        self._drop_meaning(name)
        self.values[name] = value

    def _change_history(self, name: str, change: Callable[[], None]) -> None:
        """Changes a history, also in the file; an error leaves it as it was."""
        if self.file is None:
            change()
            return
        before = self.temporal_store.get_history(name)
        change()
        try:
            self.file.save_history(self.temporal_store, name)
        except BaseException:
            self.temporal_store.restore_history(name, before)
            raise


def predict_values(
    names: Variables, assigned: Mapping[str, plan.Constant | None], values: Mapping[str, Any]
) -> Callable[[str], Any]:
    """The values that variables will have after the statements before; KeyError if they are not known."""

    def get_variable(name: str) -> Any:
        if name in assigned:
            constant = assigned[name]
            if constant is None:
                raise KeyError(name)
            return constant.value
        return values[name] if name in values else names.get_source(name)

    return get_variable
