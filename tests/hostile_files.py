"""Every reader of files that users bring, a small valid file for each, and what somebody may do to such a file."""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tiago_mj.effects import read_effects
from tiago_mj.gap.report import json as report_json
from tiago_mj.models.convert import extras
from tiago_mj.models.convert.errors import ConversionError
from tiago_mj.recordings.imports.lerobot_folder import open_folder
from tiago_mj.recordings.imports.minari_folder import open_dataset
from tiago_mj.recordings.imports.xl330 import MOTOR, read_run
from tiago_mj.recordings.motions.play import read_motion
from tiago_mj.recordings.read import read_recordings
from tiago_mj.recordings.read.bags import topic_map
from tiago_mj.recordings.read.mapping import column_map, load_map
from tiago_mj.recordings.recording import RecordingError
from tiago_mj.sensing.sheet import read_load_cell

JOINT = "gripper_right_finger_joint"


@dataclass(frozen=True)
class Reader:
    """A reader and a file that it accepts.

    Attributes:
        name: of the file, with folders.
        read: takes its path.
        content: valid, as data.
        error: what it raises, that class and no other.
    """

    name: str
    read: Callable[[Path], Any]
    content: Any
    error: type[Exception] = ValueError

    @property
    def is_json(self) -> bool:
        return self.name.endswith(".json")

    def text(self, content: Any) -> str:
        if self.is_json:
            return json.dumps(content)
        return yaml.safe_dump(content, allow_unicode=True, width=1e9)

    def place(self, folder: Path, content: str | bytes) -> Path:
        """Write a file where its reader looks for it."""
        path = folder / self.name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8", "surrogatepass"))
        return path


def _with_sidecar(path: Path) -> Any:
    table = path.with_suffix(".csv")
    if not table.exists():
        time = np.arange(30) / 25
        rows = np.column_stack([time, 0.02 * np.sin(time), 0.02 * np.cos(time)])
        header = f"time,command.{JOINT},position.{JOINT}"
        np.savetxt(table, rows, delimiter=",", header=header, comments="")
    return read_recordings([table])


def _with_map(path: Path) -> Any:
    content = load_map(path)
    topics = topic_map(content["topics"]) if "topics" in content else ()
    return column_map(content, path.name), topics


def _hyperparameters(path: Path) -> Any:
    from tiago_mj.learn.zoo_form import read_hyperparameters

    return read_hyperparameters("td3", "GripperTactile-v0", path)


def _ranges(path: Path) -> Any:
    from tiago_mj.io.loading import load_yaml
    from tiago_mj.learn.randomise import read_ranges

    return read_ranges(load_yaml(path, "the ranges are no YAML"), "ranges")


def _settings(path: Path) -> Any:
    from tiago_mj.learn.settings import read

    return read(path.parent)


