"""Agents in files of numbers: float32 arrays and a JSON header in one npz, loaded by numpy alone.

Nothing in such a file is run when it is loaded (``allow_pickle=False``), so it needs no trust, and neither torch nor
stable-baselines3 is needed to act.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import gymnasium
import numpy as np
from numpy.typing import NDArray

from tiago_mj.io import arrays, atomic
from tiago_mj.io.loading import parse_json
from tiago_mj.io.quoting import is_one_of, quoted

SCHEMA: Final = "tiago_mj.agent/1"
#: What makes a file one of these.
SUFFIX: Final = ".npz"

Single = NDArray[np.float32]


def _relu(x: Single) -> Single:
    return np.maximum(x, np.float32(0))


def _elu(x: Single) -> Single:
    return np.where(x > 0, x, np.expm1(np.minimum(x, np.float32(0))))


ACTIVATIONS: Final[Mapping[str, Callable[[Single], Single]]] = {"ReLU": _relu, "Tanh": np.tanh, "ELU": _elu}
#: What the last layer's output becomes: squashed into, or cut at, the action space's bounds.
OUTPUTS: Final = ("tanh", "clip")
#: No observation is larger (in SI units), no number in the network's may be, and none is divided by less.
MAX_OBSERVATION, MAX_WEIGHT, MIN_DEVIATION = 1e6, 1e37, 1e-30


@dataclass(frozen=True)
class Agent:
    """A multilayer perceptron that acts; a :class:`tiago_mj.rollout.episode.Policy`.

    Attributes:
        layers: weight (out, in) and bias (out,) of each, float32.
        activation: between layers, of :data:`ACTIVATIONS`.
        output: of :data:`OUTPUTS`.
        inputs: key and size of every part of the observation, in the order in which they are joined; the key of a flat
            observation is empty.
        low, high: bounds of the actions, (n,).
        mean, deviation: by which observations are normalised first, (inputs,); None: they are not.
        limit: at which normalised observations are cut.
        origin: where it comes from: environment, options, algorithm, seed, steps, versions.
    """

    layers: tuple[tuple[Single, Single], ...]
    activation: str
    output: str
    inputs: tuple[tuple[str, int], ...]
    low: Single
    high: Single
    mean: NDArray[np.float64] | None = None
    deviation: NDArray[np.float64] | None = None
    limit: float = 10.0
    origin: Mapping[str, Any] = field(default_factory=dict)

    def reset(self) -> None:
        """Nothing: the policy has no memory."""

    def __call__(self, observation: Any, info: dict[str, Any] | None = None) -> Single:
        """The action, (..., n) float32, for an observation or a batch of them."""
        parts = [observation if not key else observation[key] for key, _ in self.inputs]
        seen: Any = parts[0] if len(parts) == 1 else np.concatenate(parts, axis=-1)
        if self.mean is not None:
            seen = np.clip((seen - self.mean) / self.deviation, -self.limit, self.limit)
        x = np.asarray(seen, dtype=np.float32)
        act = ACTIVATIONS[self.activation]
        *hidden, (weight, bias) = self.layers
        for inner, offset in hidden:
            x = act(x @ inner.T + offset)
        x = x @ weight.T + bias
        if self.output == "tanh":
            return self.low + np.float32(0.5) * (np.tanh(x) + np.float32(1)) * (self.high - self.low)
        return np.clip(x, self.low, self.high)

    def check_fits(self, env: gymnasium.Env[Any, Any], name: str) -> None:
        """Refuse an environment with other observations or actions.

        Raises:
            ValueError: one line with both.
        """
        spaces = env.observation_space
        there = {"": spaces} if not isinstance(spaces, gymnasium.spaces.Dict) else dict(spaces.spaces)
        shapes = {key: space.shape for key, space in there.items()}
        if shapes != {key: (size,) for key, size in self.inputs}:
            raise ValueError(
                f"policy {name} observes {_told(dict(self.inputs))}, as {self.origin.get('env', 'its environment')} "
                f"gives; this environment gives {_told({k: s[0] if s else 0 for k, s in shapes.items()})}"
            )
        if env.action_space.shape != self.low.shape:
            raise ValueError(
                f"policy {name} commands {len(self.low)} joints, this environment has actions of shape "
                f"{env.action_space.shape}"
            )

    def save(self, path: Path) -> None:
        """Write the agent to a file, whole."""
        header = {"schema": SCHEMA, **self.header()}
        with atomic.replacing(path) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, header=np.array(json.dumps(header)), **self.arrays())

    def header(self) -> dict[str, Any]:
        """Everything that is not an array, as JSON."""
        return {
            "activation": self.activation,
            "output": self.output,
            "inputs": [list(part) for part in self.inputs],
            "limit": self.limit,
            "origin": dict(self.origin),
        }

    def arrays(self) -> dict[str, Any]:
        """All arrays, by name."""
        found: dict[str, Any] = {"low": self.low, "high": self.high}
        for number, (weight, bias) in enumerate(self.layers):
            found[f"weight_{number}"], found[f"bias_{number}"] = weight, bias
        if self.mean is not None and self.deviation is not None:
            found["mean"], found["deviation"] = self.mean, self.deviation
        return found


def load_agent(path: Path, name: str | None = None) -> Agent:
    """Read an agent; nothing that the file holds is run.

    Args:
        path: of the npz.
        name: to call it in a complaint; None: the path.

    Raises:
        ValueError: the file is damaged, or no agent; one line.
        OSError: it cannot be read.
    """
    try:
        found = arrays.read_npz(path)
        header = parse_json(str(found.pop("header")), "its header is no JSON")
        if not isinstance(header, dict) or header.get("schema") != SCHEMA:
            said = header.get("schema") if isinstance(header, dict) else header
            raise ValueError(f"schema {quoted(said)}, this version reads {SCHEMA!r}")
        return from_arrays(header, found)
    except arrays.FAULTS as fault:
        raise ValueError(
            f"policy {name or path} is no agent that can be read, or is damaged: {arrays.reason(fault)}"
        ) from fault


def from_arrays(header: Mapping[str, Any], found: Mapping[str, NDArray[Any]]) -> Agent:
    """An agent from its arrays and header.

    Raises:
        ValueError, or another of :data:`tiago_mj.io.arrays.FAULTS`: they make no agent.
    """
    count = sum(key.startswith("weight_") for key in found)
    if odd := [key for key, value in found.items() if value.dtype.kind not in "fiu"]:
        raise ValueError(f"{quoted(odd[0])} is no array of numbers")
    with np.errstate(over="ignore"):
        single = {key: np.asarray(value, dtype=np.float32) for key, value in found.items()}
    return _checked(
        Agent(
            layers=tuple((single[f"weight_{n}"], single[f"bias_{n}"]) for n in range(count)),
            activation=header["activation"],
            output=header["output"],
            inputs=tuple((str(key), int(size)) for key, size in header["inputs"]),
            low=single["low"],
            high=single["high"],
            mean=found.get("mean"),
            deviation=found.get("deviation"),
            limit=float(header["limit"]),
            origin=header["origin"],
        )
    )


def _checked(agent: Agent) -> Agent:
    width = inputs = sum(size for _, size in agent.inputs)
    for weight, bias in agent.layers:
        if weight.ndim != 2 or weight.shape[1] != width or bias.shape != weight.shape[:1]:
            raise ValueError(f"a layer of shape {weight.shape} does not follow one of width {width}")
        width = len(bias)
    if not agent.layers or agent.low.shape != (width,) or agent.high.shape != (width,):
        raise ValueError("layers and actions do not match")
    if not is_one_of(agent.activation, ACTIVATIONS) or not is_one_of(agent.output, OUTPUTS):
        raise ValueError(f"activation {quoted(agent.activation)} or output {quoted(agent.output)} is unknown")
    scales = [value for value in (agent.mean, agent.deviation) if value is not None]
    if len(scales) == 1 or any(value.shape != (inputs,) or value.dtype.kind != "f" for value in scales):
        raise ValueError("its normalisation does not match its observations")
    if not all(np.isfinite(value).all() for value in (*agent.arrays().values(), agent.limit)):
        raise ValueError("it has numbers that are not finite")
    if (agent.deviation is not None and not (agent.deviation > MIN_DEVIATION).all()) or agent.limit <= 0:
        raise ValueError("it divides observations by 0 or less, or by next to nothing")
    if not _largest(agent) < MAX_WEIGHT:
        raise ValueError("its numbers are so large that what it computes with them is not finite")
    if not isinstance(agent.origin, Mapping):
        raise ValueError(f"its origin is {quoted(agent.origin)}")
    return agent


def _largest(agent: Agent) -> float:
    """Bound on every intermediate result of the network, for observations up to :data:`MAX_OBSERVATION`."""
    most = MAX_OBSERVATION
    if agent.mean is not None and agent.deviation is not None:
        most = max(MAX_OBSERVATION + float(np.abs(agent.mean).max(initial=0.0)), agent.limit)
        if not most / float(agent.deviation.min(initial=1.0)) < np.finfo(np.float64).max:
            return np.inf
        most = agent.limit
    found = most
    for weight, bias in agent.layers:
        rows = np.abs(weight, dtype=np.float64).sum(axis=1) * most + np.abs(bias)
        most = float(rows.max(initial=1.0))
        found = max(found, most)
    return max(found, float(np.abs(np.concatenate([agent.low, agent.high])).max(initial=0.0)) * 4)


def _told(sizes: Mapping[str, int]) -> str:
    if list(sizes) == [""]:
        return f"{sizes['']} numbers"
    return "a dictionary of " + ", ".join(f"{key} ({size})" for key, size in sizes.items())
