"""The whole state of a training in one file, so that it can go on as if it had never stopped.

A zip of numbers and JSON: networks and optimisers (``torch.load(weights_only=True)``), the replay buffer's filled part,
the states of all generators, and what the callbacks remember. Nothing of it is unpickled as Python objects. It takes
its place whole or not at all.
"""

from __future__ import annotations

import io
import json
import math
import pickle
import random
import warnings
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
from numpy.typing import NDArray

from tiago_mj.io import arrays, atomic
from tiago_mj.io.loading import MAX_WHOLE, parse_json
from tiago_mj.io.quoting import quoted

SCHEMA: Final = "tiago_mj.checkpoint/1"
FILE: Final = "checkpoint.zip"
#: Generators' states are whole numbers of 128 bits.
_GENERATORS: Final = 2**128
#: Of a replay buffer: arrays over (steps, environments), and over environments.
_STORED: Final = (
    "observations", "next_observations", "actions", "rewards", "dones", "timeouts", "ep_start", "ep_length",
)  # fmt: skip
_RUNNING: Final = ("obs_rms", "ret_rms")


@dataclass(frozen=True)
class Checkpoint:
    """Contents of a checkpoint.

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
    """Restore a model, made with the same settings, from a checkpoint; returns the rest of it.

    Raises:
        ValueError: the file is damaged, or of another model; one line.
    """
    with readable(path):
        with archive(path) as packed:
            if (bad := packed.testzip()) is not None:
                raise ValueError(f"{bad} is damaged")
            state = parse_json(packed.read("state.json"), "state.json is no JSON", most_whole=_GENERATORS)
            if state["schema"] != SCHEMA:
                raise ValueError(f"schema {quoted(state['schema'])}, this version reads {SCHEMA!r}")
            parameters = io.BytesIO(packed.read("parameters.pt"))
            with archive(parameters):
                parameters.seek(0)
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")  # of a damaged part, which is refused with all else
                    tensors = torch.load(parameters, map_location="cpu", weights_only=True)
            names = [name for name in packed.namelist() if name.endswith(".npy")]
            found = {name.removesuffix(".npy"): arrays.read_array(packed, name) for name in names}
        kept = [array for name, array in found.items() if name.startswith(("replay/", "running/"))]
        if not _finite([tensors["parameters"], tensors["variables"], *kept]):
            raise ValueError("it has weights or memories that are not finite")
        model.set_parameters(tensors["parameters"], exact_match=True, device="cpu")
        for name, value in tensors["variables"].items():
            getattr(model, name).data.copy_(value)
        counts = [int(state[name]) for name in ("steps", "updates", "episodes")]
        if not 0 <= min(counts) <= max(counts) <= MAX_WHOLE:
            raise ValueError(f"it counts {quoted(counts)} steps, updates and episodes")
        model.num_timesteps, model._n_updates, model._episode_num = counts
        _put_replay(model, found)
        _put_running(model, found)
        _check_generators(model, state["generators"], tensors["generator"])
        callbacks = dict(state["callbacks"])
    model._restored = (state["generators"], tensors["generator"])
    own = {name.removeprefix("own/"): array for name, array in found.items() if name.startswith("own/")}
    return Checkpoint(model.num_timesteps, bool(state["finished"]), callbacks, own)


@contextmanager
def readable(path: Path) -> Iterator[None]:
    """Context in which faults of a checkpoint become one line.

    Raises:
        ValueError: says how to go on.
    """
    try:
        yield
    except (*arrays.FAULTS, OSError, pickle.UnpicklingError) as fault:
        raise ValueError(
            f"checkpoint {path} cannot be read ({arrays.reason(fault)}): delete that file to begin this seed anew, or "
            "give another --out"
        ) from fault


@contextmanager
def archive(file: Path | io.BytesIO) -> Iterator[zipfile.ZipFile]:
    """A checkpoint's archive; nothing in it is packed, so that it is no larger in memory than on the disk.

    Raises:
        OSError, ValueError: it cannot be read.
    """
    size = file.stat().st_size if isinstance(file, Path) else file.getbuffer().nbytes
    with arrays.opened(file, size, stored=True) as opened:
        yield opened


def _finite(value: Any) -> bool:
    """Whether every number in arrays and tensors, and in mappings and lists of them, is finite."""
    if isinstance(value, torch.Tensor):
        if value.numel() * value.element_size() > value.untyped_storage().nbytes():
            raise ValueError(f"a tensor claims the shape {tuple(value.shape)}")
        return not value.is_floating_point() or bool(torch.isfinite(value).all())
    if isinstance(value, np.ndarray):
        return value.dtype.kind != "f" or bool(np.isfinite(value).all())
    several = value.values() if isinstance(value, Mapping) else value if isinstance(value, (list, tuple)) else ()
    return all(map(_finite, several)) and not (isinstance(value, float) and not math.isfinite(value))


def restore_generators(model: Any) -> None:
    """Restore the state of every random generator of a model from a checkpoint."""
    restored = model.__dict__.pop("_restored", None)
    if restored is None:
        return
    _put_generators(model, *restored)


def _put_generators(model: Any, states: Mapping[str, Any], torch_state: torch.Tensor) -> None:
    version, numbers, gauss = states["python"]
    random.setstate((version, tuple(numbers), gauss))
    name, keys, *rest = states["numpy"]
    np.random.set_state((name, np.array(keys, dtype=np.uint32), *rest))  # noqa: NPY002  (stable-baselines3 draws there)
    model.action_space.np_random.bit_generator.state = states["actions"]
    torch.set_rng_state(torch_state)


def _check_generators(model: Any, states: Mapping[str, Any], torch_state: torch.Tensor) -> None:
    """Raise what restoring the generators would raise, and leave them unchanged."""
    now, torch_now = _generators(model), torch.get_rng_state()
    try:
        _put_generators(model, states, torch_state)
    finally:
        _put_generators(model, now, torch_now)


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
    position, full = map(int, arrays["replay/place"])
    rows = buffer.buffer_size if full else position
    if not 0 <= position < max(buffer.buffer_size, 1):
        raise ValueError(f"the replay buffer goes on at {position} of {buffer.buffer_size}")
    for name in _STORED:
        value = getattr(buffer, name, None)
        parts = value.items() if isinstance(value, dict) else [("", value)]
        for key, part in parts:
            if part is not None:
                stored = arrays[f"replay/{name}/{key}"]
                if stored.shape != (rows, *part.shape[1:]):
                    raise ValueError(f"replay/{name}/{key} has shape {stored.shape}")
                part[:rows] = stored
    buffer.pos, buffer.full = position, bool(full)
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
                mean, var, count = (arrays[f"running/{name}/{key}/{field}"] for field in ("mean", "var", "count"))
                if mean.shape != np.shape(part.mean) or var.shape != np.shape(part.var) or not (var >= 0).all():
                    raise ValueError(f"running/{name}/{key} has shapes {mean.shape} and {var.shape}, or no variance")
                part.mean, part.var, part.count = mean, var, float(count)


def _moments(envs: Any) -> list[tuple[str, Any]]:
    found: list[tuple[str, Any]] = []
    for name in _RUNNING:
        parts = getattr(envs, name, None)
        for key, part in parts.items() if isinstance(parts, dict) else [("", parts)]:
            if part is not None:
                found += [(f"{name}/{key}/{field}", getattr(part, field)) for field in ("mean", "var", "count")]
    return found
