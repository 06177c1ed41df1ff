"""Episodes of an environment as a Minari dataset, beside the recordings that a diagnosis reads.

It is written by the ``minari`` package (the extra ``minari``) into its own folder of datasets
(``MINARI_DATASETS_PATH``, else ``~/.minari/datasets``), and ``minari.load_dataset`` reads it like any other: what the
agent saw, did and was told, with the environment that it was, effects included.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import gymnasium
import numpy as np

from tiago_mj.io import held
from tiago_mj.io.extra import load

#: Minari's own variable: where its datasets are.
DATASETS: Final = "MINARI_DATASETS_PATH"


class Collector(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Keeps every episode that is played through it."""

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        super().__init__(env)
        self.episodes: list[dict[str, Any]] = []

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """As the environment's."""
        observation, info = self.env.reset(seed=seed, options=options)
        lists: dict[str, list[Any]] = {name: [] for name in ("actions", "rewards", "terminations", "truncations")}
        self.episodes.append({"seed": seed, "observations": [_copy(observation)], "infos": [_copy(info)], **lists})
        return observation, info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """As the environment's."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        episode = self.episodes[-1]
        for name, value in (
            ("observations", _copy(observation)),
            ("infos", _copy(info)),
            ("actions", np.array(action, dtype=self.env.action_space.dtype)),
            ("rewards", float(reward)),
            ("terminations", bool(terminated)),
            ("truncations", bool(truncated)),
        ):
            episode[name].append(value)
        return observation, reward, terminated, truncated, info


def check(dataset: str) -> None:
    """Refuse, before anything is recorded, what could not be written after it.

    Raises:
        ValueError: the name is no dataset's, or there is such a dataset already.
        ModuleNotFoundError: minari is not installed; says how to.
    """
    names: Any = load("minari.dataset.minari_dataset", "writing Minari datasets", "minari")
    load("h5py", "writing Minari datasets", "minari")
    try:
        names.parse_dataset_id(dataset)
    except ValueError as fault:
        raise ValueError(f"--minari {dataset}: {' '.join(str(fault).split())}") from fault
    path = _path(dataset)
    if path.exists():
        raise ValueError(f"--minari {dataset}: there is such a dataset ({path}): give another name or version")


def write(collector: Collector, dataset: str, policy: str) -> Path:
    """Write a dataset, whole or not at all.

    Args:
        collector: whose episodes are written.
        dataset: its name, such as ``gripper/pi-v0``.
        policy: who acted, for the dataset's description.

    Returns:
        Its folder.

    Raises:
        ValueError: as of :func:`check`.
    """
    check(dataset)
    minari: Any = load("minari", "writing Minari datasets", "minari")
    buffers: Any = load("minari.data_collector", "writing Minari datasets", "minari")
    episodes = [
        buffers.EpisodeBuffer(
            id=k,
            seed=episode["seed"],
            **{name: _stacked(episode[name]) for name in ("observations", "actions", "infos")},
            **{name: episode[name] for name in ("rewards", "terminations", "truncations")},
        )
        for k, episode in enumerate(collector.episodes)
    ]
    path, namespaces = _path(dataset), load("minari.namespace", "writing Minari datasets", "minari")
    with held.temporary_folder(_path(""), "datasets") as new:
        with _datasets_in(new), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of author and link, which a recording does not have
            minari.create_dataset_from_buffers(
                dataset, episodes, env=collector.env, algorithm_name=policy, data_format="hdf5"
            )
        namespace = dataset.rpartition("/")[0]
        if namespace and namespace not in namespaces.list_local_namespaces():
            namespaces.create_namespace(namespace)
        path.parent.mkdir(parents=True, exist_ok=True)
        (new / dataset).rename(path)
    return path


@contextmanager
def _datasets_in(folder: Path) -> Iterator[None]:
    """Let minari write its datasets into a folder."""
    before = os.environ.get(DATASETS)
    os.environ[DATASETS] = str(folder)
    try:
        yield
    finally:
        if before is None:
            del os.environ[DATASETS]
        else:
            os.environ[DATASETS] = before


def _path(dataset: str) -> Path:
    folders: Any = load("minari.storage.datasets_root_dir", "writing Minari datasets", "minari")
    return Path(folders.get_dataset_path(dataset))


def _copy(value: Any) -> Any:
    return {key: _copy(item) for key, item in value.items()} if isinstance(value, dict) else np.array(value)


def _stacked(values: Sequence[Any]) -> Any:
    """A list of dictionaries of arrays as a dictionary of arrays with one more axis."""
    if isinstance(values[0], dict):
        return {key: _stacked([value[key] for value in values]) for key in values[0]}
    return np.stack(values)
