"""Random queries in which almost every part may fail, so that what is evaluated, and before what, shows.

The queries stand inside each other, in FROM and in expressions, and mention what is around them; their conditions read
rows, or none at all; their sources have few elements, or none. `FailingPrograms` writes them by the dice.
"""

from __future__ import annotations

from random import Random

from programs.case import ProgramCase
from programs.expressions import key_of

VARIABLES = {"one": 1, "zero": 0, "some": [1, 2], "others": [0, 3], "digits": "01z3"}
TABLES = {"t": [{"u": 1, "v": 2}, {"u": 2, "v": 0}]}
USES = ("picky", "lookup", "nothing", "pair")

VALUES = (
    *("{x}", "{x}", "{x}", "1 / ({x} - {c})", "7 % ({x} - {c})", "int(digits[{x}])", "{x} + {y}", "div({y}, {x})"),
    *("IF({x} > {c}; {y}; 1 / ({x} - {c}))", "IF(one > 2; 1 / {x}; {y})", "abs({x})", "str({x})", "{x} * 1.5", "None"),
    *("picky({x})", "lookup({y})", "nothing({x})", "IF({x} == None; 0; {x})"),
)
CONSTANTS = ("one > 2", "one < 2", "1 > 2", "zero == 0", "one IN [2, 3]", "True", "False", "1 / zero > 1", "None")
LISTS = ("[]", "some", "some", "[2, 1]", "[1]", "range(3)", "[0, 1, 2]", "others")
OPTIONS = (
    *("", "UNIQUE", "NO CYCLE", "DEPTH FIRST", "MAXIMUM 2"),
    *("BREADTH FIRST", "COST 1", "COST one UNIQUE", "COST 1 / n"),
)
MOST_PARTS = (1, 1, 2, 2, 3)
Names = list[str]


class FailingPrograms:
    """Writes programs; `case` gives the next one."""

    def __init__(self, dice: Random) -> None:
        self.dice = dice
        self.sources = 0  # so far, for their names

    def case(self) -> ProgramCase:
        """A query with everything that it needs."""
        self.sources = 0
        representation = self.dice.choice(["list", "rows", "rows"])
        script = self.query(self.dice.choice([0, 1, 1, 2]), [], representation, self.happens(0.25))
        return ProgramCase(script, VARIABLES, USES, TABLES)

    def happens(self, chance: float) -> bool:
        return self.dice.random() < chance

    # --- expressions -----------------------------------------------------------------------------------

    def value(self, names: Names, depth: int = 0) -> str:
        """Mostly a number, or what fails; it mentions some of these names."""
        if depth and self.happens(0.12):
            return f"len({self.query(depth - 1, names, 'list')})"
        x = self.dice.choice(names) if names and self.happens(0.75) else self.dice.choice(["one", "2", "0", "zero"])
        y = self.dice.choice(names) if names and self.happens(0.6) else self.dice.choice(["one", "2", "zero"])
        return self.dice.choice(VALUES).format(x=x, y=y, c=self.dice.choice("0123"))

    def aggregate(self, names: Names) -> str:
        name = self.dice.choice(["count", "sum", "max", "min"])
        return "count(*)" if self.happens(0.4) else f"{name}({self.value(names)})"

    def condition(self, names: Names, depth: int = 0, values: Names | None = None) -> str:
        """Some comparisons, of `values` where they are given, and conditions that read no row."""
        found = ""
        for _ in range(self.dice.choice(MOST_PARTS)):
            link = f" {self.dice.choice(['AND', 'AND', 'OR', 'XOR'])} " if found else ""
            found += link + self.comparison(names, depth, values)
        return found

    def comparison(self, names: Names, depth: int, values: Names | None) -> str:
        if self.happens(0.2):
            return self.dice.choice(CONSTANTS)
        left = self.dice.choice(values) if values and self.happens(0.7) else self.value(names, depth)
        if self.happens(0.1):
            return f"{left} IN some"
        compared = f"{left} {self.dice.choice(['>', '==', '<', '>=', '!='])} "
        compared += self.dice.choice(["0", "1", "2", "one", "some[0]"])
        return f"NOT ({compared})" if self.happens(0.1) else compared

    # --- queries ---------------------------------------------------------------------------------------

    def query(self, depth: int, outer: Names, representation: str, search: bool = False) -> str:
        """A query, or a search; `outer` is what it may mention of the queries around it."""
        own: Names = []
        sources = [self.source(own, outer, depth) for _ in range(self.dice.choice(MOST_PARTS))]
        names = [*own, *(["n"] if search else []), *outer]
        where = f" WHERE {self.condition(names, depth)}" if self.happens(0.7) else ""
        columns = 1 if representation == "list" else 2
        if search:
            shown, ends = [self.value(names, depth) for _ in range(columns)], self.steps(own, names)
        elif self.happens(0.4):
            shown, ends = self.groups(columns, own, names, outer)
        else:
            shown = [self.value(names, depth) for _ in range(columns)]
            ends = f" ORDER BY {key_of(self.value(own))}" if self.happens(0.25) else ""
        ends += f" LIMIT {self.dice.choice(['1', '2', 'one', 'zero'])}" if self.happens(0.2) else ""
        return f"SELECT {', '.join(shown)} FROM {', '.join(sources)}{where}{ends} AS {representation}"

    def source(self, own: Names, outer: Names, depth: int) -> str:
        """The next source; what is read of it is added to `own`."""
        self.sources += 1
        name, before = f"s{self.sources}", list(own)
        own.append(f"{name}.this")
        match self.dice.choice(["list", "list", "list", "values", "values", "query", "call", "table"]):
            case "values":
                seen = self.dice.choice([[], before, outer, before + outer])
                return f"{name} = [{', '.join(self.value(seen) for _ in range(self.dice.choice([1, 2])))}]"
            case "query" if depth:
                return f"{name} = ({self.query(depth - 1, self.dice.choice([[], outer]), 'list')})"
            case "call":
                return f"{name} = pair({self.value(before)})"
            case "table":
                own[-1] = f"{name}.u"
                return f"{name} = t"
            case _:
                return f"{name} = {self.dice.choice(LISTS)}"

    def groups(self, columns: int, own: Names, names: Names, outer: Names) -> tuple[Names, str]:
        """The columns and the ends of a query with one row per group."""
        keys = [self.dice.choice(["1", "one", own[0], self.value(own)]) for _ in range(self.dice.choice([1, 2]))]
        seen = [self.aggregate(names), self.aggregate(names), keys[0]]
        chosen = f"IF({self.condition(outer, 0, keys)}; {seen[0]}; {seen[1]})"
        shown = [self.aggregate(names), *(self.dice.choice([*seen, chosen]) for _ in range(columns - 1))]
        ends = f" GROUP BY {', '.join(keys)}"
        ends += f" HAVING {self.condition(outer, 0, seen)}" if self.happens(0.6) else ""
        return shown, ends + (f" ORDER BY {key_of(self.dice.choice(seen))}" if self.happens(0.3) else "")

    def steps(self, own: Names, names: Names) -> str:
        """The clauses of a search, which comes to an end."""
        stop = self.dice.choice(["n > 2", "one > 2 OR n > 1", "n > 1 OR {0}", "n >= 1 AND {0} OR n > 2"])
        option, step = self.dice.choice(OPTIONS), self.dice.choice(["1", "one", own[0]])
        start = f" START WITH n = {self.value([])} CONNECT BY {option} n = n + {step}"
        return start + f" STOP WITH {stop.format(self.condition(names))}"
