"""Random programs: one or more statements around queries, searches and expressions."""

from __future__ import annotations

from typing import Any

from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy

from .case import ProgramCase
from .choices import Choices
from .expressions import Sight
from .searches import Searches

DECISIONS = 320  # bytes per program; when they are used up the rest is as simple as it can be

FORMS = (
    (78, "flat"), (108, "search"), (12, "expression"), (16, "assigning"), (10, "late"), (10, "named"),
    (8, "inner search"), (12, "two"),
)  # fmt: skip


def programs() -> SearchStrategy[ProgramCase]:
    """Programs that end, with small products and searches, in which all evaluators must agree.

    A program is made of a fixed number of drawn bytes; lower bytes make a simpler program.
    """
    return st.binary(min_size=DECISIONS, max_size=DECISIONS).map(program)


def program(data: bytes) -> ProgramCase:
    """The program that the bytes stand for."""
    writer = Scripts(Choices(data))
    last = writer.last(writer.choices.weighted(*FORMS))
    if writer.choices.chance(4):
        writer.uses["add"] = None
    script = "".join(writer.statements) + last
    variables = {}
    before = ""
    for name, value in writer.variables.items():
        if not has_dict(value) and writer.choices.chance(50):
            before += f"{name} = {value!r}; "
        else:
            variables[name] = value
    return ProgramCase(before + script, variables, tuple(writer.uses), writer.tables)


def has_dict(value: Any) -> bool:
    return isinstance(value, dict) or (isinstance(value, list) and any(has_dict(item) for item in value))


