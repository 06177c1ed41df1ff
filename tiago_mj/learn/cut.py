"""Agents whose observations are clipped to the range seen in training.

A ReLU network extrapolates linearly: asked for twice the force it was trained on, it answers by the slopes at the edge
of its training data. Clipping every entry of the observation to the smallest and largest value of the replay buffer
keeps it where it has learned; nothing else of the agent changes.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tiago_mj.io import arrays
from tiago_mj.learn import checkpoint
from tiago_mj.learn.agent_file import Agent

Array = NDArray[np.float64]


def met(file: Path, agent: Agent) -> tuple[Array, Array]:
    """Smallest and largest value of every entry of the observations in a replay buffer, each (inputs,).

    Args:
        file: the seed's checkpoint, with a replay buffer.
        agent: of that training.

    Raises:
        ValueError: the file is damaged, or holds no observations of this agent; one line.
    """
    ends: list[tuple[Array, Array]] = []
    try:
        with checkpoint.archive(file) as archive:
            for key, size in agent.inputs:
                seen = arrays.read_array(archive, f"replay/observations/{key}.npy").reshape(-1, size)
                ends.append((seen.min(axis=0).astype(np.float64), seen.max(axis=0).astype(np.float64)))
    except (OSError, *arrays.FAULTS) as fault:
        raise ValueError(f"{file} holds no observations of that agent's training: {arrays.reason(fault)}") from fault
    low, high = (np.concatenate(parts) for parts in zip(*ends, strict=True))
    return low, high


def cut(agent: Agent, low: Array, high: Array) -> Agent:
    """The agent with observations clipped to these bounds.

    Args:
        agent: without normalisation.
        low, high: of every entry, (inputs,).

    Raises:
        ValueError: the agent normalises its observations, which cuts them in its own way.
    """
    if agent.mean is not None:
        raise ValueError("the agent normalises its observations: those are cut already")
    middle, half = (low + high) / 2, (high - low) / 2
    (weight, bias), *others = agent.layers
    first = ((weight * half).astype(np.float32), (bias + weight @ middle).astype(np.float32))
    deviation = np.where(half > 0, half, 1.0)  # of what never varied the weight is 0
    return replace(agent, layers=(first, *others), mean=middle, deviation=deviation, limit=1.0)