_FITTED = {"value": 2.6, "low": 2.4, "high": 2.9, "unit": "N"}
_EFFECT = {"name": "coulomb_friction", "target": JOINT}
_CLOSING = {"before": 58.3, "after": 1.4, "closed": 0.99, "low": 0.97, "high": None}
_PLACE = {"channel": "force.right", "phase": "hold", "band": "bias", "gap": 3.1, "low": 2.0, "high": None, "share": 0.4}
_DIAGNOSIS = {
    "schema": "tiago_mj.diagnosis/1",
    "verdict": {
        "kind": "effect",
        "effects": [{**_EFFECT, "parameters": {"force": _FITTED}}],
        "probability": 0.97,
        "alternatives": [{"effects": [_EFFECT], "probability": 0.97}],
        "remains": {"flag": True, "where": [_PLACE]},
        "not_excited": ["pad_creep"],
    },
    "where": [_PLACE],
    "stage": "transmission",
    "shrink": {
        **{"before": 58.3, "after": 1.4, "floor": 1.0, "closed": 0.99, "low": 0.97, "high": 1.0},
        "per_channel": {"force.right": _CLOSING},
        "return": {"policy": "pi", "nominal": -3.0, "repaired": -2.0, "measured": None},
        "per_phase": {"hold": _CLOSING},
        "per_channel_and_phase": {"force.right": {"hold": _CLOSING}},
        "resampled": "trials",
        "accounted": None,
        "with_numbers": _CLOSING,
    },
    "ranking": [
        {
            "effects": [_EFFECT],
            "validation_gain": 50.1,
            "probability": 0.97,
            "parameters": {"coulomb_friction": {"force": _FITTED}},
            "evidence": {"met": 12.0, "price": 3.0, "misfit": 1.1, "lasting": 0.9, "edge": False},
        }
    ],
    "numbers": [
        {
            **{"name": "servo_stiffness", "target": "finger", "parameter": "factor"},
            **{"value": 1.02, "low": 1.01, "high": 1.03, "unit": "-", "nominal": 1.0},
        }
    ],
    "lint": [{"code": "quantum", "file": "a.parquet", "channel": "", "message": "coarse", "repaired": False}],
    "next_motion": {"file": "sweep.csv", "resolves": [["coulomb_friction", "backlash"]], "expected_probability": 0.9},
    "splits": {"train": ["a"], "validation": ["b"], "test": []},
    "robot": "tiago_mj/GripperTactile-v0",
    "notes": ["one"],
    "complete": True,
    "seed": 0,
    "version": "0.1",
    "seconds": 3.2,
}
_XL330_ENTRY = dict.fromkeys(
    ("timestamp", "position", "speed", "goal_position", "torque_enable", "load", "input_volts", "temp"), 0.1
)

