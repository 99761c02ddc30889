"""What the tests of the representations of worlds share: one simulation, and questions to scenes in it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

import ss2sql
from ss2sql.scenes.scene import Scene

GREY = (0.5, 0.5, 0.5)


@pytest.fixture(scope="module", name="client")
def fixture_client() -> Iterator[Any]:
    """One simulation for all scenes of this file: each takes 29 MB that do not come back."""
    scene = Scene(0)
    yield scene.client
    scene.close()


@pytest.fixture(name="scene")
def fixture_scene(client: Any) -> Scene:
    return Scene(0, client)


@pytest.fixture(params=("database", "native"), name="engine")
def fixture_engine(request: pytest.FixtureRequest) -> Any:
    return request.param


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
