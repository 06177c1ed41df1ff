"""The whole state of a training in one file, so that it can go on as if it had never stopped.

A zip of numbers and JSON: networks and optimisers (``torch.load(weights_only=True)``), the replay buffer's filled part,
the states of all generators, and what the callbacks remember. Nothing of it is unpickled as Python objects. It takes
its place whole or not at all.
"""

from __future__ import annotations

import io
import json
import random
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
from numpy.typing import NDArray

from tiago_mj import atomic

SCHEMA: Final = "tiago_mj.checkpoint/1"
FILE: Final = "checkpoint.zip"
#: Of a replay buffer: arrays over (steps, environments), and over environments.
_STORED: Final = (
    "observations", "next_observations", "actions", "rewards", "dones", "timeouts", "ep_start", "ep_length",
)  # fmt: skip
_RUNNING: Final = ("obs_rms", "ret_rms")


@dataclass(frozen=True)
class Checkpoint:
    """What a file holds.

    Attributes:
        steps: environment steps so far.
        finished: whether the training is over.
        callbacks: what each callback remembers, by its name.
        arrays: their arrays, by name.
    """

    steps: int
    finished: bool
    callbacks: Mapping[str, Any]
    arrays: Mapping[str, NDArray[Any]]


def write(
    path: Path, model: Any, *, callbacks: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]], finished: bool
) -> None:
    """Write a model's whole state.

    Args:
        path: of the file; what was there before stays until the new one is whole.
        model: of stable-baselines3.
        callbacks, arrays: see :class:`Checkpoint`.
        finished: whether the training is over.
    """
    names, variables = model._get_torch_save_params()
    tensors = {
        "parameters": model.get_parameters(),
        "variables": {name: getattr(model, name).detach() for name in variables},
        "generator": torch.get_rng_state(),
    }
    assert set(tensors["parameters"]) == set(names)
    packed = io.BytesIO()
    torch.save(tensors, packed)
    state = {
        "schema": SCHEMA,
        "finished": finished,
        "steps": model.num_timesteps,
        "updates": model._n_updates,
        "episodes": model._episode_num,
        "generators": _generators(model),
        "callbacks": dict(callbacks),
    }
    with atomic.replacing(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        archive.writestr("state.json", json.dumps(state))
        archive.writestr("parameters.pt", packed.getvalue())
        for name, array in {**_replay(model), **_running(model), **{f"own/{k}": a for k, a in arrays.items()}}.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                np.lib.format.write_array(file, np.asarray(array), allow_pickle=False)


def read(path: Path, model: Any) -> Checkpoint:
    """Put a model, made with the same settings, into the state that a file holds; and return the rest.

    The generators are restored by :func:`restore_generators`, when nothing else is drawn before training goes on.

    Raises:
        ValueError: the file is damaged, or of another model; one line.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            if (bad := archive.testzip()) is not None:
                raise ValueError(f"{bad} is damaged")
            state = json.loads(archive.read("state.json"))
            if state["schema"] != SCHEMA:
                raise ValueError(f"schema {state['schema']!r}, this version reads {SCHEMA!r}")
            tensors = torch.load(io.BytesIO(archive.read("parameters.pt")), map_location="cpu", weights_only=True)
            arrays = {
                name.removesuffix(".npy"): np.lib.format.read_array(archive.open(name), allow_pickle=False)
                for name in archive.namelist()
                if name.endswith(".npy")
            }
        model.set_parameters(tensors["parameters"], exact_match=True, device="cpu")
        for name, value in tensors["variables"].items():
            getattr(model, name).data.copy_(value)
        model.num_timesteps, model._n_updates = int(state["steps"]), int(state["updates"])
        model._episode_num = int(state["episodes"])
        _put_replay(model, arrays)
        _put_running(model, arrays)
    except (zipfile.BadZipFile, zlib.error, EOFError, KeyError, TypeError, RuntimeError, ValueError) as fault:
        reason = " ".join(str(fault).split())[:200] or type(fault).__name__
        raise ValueError(
            f"checkpoint {path} cannot be read ({reason}): delete that file to begin this seed anew, or give another "
            "--out"
        ) from fault
    model._restored = (state["generators"], tensors["generator"])
    own = {name.removeprefix("own/"): array for name, array in arrays.items() if name.startswith("own/")}
    return Checkpoint(model.num_timesteps, bool(state["finished"]), state["callbacks"], own)


def restore_generators(model: Any) -> None:
    """Put every generator back to where it was, if the model comes from a checkpoint."""
    restored = model.__dict__.pop("_restored", None)
    if restored is None:
        return
    states, torch_state = restored
    version, numbers, gauss = states["python"]
    random.setstate((version, tuple(numbers), gauss))
    name, keys, *rest = states["numpy"]
    np.random.set_state((name, np.array(keys, dtype=np.uint32), *rest))  # noqa: NPY002  (stable-baselines3 draws there)
    model.action_space.np_random.bit_generator.state = states["actions"]
    torch.set_rng_state(torch_state)


def _generators(model: Any) -> dict[str, Any]:
    version, numbers, gauss = random.getstate()
    name, keys, *rest = np.random.get_state()  # noqa: NPY002
    return {
        "python": [version, list(numbers), gauss],
        "numpy": [name, np.asarray(keys).tolist(), *rest],
        "actions": model.action_space.np_random.bit_generator.state,
    }


def _replay(model: Any) -> dict[str, NDArray[Any]]:
    buffer = getattr(model, "replay_buffer", None)
    if buffer is None:
        return {}
    filled = buffer.buffer_size if buffer.full else buffer.pos
    found = {"replay/place": np.array([buffer.pos, buffer.full], dtype=np.int64)}
    for name in _STORED:
        value = getattr(buffer, name, None)
        parts = value.items() if isinstance(value, dict) else [("", value)]
        found.update({f"replay/{name}/{key}": part[:filled] for key, part in parts if part is not None})
    if hasattr(buffer, "_current_ep_start"):
        found["replay/begun"] = buffer._current_ep_start
    return found


def _put_replay(model: Any, arrays: Mapping[str, NDArray[Any]]) -> None:
    buffer = getattr(model, "replay_buffer", None)
    if buffer is None:
        return
    for name in _STORED:
        value = getattr(buffer, name, None)
        parts = value.items() if isinstance(value, dict) else [("", value)]
        for key, part in parts:
            if part is not None:
                stored = arrays[f"replay/{name}/{key}"]
                part[: len(stored)] = stored
    position, full = arrays["replay/place"]
    buffer.pos, buffer.full = int(position), bool(full)
    if hasattr(buffer, "_current_ep_start"):
        buffer._current_ep_start[:] = arrays["replay/begun"]


def _running(model: Any) -> dict[str, NDArray[Any]]:
    """Running mean and variance of observations and returns, where they are normalised."""
    envs = model.get_vec_normalize_env()
    return {} if envs is None else {f"running/{k}": np.asarray(v) for k, v in _moments(envs)}


def _put_running(model: Any, arrays: Mapping[str, NDArray[Any]]) -> None:
    envs = model.get_vec_normalize_env()
    if envs is None:
        return
    for name in _RUNNING:
        parts = getattr(envs, name, None)
        for key, part in parts.items() if isinstance(parts, dict) else [("", parts)]:
            if part is not None:
                part.mean, part.var = arrays[f"running/{name}/{key}/mean"], arrays[f"running/{name}/{key}/var"]
                part.count = float(arrays[f"running/{name}/{key}/count"])


def _moments(envs: Any) -> list[tuple[str, Any]]:
    found: list[tuple[str, Any]] = []
    for name in _RUNNING:
        parts = getattr(envs, name, None)
        for key, part in parts.items() if isinstance(parts, dict) else [("", parts)]:
            if part is not None:
                found += [(f"{name}/{key}/{field}", getattr(part, field)) for field in ("mean", "var", "count")]
    return found
