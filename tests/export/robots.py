"""Robots and calibrations for these tests."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import mujoco
import yaml

from tiago_mj.cli import export as declared
from tiago_mj.export import command, found

#: A sliding joint and two hinges, of which no two numbers are alike; with a comment, a class, gears and a keyframe.
ARM = """<mujoco model="arm">
  <!-- kept: <joint name="elbow" damping="9"/> -->
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <default>
    <default class="light"><joint armature="0.0031"/></default>
  </default>
  <worldbody>
    <body name="rail" pos="0 0 1">
      <joint name="rail" type="slide" axis="1 0 0" damping="5.1" frictionloss="0.71" range="-0.41 0.43"/>
      <geom type="box" size=".05 .04 .03" mass="0.9"/>
      <body name="upper">
        <joint name="shoulder" axis="0 1 0" damping="0.13" armature="0.011"
               frictionloss="0.17" range="-1.9 2.1"/>   <!-- two lines -->
        <geom type="capsule" size=".02" fromto="0 0 0 .3 0 0" mass=".61"/>
        <body name="fore" pos=".3 0 0">
          <joint name="elbow" class="light" axis="0 1 0" damping=".051" range="-2.3 2.2"/>
          <geom type="capsule" size=".015" fromto="0 0 0 .25 0 .02" mass=".3"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="rail" joint="rail" kp="900" kv="31" forcerange="-53 53" ctrlrange="-0.4 0.4"/>
    <position name="shoulder" joint="shoulder" kp="35" kv="2.1" ctrlrange="-1.2 1.2"/>
    <position name="elbow" joint="elbow" kp="4.5" kv="0.29" gear="2" forcerange="-3.3 3.3" ctrlrange="-2.4 2.4"/>
  </actuator>
  <sensor>
    <jointpos name="elbow_angle" joint="elbow"/>
  </sensor>
  <keyframe>
    <key name="home" qpos="0.02 0.1 -0.2" ctrl="0.02 0.1 -0.4"/>
  </keyframe>
</mujoco>
"""
JOINTS = ("rail", "shoulder", "elbow")


def effect(name: str, target: Any, **parameters: float) -> dict[str, Any]:
    """An effect as a diagnosis found it."""
    values = {key: {"value": value, "low": value, "high": value} for key, value in parameters.items()}
    return {"name": name, "target": target, "parameters": values}


def diagnosed(folder: Path, effects: list[dict[str, Any]], text: str = ARM, **said: Any) -> Path:
    """A folder as ``diagnose`` writes it, with the model beside."""
    (folder / "arm.xml").write_text(text)
    data = {"schema": "tiago_mj.calibration/1", "robot": "arm.xml", "rate_hz": 100.0, "timestep": 0.002}
    data |= {"interface": "position", "joints": list(JOINTS), "actuators": list(JOINTS), "effects": effects, **said}
    (folder / "diagnosis").mkdir(exist_ok=True)
    (folder / "diagnosis" / "calibration.yaml").write_text(yaml.safe_dump(data))
    return folder / "diagnosis"


def robot(folder: Path, effects: list[dict[str, Any]], text: str = ARM, **said: Any) -> found.Robot:
    """The robot of such a folder."""
    read = found.read(diagnosed(folder, effects, text, **said))
    return found.resolve(read, found.model_path(read, None))


def exported(folder: Path, to: str, effects: list[dict[str, Any]], *words: str) -> Path:
    """Folder that the command wrote."""
    parser = argparse.ArgumentParser()
    declared.add_arguments(parser)
    out = folder / "out"
    arguments = [str(diagnosed(folder, effects)), "--to", to, "--out", str(out), *words]
    assert command.run(parser.parse_args(arguments)) == 0
    return out


def compiled(path: Path) -> mujoco.MjModel:
    """A model file as MuJoCo compiles it."""
    return mujoco.MjModel.from_xml_path(str(path))
