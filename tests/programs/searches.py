"""Random hierarchical queries: every order, every option in its legal combinations, always finite."""

from __future__ import annotations

import re

from .expressions import EVERYTHING, PLAIN, Sight, key_of
from .flat import Flat
from .machines import MACHINES, Machine, floats, towers, words

ORDERS = (
    (6, ""), (22, "DEPTH FIRST"), (22, "BREADTH FIRST"), (8, "COST"), (26, "COST HEURISTIC"), (22, "PROBABILITY"),
)  # fmt: skip
GUARDS = ((34, ""), (21, "NO CYCLE"), (23, "UNIQUE"), (18, "MEMORIZE"), (4, "NO CYCLE UNIQUE"))


Pair = tuple[str, str]


class Searches(Flat):
    """Writes hierarchical queries."""

    def search(self, sight: Sight | None = None) -> str:
        """A whole query with CONNECT BY, over one of the machines."""
        c = self.choices
        machine = c.weighted(*((2 if make in (towers, words, floats) else 1, make) for make in MACHINES))(c)
        self.needs(machine)
        order, guard = c.weighted(*ORDERS), c.weighted(*GUARDS)
        bare = c.chance(13)  # no option at all
        if bare:
            order = guard = ""
        if guard == "MEMORIZE":
            order = {"COST HEURISTIC": "COST", "DEPTH FIRST": "", "BREADTH FIRST": ""}.get(order, order)
        sight = sight or Sight()
        for text in machine.ints:
            sight.add(text, "int")

        exact = bool(guard) and not c.chance(15)  # the row decides what its step leads to
        if order == "COST HEURISTIC" and guard in ("UNIQUE", "NO CYCLE UNIQUE"):
            exact = True
        levels = 0 if exact and order == "COST HEURISTIC" and guard != "NO CYCLE" else self.levels(machine, guard)
        start, connect = self.state(machine, sight, levels)
        grouped = c.chance(14 if guard else 52)
        self.templates = PLAIN if grouped else EVERYTHING
        where, stop = self.conditions(machine, sight, levels, exact)
        shown, ending = self.shown(machine, sight, exact, levels) if not grouped else self.parted(machine, sight, guard)
        self.templates = EVERYTHING
        names = ["void", "value", "val"] if "this" in shown else ["val", "set", "set"]
        representation = f" AS {c.pick(('list', 'dict', 'rows', *names))}" if c.chance(75) else ""
        options = "" if bare else self.options(machine, order, guard)
        return (
            f"SELECT {shown} FROM {machine.sources}{where} START WITH {assigned(start)} "
            f"CONNECT BY {options}{assigned(connect)}{stop}{ending}{representation}"
        )

    def needs(self, machine: Machine) -> None:
        """What the machine uses: functions, a statement before the query, the edges as a table or a variable."""
        self.uses.update(dict.fromkeys(machine.uses))
        self.statements += [machine.before] if machine.before else []
        if "edges" in machine.sources and "edges" not in self.tables and "edges" not in self.variables:
            rows = [
                {"src": self.choices.below(4), "dst": self.choices.below(4), "far": self.choices.pick((1, 2, 0, 3))}
                for _ in range(3 + self.choices.below(5))
            ]
            if self.choices.chance(50):
                self.tables["edges"] = rows
            else:
                self.variables["edges"] = rows

    def levels(self, machine: Machine, guard: str) -> int:
        """The level at which every path stops; 0 where the guard alone keeps the search finite."""
        if guard in ("UNIQUE", "NO CYCLE UNIQUE", "MEMORIZE") and not self.choices.chance(25):
            return 0
        return 1 + self.choices.below({1: 8, 2: 7, 3: 5, 4: 4}[machine.legal])

    def state(self, machine: Machine, sight: Sight, levels: int) -> tuple[list[Pair], list[Pair]]:
        """START WITH and CONNECT BY: the machine's variables, the level, and now and then a further variable."""
        start, connect = list(machine.start), list(machine.connect)
        if levels:
            sight.add("level", "int")
            start.append(("level", "1"))
            connect.append(("level", "level + 1"))
        if self.choices.chance(20) and "add" not in machine.uses:
            first, after = self.choices.pick((("[]", "trail + [[len(trail)]]"), ("'x'", "trail + 'y'")))
            sight.add("len(trail)", "int")
            start.append(("trail", first))
            connect.append(("trail", after))
        return start, connect

    def conditions(self, machine: Machine, sight: Sight, levels: int, exact: bool) -> tuple[str, str]:
        """WHERE and STOP WITH."""
        c = self.choices
        goals = machine.goals if exact else (*machine.goals, *machine.loose_goals)
        stops = machine.stops if exact else (*machine.stops, *machine.loose_stops)
        if not exact and c.chance(20):
            goals = (self.expr("bool", sight, 2), f"{machine.goals[0]} OR {self.expr('bool', sight, 1)}")
        parts = [machine.must_stop] if machine.must_stop else []
        parts += [f"level >= {levels}"] if levels else []
        parts += [c.pick(stops)] if c.chance(35) else []
        goal = c.weighted((80, "{}"), (12, "NOT ({})"), (12, "({}) XOR {}"))
        where = "" if c.chance(15) else " WHERE " + re.sub("{}", lambda _: c.pick(goals), goal)
        return where, f" STOP WITH {' OR '.join(parts)}" if parts else ""

    def shown(self, machine: Machine, sight: Sight, exact: bool, levels: int) -> tuple[str, str]:
        """SELECT, and the clauses that end the query."""
        c = self.choices
        columns = list(machine.row) if exact or c.chance(60) else []
        columns += [c.pick(machine.others)] if not columns or (not exact and c.chance(40)) else []
        columns += [self.special(sight)] if levels and not exact and c.chance(30) else []
        columns += ["level"] if levels and not exact and c.chance(20) else []
        columns = ["1"] if c.chance(3) else columns  # equal rows
        order = ""
        if c.chance(20):
            order = f"ORDER BY {key_of(c.pick((*machine.ints, *machine.row, *machine.others)))}{c.pick(('', ' DESC'))}"
        clauses = c.shuffled([clause for clause in (order, self.limit()) if clause])
        return ", ".join(columns), "".join(f" {clause}" for clause in clauses)

    def parted(self, machine: Machine, sight: Sight, guard: str) -> tuple[str, str]:
        """SELECT and the ending of a search with GROUP BY: rows of aggregates, or partitions of paths."""
        c = self.choices
        key = c.pick((*machine.ints, *machine.others[:1]))
        having = f" HAVING count(*) {c.pick(('>', '<='))} {c.below(3)}" if c.chance(55) else ""
        if not guard and c.chance(75):
            aggregates = ", ".join(self.aggregate(sight) for _ in range(1 + c.below(2)))
            order = c.pick(("", f" ORDER BY {key_of(key)} DESC", " ORDER BY count(*)"))
            return f"{key}, {aggregates}", f" GROUP BY {key}{having}{order}"
        # The key stands in a list, so that no column is made of it.
        order = f" ORDER BY {key_of(c.pick(machine.ints or machine.row))}" if c.chance(30) else ""
        return ", ".join(machine.row), f" GROUP BY [{key}, 'key']{having}{order}"

    def options(self, machine: Machine, order: str, guard: str) -> str:
        """The options of CONNECT BY, in any order."""
        c = self.choices
        options = [order] if order in ("DEPTH FIRST", "BREADTH FIRST") else []
        if order.startswith("COST"):
            options.append(f"COST {'-1' if c.chance(2) else c.pick(machine.costs)}")
        if order == "COST HEURISTIC":
            options.append(f"HEURISTIC {c.pick(machine.bounds)}")
        if order == "PROBABILITY":
            options.append(f"PROBABILITY {'1.5' if c.chance(2) else c.pick(machine.chances)}")
        if guard == "MEMORIZE":
            options.append(f"MEMORIZE {c.pick(('3', '4', '(1 + 1)', '5', '1'))}")
        else:
            options += {"": [], "NO CYCLE UNIQUE": ["NO CYCLE", "UNIQUE"]}.get(guard, [guard])
        if c.chance(25):
            options.append(f"MAXIMUM {c.pick(('2', '1', '3', '5', '(2 * 2)', '40'))}")
        return "".join(f"{option} " for option in c.shuffled(options))


def assigned(pairs: list[Pair]) -> str:
    return ", ".join(f"{name} = {text}" for name, text in pairs)
