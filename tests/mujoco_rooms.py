"""A room in MuJoCo with a robot, and what a plain loop over MuJoCo's interface says of any."""

from __future__ import annotations

from typing import Any

import pytest
from body_queries import Plain

import ss2sql

mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install mujoco")

ROBOT = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 .1"/>
    <body name="ball" pos="0 0 0.3"><freejoint/><geom name="ball" type="sphere" size=".3" mass="60"/></body>
    <body name="crate" pos="1 0 .5" quat="0.5 0.5 0.5 0.5">
      <freejoint/><geom type="box" size=".1 .2 .3" mass="20"/>
    </body>
    <body name="base" pos="3 0 1">
      <geom type="cylinder" size=".1 .2" mass="5"/>
      <body name="arm" pos=".5 0 0">
        <joint name="elbow" type="hinge" axis="0 0 1" limited="true" range="-1 2"/>
        <geom type="capsule" size=".05 .2" mass="2"/><geom type="sphere" size=".1" pos="0 0 .5" mass="1"/>
        <site name="hand"/>
      </body>
    </body>
    <body name="lift" pos="-3 0 1">
      <joint name="rail" type="slide"/><geom type="ellipsoid" size=".1 .2 .3" mass="3"/>
    </body>
    <body name="ghost" pos="0 3 1" mocap="true"/>
  </worldbody>
  <actuator><motor joint="elbow"/></actuator>
  <sensor><accelerometer name="felt" site="hand"/><jointpos name="turned" joint="elbow"/></sensor>
</mujoco>"""


@pytest.fixture(name="robot")
def fixture_robot() -> tuple[Any, Any]:
    model = mujoco.MjModel.from_xml_string(ROBOT)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


@pytest.fixture(name="ss")
def fixture_ss(ss: ss2sql.Session, robot: tuple[Any, Any]) -> ss2sql.Session:
    ss.attach("space", robot[1])
    return ss


def loop(model: Any, data: Any) -> list[Plain]:
    """The bodies by MuJoCo's own interface by name, one after the other."""
    shapes = ("sphere", "box", "plane", "capsule", "cylinder", "ellipsoid")
    names = {getattr(mujoco.mjtGeom, f"mjGEOM_{name.upper()}"): name for name in shapes}
    found = []
    for number in range(model.nbody):
        body, now = model.body(number), data.body(number)
        kinds = [names[mujoco.mjtGeom(int(geom))] for geom in model.geom_type[model.geom_bodyid == number]]
        kind = "ghost" if not kinds else kinds[0] if len(kinds) == 1 else "compound"
        found.append(Plain(number, body.name, kind, tuple(now.xpos.tolist()), float(body.mass[0])))
    return found
