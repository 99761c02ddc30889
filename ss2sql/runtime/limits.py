"""What a session allows each of its runs, whatever the script: bounds for scripts of strangers."""

from __future__ import annotations

from ss2sql.errors import SessionError
from ss2sql.records import dataclass
from ss2sql.runtime.option_checks import check_bound
from ss2sql.runtime.run import memory_in_use
from ss2sql.runtime.sizes import LEAST, MOST


@dataclass(frozen=True, slots=True)
class Limits:
    """See `connect`, which documents each of them. None is no limit."""

    max_size: int = MOST
    max_memory: int | None = None
    max_steps: int | None = None
    max_output: int | None = None

    def check(self) -> None:
        """Raises SessionError S002 for limits that make no sense, or that cannot be kept here."""
        check_bound("max_size", self.max_size, LEAST)
        if self.max_size is None or self.max_size > MOST:
            raise SessionError("S002", f"max_size is at most {MOST}, not {self.max_size!r}")
        check_bound("max_memory", self.max_memory, 1)
        check_bound("max_steps", self.max_steps, 0)
        check_bound("max_output", self.max_output, 0)
        if self.max_memory is not None and memory_in_use() is None:
            hint = "bound the process from outside"
            message = "max_memory needs /proc/self/statm, which this system does not have"
            raise SessionError("S002", message, hints=(hint,))


NO_LIMITS = Limits()
