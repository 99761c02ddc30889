"""Random flat queries: sources, every clause, every representation, nested and correlated queries."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

from .choices import Choices
from .expressions import EVERYTHING, PLAIN, Expressions, Sight, key_of

INTS = (1, 2, 3, 0, -1, 4, 2)
NUMS = (1, 0.5, 1.0, 2, 2.5, True, 0)
MIXED: tuple[Any, ...] = (None, 1, 1.0, True, "a", [1], [1.0], 0, "", [], [[]], 2.5, "1")

BARE_THIS = re.compile(r"(?<!\.)\bthis\b")  # means another element in a query inside

# How the parts of a condition are joined; mostly not at all.
CONDITIONS = ((44, ""), (6, "{} AND {}"), (6, "{} OR {}"), (24, "{} XOR {}"), (20, "NOT {}"))

# Columns of functions that are seldom called otherwise: read late, volatile, raising, of opaque objects.
SPECIAL = (
    (34, "tick()"), (34, "blink({int})"), (14, 'eval("{int} + 1")'), (11, "picky({int})"), (5, "lookup({int} % 4)"),
    (5, "strange({int})"), (13, "body({int})"), (13, "box({int})"), (40, 'print("row", {any})'),
)  # fmt: skip

# Variables: the kind of their elements, and how their values are made.
VARIABLES: dict[str, tuple[str, Callable[[Choices], Any]]] = {
    "xs": ("int", lambda c: c.some(INTS, 1, 5)),
    "ys": ("int", lambda c: c.some(INTS, 0, 4)),
    "fs": ("num", lambda c: c.some(NUMS, 1, 5)),
    "bs": ("bool", lambda c: c.some((True, False), 1, 3)),
    "ss": ("str", lambda c: c.some(("a", "b", "ab", "", "c", "ü"), 1, 4)),
    "ms": ("any", lambda c: c.some(MIXED, 1, 5)),
    "ls": ("list", lambda c: [c.some(INTS, 0, 3) for _ in range(1 + c.below(3))]),
    "ps": ("list", lambda c: [c.some(INTS, 2, 2) for _ in range(1 + c.below(4))]),
    "n": ("int", lambda c: c.pick(INTS)),
    "word": ("str", lambda c: c.pick(("ab", "", "c"))),
}
ROW_KINDS = {"k": "str", "v": "maybe", "l": "list"}
COLUMN_KINDS = {"p": "int", "q": "str"}
TABLE_KINDS = {"id": "int", "label": "str", "weight": "any"}


def rows(choices: Choices) -> list[dict[str, Any]]:
    """Rows of which the first has every column; a later one may lack one."""
    made = []
    for number in range(1 + choices.below(4)):
        row = {
            "k": choices.pick(("a", "b", "")),
            "v": choices.pick((1, None, 2, 3)),
            "l": choices.some(INTS, 0, 2),
        }
        if number and choices.chance(20):
            del row[choices.pick(("v", "k", "l"))]
        made.append(row)
    return made


def columns(choices: Choices) -> dict[str, list[Any]]:
    number = choices.below(4)
    return {"p": choices.some(INTS, number, number), "q": choices.some(("a", "b"), number, number)}


def table(choices: Choices) -> list[dict[str, Any]]:
    return [
        {"id": number, "label": choices.pick(("a", "b", "c")), "weight": choices.pick((0.5, None, 2.5))}
        for number in range(1 + choices.below(4))
    ]


@dataclass(frozen=True)
class Origin:
    """A source as it is written in FROM."""

    text: str
    name: str | None
    kind: str
    columns: dict[str, str] = field(default_factory=dict)
    known: bool = True  # whether its columns are known before the run
    optional: bool = False  # joined with LEFT JOIN


class Flat(Expressions):
    """Writes flat queries, and remembers the variables and tables that a program needs."""

    def __init__(self, choices: Choices) -> None:
        super().__init__(choices)
        self.variables: dict[str, Any] = {}
        self.tables: dict[str, list[dict[str, Any]]] = {}
        self.statements: list[str] = []  # what stands before the last statement
        self.nesting = 0

    def variable(self, name: str) -> str:
        if name not in self.variables:
            self.variables[name] = VARIABLES[name][1](self.choices)
        return name

    # Sources

    def origin(self, alias: str | None, sight: Sight) -> Origin:
        """One source. It may mention what is in sight: earlier sources of the same query, or rows around it."""
        choices = self.choices
        ints = [text for text in sight.texts["int"] if "(" not in text]
        if ints and choices.chance(75):
            return self.lateral(alias, choices.pick(ints))
        if sight.texts["any"] and choices.chance(30):
            return Origin(f"{f'{alias} = ' if alias else ''}[{choices.pick(sight.texts['any'])}, 1]", alias, "any")
        form = choices.weighted(
            (40, "variable"), (8, "literal"), (9, "rows"), (6, "columns"), (8, "table"), (9, "query"), (4, "call"),
            (3, "single"),
        )  # fmt: skip
        prefix = f"{alias} = " if alias else ""
        match form:
            case "variable":
                name = choices.pick(("xs", "ys", "fs", "ss", "bs", "ms", "ls", "ps", "xs", "ys"))
                return Origin(prefix + self.variable(name), alias or name, VARIABLES[name][0])
            case "rows":
                self.variables.setdefault("rs", rows(choices))
                return Origin(prefix + "rs", alias or "rs", "row", ROW_KINDS)
            case "columns" if choices.chance(20):
                self.variables.setdefault("one", {"p": choices.pick(INTS), "q": "a"})
                return Origin(prefix + "one", alias or "one", "row", COLUMN_KINDS)
            case "columns":
                self.variables.setdefault("cs", columns(choices))
                return Origin(prefix + "cs", alias or "cs", "row", COLUMN_KINDS)
            case "table":
                self.tables.setdefault("items", table(choices))
                return Origin(prefix + "items", alias or "items", "row", TABLE_KINDS)
            case "query":
                return self.inner_source(alias, sight)
            case "call":
                text = choices.pick(("range(3)", "range(1, 4)", "near(x = 1)", "range(4, 0, -2)", "near(2)"))
                return Origin(self.call(prefix + text), alias or text.split("(")[0], "int")
            case "single":
                name = choices.pick(("n", "word"))
                return Origin(prefix + self.variable(name), alias or name, VARIABLES[name][0])
            case _:
                texts = {
                    "int": ("[1, 2, 3]", "[2]", "[3, 1, 2, 1]"),
                    "num": ("[1, 1.0, 0.5]",),
                    "list": ("[[1], [2, 3]]",),
                }
                kind = choices.pick(("int", "num", "list"))
                return Origin(prefix + choices.pick(texts[kind]), alias, kind)

    def lateral(self, alias: str | None, value: str) -> Origin:
        prefix = f"{alias} = " if alias else ""
        form = self.choices.pick(("near", "range", "list", "query", "links"))
        if form == "links":
            return Origin(
                self.call(f"{prefix}links({value})"), alias or "links", "row", {"toll": "int", "to_node": "int"}, False
            )
        if form == "query":
            self.variable("xs")
            comparison = self.choices.pick(("this > ", "this == ", "this + 1 != "))
            return Origin(f"{prefix}(SELECT this FROM xs WHERE {comparison}{value} AS list)", alias, "int")
        text = {"near": f"near({value})", "range": f"range({value} % 4)", "list": f"[{value}, 1]"}[form]
        return Origin(self.call(prefix + text), alias or (None if form == "list" else form), "int")

    def inner_source(self, alias: str | None, sight: Sight) -> Origin:
        """A query as a source: a list of values, or rows with the columns of its SELECT."""
        prefix = f"{alias} = " if alias else ""
        if self.nesting < 2 and self.choices.chance(50):
            return self.inner_query(prefix, alias, sight)
        if self.choices.chance(40):
            self.variables.setdefault("rs", rows(self.choices))
            where = self.choices.pick(("", " WHERE v", " WHERE k != 'a'", " ORDER BY v DESC LIMIT 2"))
            shown = self.choices.pick(("k, v", "*", "to(v, v), k"))
            columns = ROW_KINDS if shown == "*" else {"k": "str", "v": "maybe"}
            text = f"(SELECT {shown} FROM rs{where}{self.choices.pick(('', ' AS dict'))})"
            return Origin(prefix + text, alias, "row", columns)
        self.variable("xs")
        where = self.choices.pick(("", " WHERE this > 1", " ORDER BY this DESC", " LIMIT 2"))
        return Origin(
            f"{prefix}(SELECT {self.choices.pick(('this', 'this * 2', 'this % 2'))} FROM xs{where} AS list)",
            alias,
            "int",
        )

    def inner_query(self, prefix: str, alias: str | None, sight: Sight) -> Origin:
        """The same with parts that are drawn as those of other queries, so that they may fail and mention rows."""
        choices = self.choices
        self.nesting += 1
        text, own, _ = self.sources(sight, choices.weighted((4, 1), (1, 2)))
        where = f" WHERE {self.condition(own, 1)}" if choices.chance(50) else ""
        ending = choices.weighted((6, ""), (2, f" ORDER BY {key_of(self.expr('int', own, 1))}"), (2, " LIMIT 2"))
        kinds = choices.some(("int", "num", "str", "any"), 1, 2)
        shown = [self.expr(kind, own, 2) for kind in kinds]
        self.nesting -= 1
        if choices.chance(30):
            return Origin(f"{prefix}(SELECT {shown[0]} FROM {text}{where}{ending} AS list)", alias, kinds[0])
        columns = dict(zip("kv", kinds, strict=False))
        named = ", ".join(f"to({column}, {name})" for column, name in zip(shown, columns, strict=True))
        return Origin(f"{prefix}(SELECT {named} FROM {text}{where}{ending})", alias, "row", columns)

    def sources(self, sight: Sight, number: int) -> tuple[str, Sight, list[Origin]]:
        """FROM with a number of sources, and what its query sees."""
        aliases = "abc" if self.nesting == 0 else ("de" if self.nesting == 1 else "fg")
        origins: list[Origin] = []
        own = Sight({kind: [text for text in texts if "." in text] for kind, texts in sight.texts.items()})
        for i in range(number):
            named = number > 1 or self.choices.chance(40)
            origin = self.origin(aliases[i] if named else None, own)
            origins.append(origin)
            own = self.see(origins)
        outer = sight.inner([o.name for o in origins if o.name], [name for o in origins for name in o.columns])
        for kind, texts in outer.texts.items():
            own.texts[kind].extend(texts)
        text = origins[0].text
        for number, origin in enumerate(origins[1:], 1):
            join = self.choices.weighted((70, ","), (15, " JOIN"), (15, " LEFT JOIN"))
            origins[number] = replace(origin, optional=join == " LEFT JOIN")
            text += f"{join} {origin.text}"
            if join != ",":  # sees the sources up to it
                seen = self.see(origins[: number + 1])
                text += f" ON {self.leaf('int', seen)} {self.choices.pick(('==', '!='))} {self.leaf('int', seen)}"
        return text, own, origins

    @staticmethod
    def see(origins: list[Origin]) -> Sight:
        """What is read of the sources of one query."""
        sight = Sight()
        for number, origin in enumerate(origins):
            if number == 0:
                sight.add("this", origin.kind)
            if origin.name is not None:
                sight.add(f"{origin.name}.this", origin.kind)
            for column, kind in origin.columns.items():
                owners = sum(column in other.columns for other in origins)
                if owners == 1 and origin.known:
                    sight.add(column, kind)
                if number == 0:
                    sight.add(f"this['{column}']", kind)
                if origin.name is not None:
                    sight.add(f"{origin.name}.{column}", kind)
        return sight

    # Queries

    def condition(self, sight: Sight, depth: int = 2) -> str:
        if self.nesting < 2 and self.choices.chance(12):
            return self.nested_condition(sight)
        if self.choices.chance(10):  # what a database may look up
            return f"{self.leaf('int', sight)} == {self.leaf('int', sight)}"
        form = self.choices.weighted(*CONDITIONS)
        return re.sub("{}", lambda _: self.expr("bool", sight, depth - 1), form) or self.expr("bool", sight, depth)

    def nested_condition(self, sight: Sight) -> str:
        kind, value = self.choices.pick((("int", "int"), ("any", "any")))
        inner = self.nested(sight, kind, "list")
        form = self.choices.pick(("{v} IN {q}", "[] == {q}", "len({q}) > {i}", "{v} NOT IN {q}", "{q} != [{v}]"))
        return "(" + form.format(q=inner, v=self.expr(value, sight, 1), i=self.choices.below(3)) + ")"

    def nested(self, sight: Sight, kind: str, form: str) -> str:
        """A query in parentheses that may mention the rows around it."""
        self.nesting += 1
        text, own, _ = self.sources(sight, 1)
        where = f" WHERE {self.condition(own, 1)}" if self.choices.chance(70) else ""
        column = self.expr(kind, own, 1)
        order = f" ORDER BY {key_of(self.expr('int', own, 0))}" if self.choices.chance(20) else ""
        self.nesting -= 1
        return f"(SELECT {column} FROM {text}{where}{order} AS {form})"

    def column(self, sight: Sight) -> str:
        """One column of SELECT."""
        choices = self.choices
        form = choices.weighted(
            (60, "any"), (10, "nested"), (8, "to"), (6, "value"), (12, "row"), (10, "print"), (96, "special")
        )
        if form == "nested" and self.nesting < 2:
            return self.nested(sight, "int", "list")
        if form == "value" and self.nesting < 2:
            return self.nested(sight, "int", choices.pick(("value", "val")))
        if form == "to":
            name = choices.pick(("total", "'x' + 'y'", "k", '"label"'))
            return f"to({self.expr('any', sight, 1)}, {name})"
        if form == "row" and sight.texts["row"]:
            return choices.pick(sight.texts["row"])
        if form == "print" and self.nesting == 0:
            return f'print("row", {self.expr("any", sight, 1)})'
        if form == "special" and self.templates is EVERYTHING and self.nesting == 0:
            return self.special(sight)
        return self.expr("any", sight, choices.below(3))

    def special(self, sight: Sight) -> str:
        """A call of a function of SPECIAL."""
        text = self.choices.weighted(*SPECIAL)
        return self.call(re.sub(r"\{(\w+)\}", lambda hole: self.leaf(hole[1], sight), text))

    def flat(self, sight: Sight | None = None) -> str:
        """A whole query without CONNECT BY."""
        choices = self.choices
        grouped = choices.chance(44)
        text, own, origins = self.sources(sight or Sight(), choices.weighted((45, 1), (37, 2), (18, 3)))
        self.templates = PLAIN if grouped else EVERYTHING
        where = f" WHERE {self.condition(own)}" if choices.chance(60) else ""
        if grouped:
            shown, rest = self.grouping(own)
        else:
            shown, rest = self.select_list(own, origins), [self.order(own), self.limit()]
            if choices.chance(12):
                shown, rest = self.named_columns(own)
        self.templates = EVERYTHING
        ending = "".join(f" {clause}" for clause in choices.shuffled([clause for clause in rest if clause]))
        return f"SELECT {shown} FROM {text}{where}{ending}{self.representation(own)}"

    def select_list(self, sight: Sight, origins: list[Origin]) -> str:
        choices = self.choices
        # Which columns a row without a match has depends on all other rows, where they are not known before.
        if choices.chance(21) and not any(origin.optional and not origin.known for origin in origins):
            return "*"
        if choices.chance(5) and origins[0].kind == "int":
            names = choices.some(("half", "even", "near"), 1, 2)
            self.uses.update(dict.fromkeys(names))
            return ", ".join(names)  # functions of `this`
        return ", ".join(self.column(sight) for _ in range(1 + choices.below(3)))

    def named_columns(self, sight: Sight) -> tuple[str, list[str]]:
        """Columns with names, by which their rows are sorted or told apart; or counts of all rows."""
        choices = self.choices
        if choices.chance(25):
            counts = [f"count(DISTINCT {self.expr('any', sight, 1)})", "count(*)", self.aggregate(sight)]
            return ", ".join(counts[: 2 + choices.below(2)]), []
        columns = [self.expr(choices.pick(("int", "num", "str")), sight, 1) for _ in range(1 + choices.below(2))]
        named = ", ".join(f"{column} AS {name}" for column, name in zip(columns, ("one", "two"), strict=False))
        order = choices.pick(("", "ORDER BY one", "ORDER BY one DESC"))
        return choices.pick(("DISTINCT ", "")) + named, [order, self.limit()]

    def order(self, sight: Sight) -> str:
        if not self.choices.chance(35):
            return ""
        kinds = self.choices.some(("int", "num", "maybe", "str", "list", "int"), 1, 2)
        keys = [key_of(self.expr(kind, sight, 1)) + self.choices.pick(("", " DESC", " ASC")) for kind in kinds]
        return "ORDER BY " + ", ".join(keys)

    def limit(self) -> str:
        if not self.choices.chance(25):
            return ""
        offset = self.choices.weighted((80, ""), (18, " OFFSET 1"), (2, " OFFSET -1"))
        return f"LIMIT {self.choices.pick(('2', '1', '3', '0', '1 + 1', '4', '2', '3', '5', '1', '8', '-1'))}{offset}"

    def representation(self, sight: Sight) -> str:
        names = ["list", "dict", "rows", "value", "val", "void", "List"]
        if not sight.texts["row"] and "box" not in self.uses:
            names += ["set", "Set", "set"]  # a dict has no fixed form in a Python set
        return f" AS {self.choices.pick(names)}" if self.choices.chance(75) else ""

    # Groups

    def key(self, sight: Sight) -> str:
        kinds = [kind for kind in ("int", "any", "bool", "str", "list", "maybe", "num") if sight.texts[kind]] or ["int"]
        return self.expr(self.choices.pick(kinds), sight, self.choices.below(2))

    def aggregate(self, sight: Sight) -> str:
        form = self.choices.weighted(
            (6, "count(*)"), (6, "sum({int})"), (4, "sum({num})"), (4, "count({maybe})"), (4, "min({int})"),
            (4, "max({maybe})"), (4, "average({num})"), (3, "sum({maybe})"), (2, "max({str})"), (1, "min({any})"),
            (3, "count(DISTINCT {maybe})"),
            (1, "sum(4611686018427387904 - ({int}))"),  # two of them overflow
            (1, "sum(1.7e308 - ({int}))"),
        )  # fmt: skip
        head, _, tail = form.partition("{")
        kind, _, rest = tail.partition("}")
        return head + self.expr(kind, sight, 1) + rest if tail else form

    def grouping(self, sight: Sight) -> tuple[str, list[str]]:
        """SELECT and the clauses after WHERE of a query with GROUP BY: one row per group, or partitions."""
        choices = self.choices
        partition = choices.chance(53)
        keys = [self.key(sight) for _ in range(choices.weighted((75, 1), (25, 2)))]
        if partition:
            keys = [f"[{key}]" if key.endswith("this") else key for key in keys]
        having = ""
        if choices.chance(60):
            tested = choices.pick((self.aggregate(sight), keys[0], "count(*)"))
            having = f" HAVING {tested} {choices.pick(('>', '==', '<=', '!='))} {choices.pick(('1', '2', '0'))}"
            if choices.chance(20):
                having += f" {choices.pick(('AND', 'OR'))} {self.aggregate(sight)} > 1"
        group = f"GROUP BY {', '.join(keys)}{having}"
        if partition:
            return self.partition_columns(sight), [group, self.order(sight), self.limit()]
        shown = [choices.pick((keys[0], keys[-1], self.aggregate(sight))) for _ in range(choices.below(2))]
        shown.append(choices.pick((self.aggregate(sight), f"(1 + {self.aggregate(sight)})", f"[{keys[0]}, count(*)]")))
        if choices.chance(10):
            shown.append("1 / (count(*) - 1)")
        if choices.chance(15) and "." in keys[0] and not BARE_THIS.search(keys[0]):
            self.variable("xs")
            shown.append(f"(SELECT [d.this, {keys[0]}] FROM d = xs WHERE d.this != {keys[0]} AS list)")
        if choices.chance(15):  # groups in a group, with an aggregate that looks like that around
            self.variable("xs")
            inner = "(SELECT [d.this, count(*)] FROM d = xs GROUP BY d.this HAVING count(*) > 0 AS list)"
            shown.append(choices.pick((inner, "count(SELECT d.this FROM d = xs AS list)")))
        ordering = choices.pick((self.aggregate(sight), keys[0]))
        order = f"ORDER BY {key_of(ordering)}{choices.pick(('', ' DESC'))}" if choices.chance(35) else ""
        return ", ".join(choices.shuffled(shown)), [group, order, self.limit()]

    def partition_columns(self, sight: Sight) -> str:
        """Columns of single rows: the first one surely is not made of keys."""
        surely = self.choices.pick(("this", "[this, 'row']"))
        return ", ".join([surely, *(self.expr("any", sight, 1) for _ in range(self.choices.below(2)))])
