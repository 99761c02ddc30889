"""Functions of strings."""

from __future__ import annotations

from ss2sql.kinds import STR, UNENCODABLE, Kind
from ss2sql.language.operations.row import Form, each, exactly, operation

_PLAIN = each(Kind.NONE | Kind.NUMBER | Kind.STR)

OPERATIONS = (
    operation(  # what an object writes of itself may be anything
        "str", 1, str, lambda types: STR if _PLAIN(types) else UNENCODABLE, lambda types: types[0].may(Kind.STRUCTURED),
        call="str(x)", about="the value as text", example="str([1, 2.0])", grows=True,
        # Integers look the same everywhere; Python's floats, bools and None do not.
        sqlite=(Form("{0}", exactly(Kind.STR)), Form("cast({0} AS TEXT)", exactly(Kind.INT))),
        python=(Form("str({0})", _PLAIN),),
        portable=(Form("{0}", exactly(Kind.STR)), Form("cast({0} AS VARCHAR)", exactly(Kind.INT))),
    ),
)  # fmt: skip
