"""The one table of environments: id, task, arguments, time limit."""

from __future__ import annotations

import difflib
import inspect
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any, Final

import gymnasium

from tiago_mj.models import names

NAMESPACE: Final = "tiago_mj"
#: What ``gymnasium.make`` and ``make_vec`` take as well.
FURTHER: Final = frozenset(
    {"max_episode_steps", "num_envs", "autoreset_mode", "threads", "episode_statistics", "draw_effects"}
)


@dataclass(frozen=True)
class Registered:
    """One environment.

    Attributes:
        task: module and class of the goal environment.
        steps: time limit in control steps.
        arguments: of the class, where they differ from its defaults.
        relative: for the flat views: number of last entries taken relative to the goal; None for the goal form.
    """

    task: str
    steps: int
    arguments: Mapping[str, Any] = field(default_factory=dict)
    relative: int | None = None


_TIAGO: Final = {"robot": "tiago_ta11", "joints": names.TIAGO_JOINTS, "object_offset": 0.0018}
_PAL: Final = {**_TIAGO, "robot": "tiago_pal_gripper", "force_type": "none"}
_HOLD: Final = "tiago_mj.envs.hold_force:HoldForce"
_STEADY: Final = "tiago_mj.envs.hold_steady:HoldForceSteady"
_CLOSE: Final = "tiago_mj.envs.close:GripperClose"
_REACH: Final = "tiago_mj.envs.reach:Reach"
_PUSH: Final = "tiago_mj.envs.push:Push"
_PICK: Final = "tiago_mj.envs.pick_and_place:PickAndPlace"
_FEEL: Final = {"robot": "tiago_ta11", "force_type": "raw"}

ENVIRONMENTS: Final[Mapping[str, Registered]] = {
    "GripperTactile-v0": Registered(_HOLD, 300, relative=2),
    "GripperTactileGoal-v0": Registered(_HOLD, 300),
    "GripperTactileSteady-v0": Registered(_STEADY, 300, relative=0),
    "TIAGoTactile-v0": Registered(_HOLD, 300, _TIAGO, relative=2),
    "TIAGoTactileGoal-v0": Registered(_HOLD, 300, _TIAGO),
    "TIAGoPALGripper-v0": Registered(_HOLD, 300, _PAL, relative=0),
    "GripperClose-v0": Registered(_CLOSE, 300, relative=2),
    "GripperCloseGoal-v0": Registered(_CLOSE, 300),
    "TIAGoReach-v0": Registered(_REACH, 50),
    "TIAGoReachTactile-v0": Registered(_REACH, 50, _FEEL),
    "TIAGoPush-v0": Registered(_PUSH, 100),
    "TIAGoPushTactile-v0": Registered(_PUSH, 100, _FEEL),
    "TIAGoPickAndPlace-v0": Registered(_PICK, 100),
    "TIAGoPickAndPlaceTactile-v0": Registered(_PICK, 100, _FEEL),
}


def make_scalar(*, task: str, relative: int | None, **arguments: Any) -> gymnasium.Env[Any, Any]:
    """Build one environment of the table: the goal environment, or its flat view.

    Raises:
        ValueError: an argument is unusable, or there is none of that name; one line.
    """
    module, name = task.split(":")
    kind = getattr(import_module(module), name)
    check_names(kind, arguments)
    core: Any = kind(**arguments)
    if relative is None:
        return core
    from tiago_mj.envs.flat import FlatView

    # What is observed decides what there is to take relative to the goal.
    observed = 0 if arguments.get("force_type") == "none" else relative
    return FlatView(core, observed)


def check_names(kind: type, arguments: Iterable[str]) -> None:
    """Refuse an argument that no environment of a class takes; its bases take what it hands on.

    Raises:
        ValueError: says the name that is nearest.
    """
    known: set[str] = set()
    for base in kind.__mro__:
        if "__init__" in vars(base) and base.__module__.startswith(f"{__package__}."):
            parameters = inspect.signature(base.__init__).parameters.values()  # type: ignore[misc]
            known |= {p.name for p in parameters if p.kind is inspect.Parameter.KEYWORD_ONLY}
            known |= set(vars(base).get("ARGUMENTS", ()))
    for name in arguments:
        if name not in known:
            near = difflib.get_close_matches(name, sorted(known | FURTHER), n=1, cutoff=0.5)
            hint = f"did you mean {near[0]!r}?" if near else f"there are {', '.join(sorted(known))}"
            raise ValueError(f"{kind.__name__} has no argument {name!r}: {hint}")


def make_vector(
    *,
    task: str,
    relative: int | None,
    num_envs: int,
    max_episode_steps: int | None = None,
    autoreset_mode: Any = "NextStep",
    threads: int = 0,
    episode_statistics: bool = False,
    draw_effects: Any = None,
    **arguments: Any,
) -> gymnasium.vector.VectorEnv[Any, Any, Any]:
    """Build many environments of the table in one; see :class:`tiago_mj.vector.env.VectorRobotEnv`."""
    from tiago_mj.vector.env import VectorRobotEnv

    return VectorRobotEnv(
        make_scalar(task=task, relative=relative, **arguments),  # type: ignore[arg-type]
        num_envs,
        max_episode_steps=max_episode_steps,
        autoreset_mode=autoreset_mode,
        threads=threads,
        episode_statistics=episode_statistics,
        draw_effects=draw_effects,
    )


def full_id(name: str) -> str:
    """The id that ``gymnasium.make`` takes: with the namespace where it is one of this package's and lacks it."""
    return f"{NAMESPACE}/{name}" if name in ENVIRONMENTS else name


def import_and_make(name: str, **arguments: str) -> str:
    """Python that makes an environment, in one line that may be copied as it is."""
    words = [full_id(name), *arguments.values()]
    first, *rest = (json.dumps(word, ensure_ascii=False) for word in words)
    given = "".join(f", {key}={word}" for key, word in zip(arguments, rest, strict=True))
    return f"import gymnasium, tiago_mj; env = gymnasium.make({first}{given})"


def register() -> None:
    """Make every environment known to gymnasium, under ``tiago_mj/``."""
    for name, entry in ENVIRONMENTS.items():
        gymnasium.register(
            id=f"{NAMESPACE}/{name}",
            entry_point="tiago_mj.registration:make_scalar",
            vector_entry_point="tiago_mj.registration:make_vector",
            max_episode_steps=entry.steps,
            kwargs={"task": entry.task, "relative": entry.relative, **entry.arguments},
        )
