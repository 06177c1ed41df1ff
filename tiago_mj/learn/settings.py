"""Settings of a training: everything its result depends on, except the seed and the versions of the software."""

from __future__ import annotations

import json
import platform
import subprocess
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Final, Literal

from pydantic import Field

from tiago_mj import __version__
from tiago_mj.io import atomic
from tiago_mj.io.loading import load_json
from tiago_mj.io.schema import Open, SchemaError, checked
from tiago_mj.registration import ENVIRONMENTS, NAMESPACE

SCHEMA: Final = "tiago_mj.training/1"
FILE: Final = "settings.json"
#: Of whose libraries the version is told.
LIBRARIES: Final = ("mujoco", "gymnasium", "stable-baselines3", "torch", "numpy")


@dataclass(frozen=True)
class Settings:
    """Settings of one training, of any number of seeds.

    Attributes:
        env: id, with its namespace.
        algo: of :data:`tiago_mj.learn.zoo_form.ALGORITHMS`.
        steps: environment steps of a seed.
        env_options: arguments of the environment.
        effects: what acts on the environment, as :func:`tiago_mj.effects.read_effects` takes it; None: nothing.
        hyperparameters: as :func:`tiago_mj.learn.zoo_form.checked` gives them.
        updates_per_step: gradient steps per environment step; None: as the hyperparameters say.
        evaluate_every: environment steps between evaluations.
        evaluation_episodes: of each.
        checkpoint_every: environment steps between checkpoints. At each, the environments begin new episodes, drawn
            from the seed and the step count; so a run that goes on from a checkpoint is the run that never stopped.
        randomise: ranges of effects, or the posterior of a diagnosis, from which every episode draws its own, as
            :func:`tiago_mj.learn.randomise.drawing` takes them; None: nothing is drawn.
    """

    env: str
    algo: str
    steps: int
    env_options: Mapping[str, Any]
    effects: Any
    hyperparameters: Mapping[str, Any]
    updates_per_step: float | None = None
    evaluate_every: int = 10_000
    evaluation_episodes: int = 10
    checkpoint_every: int = 12_000
    randomise: Mapping[str, Any] | None = None

    @property
    def episode_steps(self) -> int:
        """Time limit of an episode [control steps]."""
        return int(
            self.env_options.get("max_episode_steps", ENVIRONMENTS[self.env.removeprefix(f"{NAMESPACE}/")].steps)
        )

    def as_data(self) -> dict[str, Any]:
        """The settings as JSON data."""
        data: dict[str, Any] = json.loads(json.dumps(asdict(self)))
        return data


class Parts(Open):
    """Settings as a file has them."""

    env: str
    algo: str
    steps: int = Field(ge=1)
    env_options: dict[str, Any]
    effects: Any
    hyperparameters: dict[str, Any]
    updates_per_step: float | None = None
    evaluate_every: int = Field(default=10_000, ge=1)
    evaluation_episodes: int = Field(default=10, ge=1)
    checkpoint_every: int = Field(default=12_000, ge=1)
    randomise: dict[str, Any] | None = None


class _Written(Parts):
    """The file of a training."""

    written: Literal["tiago_mj.training/1"] = Field(alias="schema")


def claim(folder: Path, settings: Settings) -> bool:
    """Make the folder of a training, or check that an existing one has the same settings.

    Returns:
        Whether the training had begun before.

    Raises:
        ValueError: the folder holds a training with other settings, or other files; one line.
    """
    path = folder / FILE
    if not path.exists():
        if folder.exists() and any(folder.iterdir()):
            raise ValueError(f"--out {folder} is not empty and holds no training: give another folder")
        atomic.write_text(path, json.dumps({"schema": SCHEMA, **settings.as_data(), "made_by": provenance()}, indent=1))
        return False
    there, given = read(folder).as_data(), settings.as_data()
    for data in (there, given):  # how many steps is said by "steps"
        data["hyperparameters"] = {k: v for k, v in data["hyperparameters"].items() if k != "n_timesteps"}
    name, old, new = _first_difference(there, given)
    if name:
        raise ValueError(
            f"--out {folder} holds a training with other settings: {name} is {_short(old)} there and {_short(new)} "
            "here; give another folder, or the same settings to go on"
        )
    return True


def read(folder: Path) -> Settings:
    """The settings of the training in a folder.

    Raises:
        ValueError: there is none, or it cannot be read; one line.
    """
    lead = f"{folder} holds no training that can be read: {FILE}"
    data = load_json(folder / FILE, lead)
    try:
        said = checked(_Written, data)
    except SchemaError as fault:
        raise ValueError(f"{lead}: {fault.path or 'it'} {fault.problem}") from fault
    return Settings(**{field.name: getattr(said, field.name) for field in fields(Settings)})


def provenance() -> dict[str, str]:
    """Versions of the software, and the commit where it is known."""
    found = {"tiago_mj": __version__, "python": platform.python_version()}
    for name in LIBRARIES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "missing"
    commit = _commit()
    return {**found, "commit": commit} if commit else found


def _commit() -> str:
    """Commit of the checkout that this package runs from; empty for an installed wheel."""
    here = Path(__file__).parent

    def git(*words: str) -> str:
        done = subprocess.run(["git", *words], cwd=here, capture_output=True, text=True, check=False)
        return done.stdout.strip() if done.returncode == 0 else ""

    try:
        if not git("ls-files", "--", Path(__file__).name):
            return ""
        return git("rev-parse", "--short", "HEAD") + ("+changes" if git("status", "--porcelain", "-uno") else "")
    except OSError:
        return ""


def _first_difference(old: Any, new: Any, name: str = "") -> tuple[str, Any, Any]:
    if isinstance(old, dict) and isinstance(new, dict):
        for key in {**old, **new}:
            found = _first_difference(old.get(key), new.get(key), f"{name}.{key}" if name else key)
            if found[0]:
                return found
        return "", None, None
    return ("", None, None) if old == new else (name, old, new)


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else text[:57] + "..."
