"""Built-in functions that need the session: print, help, var, clear, getTime."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from inspect import signature
from typing import Any

from ss2sql.errors import ExecutionError, suggest_names
from ss2sql.errors.renderer import escape_controls
from ss2sql.frontend.user_functions import UserFunction
from ss2sql.language.operations import OPERATIONS, WRITTEN
from ss2sql.language.values import copy_for_python
from ss2sql.runtime.run.option_checks import Limits
from ss2sql.runtime.run.run_state import Run
from ss2sql.runtime.run.value_sizes import ValueSizes
from ss2sql.session.variables import Variables
from ss2sql.session.world_description import describe_world


class SessionFunctions:
    """Methods named after the functions of the language."""

    def __init__(
        self,
        names: Variables,
        functions: Mapping[str, UserFunction],
        world_functions: Mapping[str, UserFunction],
        limits: Limits,
        active_runs: Sequence[Run],
    ) -> None:
        self.names = names
        self.limits = limits
        self.active_runs = active_runs  # the runs of the session, the outermost first
        self.functions = functions
        self.world_functions = world_functions

    def get_function(self, name: str) -> Callable[..., Any]:
        """The Python form of a built-in function that needs the session."""
        found: Callable[..., Any] = getattr(self, f"_{name}")
        return found

    def _print(self, *values: Any) -> Any:
        """Prints the values with blanks between them and gives the last one."""
        text = " ".join(escape_controls(str(copy_for_python(value))) for value in values)
        if self.limits.max_output is not None and self.active_runs:
            run = self.active_runs[0]
            run.printed += len(text) + 1
            if run.printed > self.limits.max_output:
                message = f"the script printed more than max_output={self.limits.max_output} characters"
                raise ExecutionError("X015", message, hints=("print less, or raise max_output",))
        print(text)
        return values[-1] if values else None

    def _help(self, name: Any = None) -> str:
        world = next((known for known in self.names.worlds.values() if name in (known.world, known.name)), None)
        if world is not None and name not in self.functions:
            return describe_world(world)
        if name is None:
            lines = [f"{known:<12} {text}" for known, text in sorted(self._describe_all().items())]
            return "\n".join(lines)
        texts = self._describe_all()
        if type(name) is not str or name not in texts:  # a list could not even be looked up
            hints = suggest_names(str(name), texts) or ("help() lists all of them",)
            raise ExecutionError("X007", f"there is no function '{name}'", hints=hints)
        return f"{self._format_call(name)}: {texts[name]}"

    def _format_call(self, name: str) -> str:
        entry = self.functions.get(name) or self.world_functions.get(name)
        if entry is None:
            return OPERATIONS[name].call
        try:
            return f"{name}({', '.join(signature(entry.function).parameters)})"
        except (TypeError, ValueError):  # functions in C may have no signature
            return name

    def _describe_all(self) -> dict[str, str]:
        texts = {name: row.about for name, row in WRITTEN.items() if name not in ("item", "slice")}
        for name, entry in {**self.world_functions, **self.functions}.items():
            lines = (entry.function.__doc__ or "").strip().splitlines() or ["registered"]
            texts[name] = f"{lines[0]} ({entry.volatility}: {entry.reason})"
        return texts

    def _var(self, name: str | None = None) -> Any:
        if name is None:
            ValueSizes(self.limits.max_size).check_value(self.names.values)
            return self.names.copy_values()
        variables = self.names.values
        if type(name) is not str or name not in variables:
            hints = suggest_names(str(name), variables) or ("var() gives all of them",)
            raise ExecutionError("X007", f"there is no variable '{name}'", hints=hints)
        return copy_for_python(variables[name])

    def _clear(self) -> None:
        self.names.clear_variables()

    def _getTime(self) -> float:  # noqa: N802 - the language's name
        return self.names.temporal_store.clock()

    def _eval(self, text: str) -> Any:
        raise AssertionError("eval is a construct of the plan, not a call")

    _to = _eval
