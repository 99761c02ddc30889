"""Random queries over two or three tables that WHERE compares with each other, as lists or as tables."""

from __future__ import annotations

from hypothesis import strategies as st

from programs.case import ProgramCase

ROWS = st.lists(
    st.fixed_dictionaries(
        {
            "a": st.sampled_from((1, 2, 3, 0, -1)),
            "b": st.sampled_from((1, None, 2, 3)),
            "s": st.sampled_from(("a", "b", "ab", "", "ü")),
            "w": st.sampled_from((0.5, 1.0, 2.0, -0.0, 0.0)),
        }
    ),
    min_size=1,
    max_size=6,
)
FROM = ("x = t, y = u", "x = t, y = t", "x = t, y = u, z = t", "n = [1, 2], x = t, y = u", "x = t, n = [2, 3], y = u")
LINKS = (
    *("x.a == y.a", "y.s == x.s", "x.b == y.b", "x.w == y.w", "x.a + 1 == y.a", "x.a == y.w", "len(x.s) == y.a"),
    *("x.a == y.a OR x.s == y.s", "x.a < y.a", "x.a == y.b AND x.s != y.s"),
    *("x.w <= y.w", "y.w BETWEEN x.w - 1 AND x.a", "y.a > x.w AND x.a + 2 >= y.a", "x.s < y.s", "y.b > x.a"),
    *(
        "y.b != None AND y.b + 1 > x.a",
        "x.b != None AND y.b != None AND x.b + 1 == y.b",
        "y.b == None OR y.b * 2 > x.a",
    ),
    *(
        "y.b != None AND x.a IN [y.b + 1, y.b - 1]",
        "NOT (x.b == None OR y.a - x.b > 1)",
        "x.b == y.a AND x.b - 1 < y.w",
    ),
    *("abs(x.w - y.w) < 1", "abs(y.a - x.w) <= x.w", "0.5 > abs(x.w - y.a)"),
)
PARTS = (
    *("x.a > least", "y.b != None", "y.w >= 0.5", "x.s IN ['a', 'ü']", "10 / x.a > 2", "x.b > 0", "y.a / x.a > 0"),
    *("even(x.a)", "picky(y.b) != 2", "half(x.w) > 0", "pair(x.a) != pair(y.b)"),
    "[] == (SELECT q.a FROM q = u WHERE q.a == x.a AND q.b == y.b AS list)",
)
THIRD = {"z = ": ("z.a == y.a", "x.s == z.s", "z.b == None", "even(z.a)"), "n = ": ("n.this == x.a", "y.a >= n.this")}
SHOWN = (
    "x.a",
    "y.b",
    "x.s",
    "pair(y.a)",
    "x.w + y.w",
    "picky(x.a)",
    "100 / y.a",
    "y.s",
    "IF(y.b != None; y.b + x.a; 0)",
)
LAST = "(SELECT q.s, q.w FROM q = u WHERE q.w {} x.w {} ORDER BY q.{} {} LIMIT {} AS rows)"
COMPARED = ("<=", "<", ">=", ">")
KEYS = ("x.a", "pair(y.a)", "y.w")
ENDS = ("", " ORDER BY y.a DESC", " ORDER BY half(x.a), y.s", " LIMIT 2")


@st.composite
def joins(draw: st.DrawFn) -> ProgramCase:
    """A query over two or three tables, with what can be joined, and what only Python can do."""
    sources = draw(st.sampled_from(FROM))
    parts = [draw(st.sampled_from(LINKS)), *draw(st.lists(st.sampled_from(PARTS), max_size=2))]
    parts += [draw(st.sampled_from(more)) for name, more in THIRD.items() if name in sources]
    where = " AND ".join(f"({part})" for part in draw(st.permutations(parts)))
    if draw(st.integers(0, 3)):
        last = st.builds(
            LAST.format,
            *map(
                st.sampled_from,
                (
                    COMPARED,
                    ("", "AND q.a > 0", "AND q.b != None AND q.b + 1 > x.a"),
                    "wwb",
                    ("", "DESC"),
                    (1, "2 OFFSET 1"),
                ),
            ),
        )
        shown = st.one_of(st.sampled_from(SHOWN), last)
        columns = ", ".join(draw(st.lists(shown, min_size=1, max_size=3, unique=True)))
        end = draw(st.sampled_from(ENDS))
    else:
        key = draw(st.sampled_from(KEYS))
        columns, end = f"{key}, count(*), max(half(x.a)), sum(y.a)", f" GROUP BY {key}"
    script = f"SELECT {columns} FROM {sources} WHERE {where}{end} AS rows"
    tables = {"t": draw(ROWS), "u": draw(ROWS)}
    return ProgramCase(script, {"least": draw(st.integers(-1, 1))}, ("even", "half", "pair", "picky"), tables)
