"""The reference against the language page where no sheet or golden case runs it: failures."""

from __future__ import annotations

import pytest
from reference import Failure, Reference

SEARCH = "SELECT this FROM [1] START WITH x = 1 CONNECT BY"
FAILURES = {
    "X001": ['1 < "a"', "None < 1", "1 + None", "1 IN 1", "SELECT this FROM [1, 'a'] ORDER BY this"],
    "X002": ["1 / 0", "1.5 % 0"],
    "X003": ["[1][1]"],
    "X004": ["9223372036854775807 + 1", "1e308 * 10", "(-1) ^ 0.5", "9 ^ 9 ^ 9", "nan()", "huge()"],
    "X006": [
        "SELECT this FROM [1] LIMIT -1",
        *(f"{SEARCH} {option} x = 1" for option in ("MAXIMUM (0)", "MEMORIZE (1.5)", "COST -1", "COST 'a'")),
        f"{SEARCH} PROBABILITY 2 x = 1",
    ],
    "X007": ["sqrt(-1)", 'int("one")', "max(3)"], "R001": ["unknown"], "R002": ["unknown(1)"],
    "R003": ["SELECT this FROM unknown"], "R004": ["SELECT k FROM a = rows, b = rows"], "R005": ["len()"],
    "R006": ["SELECT this FROM [1] AS unknown"], "R007": [f"{SEARCH} x = 2 STOP WITH (x = 2) > 1"],
    "R008": ["SELECT this FROM [1] WHERE count(*) > 1"], "R010": [f"{SEARCH} DEPTH FIRST MEMORIZE x = 2"],
    "R011": ["late = [a.this]; SELECT this FROM late"], "R012": ["SELECT this FROM [1] STOP WITH True"],
    "R013": ["SELECT 1 FROM a = [1], a = [2]"],
}  # fmt: skip


@pytest.mark.parametrize(("code", "script"), [(code, script) for code in FAILURES for script in FAILURES[code]])
def test_failure(code: str, script: str) -> None:
    functions = {"nan": lambda: float("nan"), "huge": lambda: 2**63}
    with pytest.raises(Failure) as caught:
        Reference(functions, {"rows": [{"k": 1}]}).run(script)
    assert caught.value.code == code
