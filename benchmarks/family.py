"""What this process and those that it has started have taken: Spark works in others. Linux only."""

from __future__ import annotations

import os
import re
from pathlib import Path

TICKS = os.sysconf("SC_CLK_TCK")


def processor() -> float:
    """Seconds of the processor of all of them, also of those that have ended and were waited for."""
    return sum(sum(map(int, fields[11:15])) for fields in _family().values()) / TICKS


def peak() -> float:
    """The sum of the most memory that each of them has held, in MB; those that have ended count no more."""
    total = 0
    for number in _family():
        try:
            found = re.search(r"VmHWM:\s+(\d+) kB", Path(f"/proc/{number}/status").read_text())
        except OSError:  # it has ended meanwhile
            continue
        total += int(found[1]) if found else 0
    return total / 1024


def _family() -> dict[int, list[str]]:
    """What /proc tells of the processes, from their state on."""
    every: dict[int, list[str]] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                every[int(entry.name)] = (entry / "stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue
    own, found = os.getpid(), dict[int, list[str]]()
    waiting = [own]
    while waiting:
        parent = waiting.pop()
        found[parent] = every[parent]
        waiting += [number for number, fields in every.items() if int(fields[1]) == parent]
    return found
