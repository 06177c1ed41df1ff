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