class Scripts(Searches):
    """Writes the last statement of a script, and those before it."""

    def last(self, form: str) -> str:
        match form:
            case "flat":
                return self.flat()
            case "search":
                return self.search()
            case "expression":
                return self.expression()
            case "assigning":
                return self.assigning()
            case "late":
                return self.late()
            case "named":
                return self.named()
            case "inner search":
                return self.inner_search()
            case _:
                self.statements.append(f"found = {self.flat_list()}; ")
                return f"SELECT this FROM found WHERE this != {self.expr('any', Sight(), 0)}"

    def flat_list(self) -> str:
        return self.nested(Sight(), "any", "list")

    def expression(self) -> str:
        """A statement without FROM of its own."""
        sight = Sight()
        form = self.choices.pick(
            (
                "{any}", "[{any}, {list}, {nested}]", "len({nested})", "{nested} == {nested}",
                "IF({bool}; {any}; {nested})",
            )
        )  # fmt: skip
        while "{" in form:
            head, _, tail = form.partition("{")
            kind, _, rest = tail.partition("}")
            written = self.flat_list() if kind == "nested" else self.expr(kind, sight, 3)
            form = f"{head}{written.replace('{', '')}{rest}"
        return form

    def assigning(self) -> str:
        """Variables that a query changes row by row, and what it prints."""
        c = self.choices
        text, own, _ = self.sources(Sight(), 1 + c.below(2))
        own.add("hits", "int")
        own.add("memo", "any")
        where = c.pick(
            (
                "(hits = hits + 1) > 1",
                f"IF({self.expr('bool', own, 1)}; hits = hits + 1, True; memo = {self.expr('any', own, 1)}, False)",
                f'print("row", hits = hits + 1) > 0 AND {self.expr("bool", own, 1)}',
                f"{self.expr('bool', own, 1)} OR (hits = hits + 2) % 3 == 0",
            )
        )
        shown = c.pick(
            (
                "hits",
                f"[hits, {self.expr('any', own, 1)}]",
                f"(memo = {self.expr('any', own, 1)})",
                f"(hits = hits + 1), {self.expr('any', own, 1)}",
            )
        )
        order = c.pick(("", " ORDER BY hits DESC", f" ORDER BY (hits = hits + {self.expr('int', own, 0)})"))
        self.statements.append("hits = 0; memo = None; ")
        self.statements.append(f"found = SELECT {shown} FROM {text} WHERE {where}{order} AS list; ")
        return "[hits, memo, found]"

    def late(self) -> str:
        """The paper's maps: a list of pairs of elements, written in the query or in a variable."""
        c = self.choices
        self.variable("xs")
        number = c.pick((2, 3))
        sources = ", ".join(f"{name} = xs" for name in "abc"[:number])
        pairs = c.some(("[a.this, b.this]", "[b.this, a.this]", "[a.this, 1]", "[a.this + 1, b.this]"), 1, 3)
        literal = f"[{', '.join(pairs)}]"
        if c.chance(70):
            self.statements.append(f"pairs = {literal}; ")
            literal = "pairs"
        test = c.pick(("this[0] == this[1]", "this[0] < this[1]", "this[0] IN this"))
        if c.chance(25):
            self.statements[-1:] = ['pairs = [["a", "b"], ["b", "a"]]; ']
            literal, test = "pairs", 'eval(this[0] + ".this;") == eval(this[1] + ".this;")'
        nested = f"(SELECT this FROM {literal} WHERE {test} AS list)"
        where = c.pick((f"[] == {nested}", f"len({nested}) > 0", f"{nested} != []", f"NOT {nested}"))
        shown = ", ".join(f"{name}.this" for name in "abc"[:number])
        return f"SELECT {shown} FROM {sources} WHERE {where}{c.pick(('', ' AS list', ' AS rows'))}"

    def named(self) -> str:
        """Names in every place where they mean something else."""
        c = self.choices
        self.variable("xs")
        self.variables.setdefault("rs", [{"k": "a", "v": 1, "xs": 7}, {"k": "b", "v": 2, "xs": None}])
        return c.pick(
            (
                "SELECT xs, k FROM rs AS rows",
                "SELECT a.v, b.this, xs FROM a = rs, b = xs AS rows",
                "SELECT k, (SELECT this FROM [1, 2] WHERE this == v AS list) FROM rs",
                "SELECT v FROM rs START WITH v = 5 CONNECT BY v = v + 1 STOP WITH v > 5",
                "SELECT (SELECT k FROM rs WHERE v == a.this AS value) FROM a = xs AS list",
                "SELECT list FROM rs WHERE True START WITH list = 1, level = 2 CONNECT BY list = 2 STOP WITH level",
                "value = 3; list = [value]; SELECT value, this FROM list AS list",
            )
        )

    def inner_search(self) -> str:
        """A search for each row of a query, or for each group."""
        self.variable("xs")
        if self.choices.chance(30):
            return self.search_of_a_group()
        sight = Sight()
        sight.add("a.this", "int")
        self.nesting += 1
        inner = self.search(sight)
        self.nesting -= 1
        if " AS set" in inner:
            inner = inner.replace(" AS set", " AS list")
        shape = self.choices.pick(("len", "uniq"))
        if "AS void" in inner or "GROUP BY" in inner:
            return f"SELECT this, ({inner}) FROM a = xs AS list"
        return f"SELECT this, {shape}(({inner})) FROM a = xs AS list"

    def search_of_a_group(self) -> str:
        """A search that reads the value of the group, in any of its clauses."""
        c = self.choices
        row = c.pick(("(pos + d.this) % 5", "(pos + d.this * a.this) % 5"))
        options = c.pick(("NO CYCLE", "UNIQUE", "MEMORIZE 3", "COST abs(a.this) + 1 UNIQUE", "PROBABILITY 0.5 UNIQUE"))
        goal = c.pick(("pos != a.this", "len([a.this]) == 1", "NOT pos == 0"))
        inner = (
            f"SELECT {row} FROM d = {c.pick(('[1, 2]', '[a.this, 1]', 'xs'))} WHERE {goal} "
            f"START WITH pos = {c.pick(('0', 'a.this % 5'))} CONNECT BY {options} pos = {row}"
            f"{c.pick(('', ' STOP WITH pos == a.this'))} AS list"
        )
        having = c.pick(("", " HAVING count(*) > 1", " HAVING a.this != 1"))
        return f"SELECT count(*), ({inner}) FROM a = xs GROUP BY a.this{having} AS list"