READERS = {
    "sidecar": Reader(
        "grasp.json",
        _with_sidecar,
        {
            "schema": "tiago_mj.recording/1",
            "trial": "grasp",
            "robot": "tiago_mj/GripperTactile-v0",
            "rate_hz": 25,
            "interface": "position",
            "servo": {"name": "pal", "effort_limit": {JOINT: 16.0}},
            "sensing": {"scale": [100, 90.5], "contact_unit": 606.06, "average": 1, "noise": 0.01, "bias": 0.0},
            "object": {"shape": "box", "radius_m": 0.02, "mass_kg": 0.42, "offset_m": 0.003, "position_m": [0.1, 0.2]},
            "initial": {"position": {JOINT: 0.0}, "set_point": {JOINT: 0.0}},
            "goal": [1.0, 1.0],
            "motion": {"policy": "pi"},
            "source": {"seed": 3},
            "units": {"time": "s"},
            "uncertainty": {"force": 0.02},
        },
        RecordingError,
    ),
    "map": Reader(
        "map.yaml",
        _with_map,
        {
            "columns": {
                "stamp": {"kind": "time", "unit": "us"},
                "q": {"kind": "position", "name": JOINT, "unit": "mm", "scale": -1},
                "tau": f"effort.{JOINT}",
                "battery": None,
            },
            "topics": {
                "/joint_states": {"kind": "joint_state", "joints": ["elbow"], "stamp": "bag"},
                "/ta11": {"kind": "force", "names": ["right", "left"], "optional": True},
            },
            "robot": "arm.xml",
            "rate_hz": 50,
        },
        RecordingError,
    ),
    "calibration": Reader(
        "calibration.yaml",
        read_effects,
        {
            "schema": "tiago_mj.calibration/1",
            "robot": "arm.xml",
            "rate_hz": 100.0,
            "interface": "position",
            "timestep": 0.002,
            "joints": ["elbow"],
            "actuators": ["motor"],
            "effects": [
                {**_EFFECT, "parameters": {"force": _FITTED}},
                {"name": "force_lag", "target": ["right", "left"], "parameters": {"time_constant": 0.03}},
            ],
            "source": {"file": "diagnosis.json", "sha256": "0"},
        },
    ),
    "effects": Reader(
        "effects.json",
        lambda path: read_effects("[" + path.read_text(encoding="utf-8", errors="surrogateescape") + "]"),
        {**_EFFECT, "parameters": {"force": 2.5}},
    ),
    "diagnosis": Reader("diagnosis.json", report_json.load, _DIAGNOSIS),
    "motion": Reader(
        "motion.yaml",
        read_motion,
        {"interface": "velocity", "rate_hz": 25, "time": [0.0, 0.5, 1.0], f"command.{JOINT}": [-0.02, 0.0, 0.02]},
    ),
    "sensor": Reader(
        "cell.yaml",
        read_load_cell,
        {
            "schema": "tiago_mj.sensor/1",
            "scale": 100,
            "contact_unit": 606.06,
            "noise": [0.0077, 0.008],
            "bias": 0.0,
            "threshold": [0.0385, 0.0385],
            "average": 1,
        },
    ),
    "hyperparameters": Reader(
        "td3.yml",
        _hyperparameters,
        {
            "GripperTactile-v0": {
                "n_timesteps": "4e5",
                "n_envs": 2,
                "policy": "MlpPolicy",
                "policy_kwargs": "dict(net_arch=[400, 300], activation_fn=nn.ReLU)",
                "env_kwargs": {"object_offset": 0.0},
                "learning_rate": "lin_1e-3",
                "train_freq": [1, "episode"],
                "normalize": {"norm_obs": True},
                "noise_type": "normal",
                "noise_std": 0.1,
                "hold_share": 0.5,
                "gamma": 0.99,
            }
        },
    ),
    "ranges": Reader(
        "ranges.yaml", _ranges, {"command_delay": {"seconds": [0.0, 0.03]}, "force_gain": {"factor": 1.1}}
    ),
    "settings": Reader(
        "settings.json",
        _settings,
        {
            "schema": "tiago_mj.training/1",
            "env": "tiago_mj/GripperTactile-v0",
            "algo": "td3",
            "steps": 1000,
            "env_options": {"object_offset": 0.0},
            "effects": None,
            "hyperparameters": {"n_envs": 1},
            "updates_per_step": 0.5,
            "randomise": {"force_gain": {"factor": [0.5, 2.0]}},
        },
    ),
    "additions": Reader(
        "robot.yaml",
        extras.read,
        {
            "option": {"timestep": 0.002},
            "bodies": {"base": {"gravcomp": 1}},
            "capsules": ["base"],
            "sites": [{"name": "s", "body": "base"}],
            "sensors": [{"type": "touch", "name": "t", "site": "s"}],
            "exclude": [["base", "hand"]],
            "keyframes": {"home": {"elbow": 0.1}},
        },
        ConversionError,
    ),
    "minari": Reader(
        "metadata.json",
        lambda path: open_dataset(str(path.parent)),
        {
            "env_spec": '{"id": "CartPole-v1", "kwargs": {}}',
            "data_format": "hdf5",
            "total_episodes": 3,
            "dataset_id": "mine/cart-v0",
        },
        RecordingError,
    ),
    "lerobot": Reader(
        "meta/info.json",
        lambda path: open_folder(str(path.parents[1])),
        {
            "codebase_version": "v3.0",
            "robot_type": "so101",
            "fps": 30,
            "total_episodes": 2,
            "features": {
                "observation.state": {"shape": [2], "names": ["a", "b"]},
                "action": {"shape": [2], "names": {"motors": ["a", "b"]}},
            },
        },
        RecordingError,
    ),
    "xl330": Reader(
        "run.json",
        read_run,
        {
            "motor": MOTOR,
            "mass": 0.1,
            "length": 0.1,
            "kp": 400,
            "vin": 5.0,
            "trajectory": "sin",
            "entries": [{**_XL330_ENTRY, "timestamp": 0.005 * k} for k in range(20)],
        },
        RecordingError,
    ),
}  # fmt: skip

#: Ten levels of nine aliases each: 3.5 billion values in 400 bytes.
BOMB = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]\n" for k in range(1, 10)
)

