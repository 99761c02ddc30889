"""Rooms for OpenRAVE, or for its stand-in: balls and crates."""

from __future__ import annotations

from random import Random
from typing import Any

import fake_openravepy as fake


def ball(name: str, radius: float, mass: float, position: Any) -> fake.KinBody:
    body = fake.KinBody(name, [fake.Link("ball", mass, fake.Geometry(fake.GeometryType.Sphere, radius))])
    body.SetTransform([1, 0, 0, 0, *position])
    return body


def crate(name: str, half: tuple[float, float, float], mass: float, position: Any) -> fake.KinBody:
    body = fake.KinBody(name, [fake.Link("crate", mass, fake.Geometry(fake.GeometryType.Box, *half))])
    body.SetTransform([1, 0, 0, 0, *position])
    return body


def scene(seed: int, count: int) -> fake.Environment:
    """Random balls and crates."""
    random, environment = Random(seed), fake.Environment()
    for number in range(count):
        place = [random.uniform(-4, 4) for _ in range(3)]
        a, b, c = (random.uniform(0.1, 0.5) for _ in range(3))
        mass = random.uniform(1, 100)
        round_one = random.random() < 0.5
        name = f"ball_{number}" if round_one else f"crate_{number}"
        environment.Add(ball(name, a, mass, place) if round_one else crate(name, (a, b, c), mass, place))
    return environment
