"""What mutation testing leaves out is still there."""

from __future__ import annotations

import mutants
import pytest


@pytest.mark.slow  # a million nodes of syntax trees
def test_justified_mutants_exist_and_say_why() -> None:
    names = {mutant.name for mutant in mutants.every()}
    for name, why in mutants.justified().items():
        assert name in names, "the code has changed: look at the mutant again"
        assert why.endswith(".")
