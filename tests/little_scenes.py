"""What the tests of the representations of worlds share: an empty scene, and questions to scenes."""

from __future__ import annotations

from typing import Any

import pytest

import ss2sql
from ss2sql.vtables.pybullet.scene import Scene

GREY = (0.5, 0.5, 0.5)


@pytest.fixture(name="scene")
def fixture_scene(client: Any) -> Scene:
    return Scene(0, client)


def ask(scene: Any, script: str, engine: Any = "auto", **variables: Any) -> Any:
    with ss2sql.connect() as ss:
        ss.attach("space", scene)
        return ss.run(script, engine=engine, **variables).value


def refused(scene: Any, script: str) -> str:
    """The message of the error V001 that a script ends with; its place is in the script."""
    with pytest.raises(ss2sql.RepresentationError) as caught:
        ask(scene, script)
    assert caught.value.code == "V001"
    assert caught.value.span is not None
    assert caught.value.hints
    return str(caught.value)
