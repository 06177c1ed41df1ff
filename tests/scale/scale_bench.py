"""Tasks for other processes, which import them by name."""

import os
import time
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Slow:
    """A task that leaves a mark when it begins."""

    number: int
    marks: str
    seconds: float


def square(number):
    if number < 0:
        raise ValueError(f"task {number} is negative: give a positive one")
    return number * number


def process(number):
    return number, os.getpid()


def place(number):
    """Where a process works."""
    return os.getcwd()


def die(number):
    if number == 2:
        os._exit(1)
    return number


def slow_square(task):
    """The task's number and square, and the node that made it."""
    import ray

    node = ray.get_runtime_context().get_node_id()
    Path(task.marks, f"{task.number}-{node}-{os.getpid()}").touch()
    time.sleep(task.seconds)
    return task.number, square(task.number), node


def wait(folder):
    """Say which process this is, and wait."""
    (Path(folder) / str(os.getpid())).touch()
    time.sleep(60)


def shake(count):
    """Let MuJoCo warn so many times."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body><joint name="hinge" axis="0 1 0"/><geom size=".05" pos="0 0 -.2"/></body></worldbody>'
        '<actuator><position joint="hinge" kp="1e9"/></actuator></mujoco>'
    )
    data = mujoco.MjData(model)
    for _ in range(count):
        mujoco.mj_resetData(model, data)
        data.ctrl[:] = 1.0
        mujoco.mj_step(model, data, nstep=5)
    return count