HOSTILE_YAML = {
    "aliases of aliases": BOMB,
    "merges of merges": "a0: &a0 {x: 1}\n" + "".join(
        f"a{k}: &a{k} {{<<: [{', '.join([f'*a{k - 1}'] * 9)}]}}\n" for k in range(1, 10)
    ),
    "alias of itself": "a: &a [*a]\n",
    "flow nesting": "[" * 100_000,
    "block nesting": "- " * 100_000,
    "digits": "schema: " + "9" * 100_000,
    "hexadecimal digits": "schema: 0x" + "f" * 100_000,
    "sexagesimal digits": "schema: 1" + ":59" * 100_000,
    "overflow": "schema: 1.0e+400",
    "Python": "schema: !!python/object/apply:os.system [true]",
    "turned around": "schema: '\u202egpj.exe'",
    "null character": 'schema: "\\0"',
    "list as a key": "? [a, b]\n: 1\n",
    "twice": "schema: 1\nschema: 2\n",
    "two documents": "a: 1\n---\nb: 2\n",
    "many directives": "%TAG !a! x\n" * 100_000 + "---\na: 1\n",
    "many values": "- [1, 2, 3]\n" * 120_000,
    "not UTF-8": b"schema: \xff\xfe",
    "nothing": "",
    "a number": "3",
    "a list": "- 1\n",
    "long word": "x" * 10_000_000,
    "too large": "# " + "x" * 20_000_000,
}  # fmt: skip

HOSTILE_JSON = {
    "nesting": "[" * 100_000,
    "closed nesting": "[" * 5_000 + "]" * 5_000,
    "objects within objects": '{"a":' * 5_000 + "1" + "}" * 5_000,
    "digits": '{"schema": ' + "9" * 100_000 + "}",
    "overflow": '{"schema": 1e400}',
    "turned around": '{"schema": "\u202egpj.exe"}',
    "turned around, escaped": '{"\\u202eschema": 1}',
    "half a character": '{"schema": "\\ud800"}',
    "null character": '{"schema": "\\u0000"}',
    "twice": '{"schema": 1, "schema": 2}',
    "more behind": '{"schema": 1} {}',
    "many values": "[" + "[]," * 1_000_000 + "1]",
    "not UTF-8": b'{"schema": "\xff"}',
    "nothing": "",
    "a number": "3",
    "a list": "[1]",
    "long word": '"' + "x" * 10_000_000 + '"',
    "too large": " " * 20_000_000,
}

#: What is put in place of a part of a valid file.
VALUES = (
    float("nan"), float("inf"), -float("inf"), 1e300, -1, 0, 10**18, True, None, "", "x" * 5_000, "a\nb", "nan", "-1",
    [], {}, [[]], [{}], {"a": 1}, [None], [1, "x"], {"": {}}, ["backlash"], [float("nan")], "/etc/passwd", "../x.xml",
)  # fmt: skip


def mutated(content: Any, rng: random.Random) -> Any:
    """A copy of data in which one part is another, or gone, or has company."""
    copy = json.loads(json.dumps(content))
    parents: list[Any] = []
    stack = [copy]
    while stack:
        one = stack.pop()
        if isinstance(one, (dict, list)) and one:
            parents.append(one)
            stack += one.values() if isinstance(one, dict) else one
    where = rng.choice(parents)
    key = rng.choice(list(where)) if isinstance(where, dict) else rng.randrange(len(where))
    kind = rng.random()
    if kind < 0.6:
        where[key] = rng.choice(VALUES)
    elif kind < 0.75:
        del where[key]
    elif kind < 0.85 and isinstance(where, dict):
        where[rng.choice(["", "x", f"{key}s", "name", "\u00e4", "x" * 200])] = rng.choice([where[key], *VALUES])
    elif isinstance(where, dict):
        where[rng.choice(list(where))] = where[key]
    else:
        where.append(rng.choice([where[key], *VALUES]))
    return copy


def scrambled(text: bytes, rng: random.Random) -> bytes:
    """Bytes of which a few are others, or gone, or there twice."""
    data = bytearray(text)
    for _ in range(rng.randint(1, 4)):
        at, length = rng.randrange(len(data) + 1), rng.randint(1, 12)
        kind = rng.randrange(4)
        if kind == 0:
            data[at : at + length] = b""
        elif kind == 1:
            data[at:at] = data[at : at + length]
        elif kind == 2:
            data[at : at + 1] = bytes([rng.randrange(256)])
        else:
            data[at:at] = rng.choice(
                [b"[", b"{", b"}", b":", b",", b'"', b"&a ", b"*a", b"- ", b"\n", b"1e999", b"NaN"]
            )
    return bytes(data)
