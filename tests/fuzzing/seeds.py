"""Valid inputs of every reader, written small."""

from __future__ import annotations

import io
import json
import sqlite3
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.dataset
import pyarrow.parquet as pq

ROWS: Final = 24
FACTS: Final = {"schema": "tiago_mj.recording/1", "robot": "arm.xml", "interface": "position", "rate_hz": 100.0}
START: Final = 1_700_000_000_000_000_000

ARM: Final = """<mujoco model="arm"><compiler angle="radian"/><option timestep="0.002"/>
<default><geom rgba="1 1 1 1"/></default>
<worldbody><body name="a" pos="0 0 1"><joint name="elbow" type="hinge" axis="0 1 0" range="-2 2" damping="0.1"/>
<geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.3"/><site name="tip" pos="0.2 0 0"/>
<body name="b" pos="0.2 0 0"><joint name="wrist" axis="0 0 1" armature="0.01"/><geom size="0.03" mass="0.1"/></body>
</body></worldbody>
<actuator><position name="elbow" joint="elbow" kp="20" ctrlrange="-2 2"/></actuator>
<sensor><jointpos name="p" joint="elbow"/></sensor><keyframe><key name="home" qpos="0.1 0"/></keyframe></mujoco>"""
#: An MJCF that takes in another, a mesh and a picture.
PARTS: Final = {
    "model.xml": """<mujoco><compiler meshdir="." texturedir="."/><include file="more.xml"/>
<asset><mesh name="m" file="part.stl"/><mesh name="o" file="part.obj"/><texture name="t" type="2d" file="t.png"/>
<material name="t" texture="t"/></asset><worldbody><body name="a"><joint name="j"/>
<geom type="mesh" mesh="m" material="t"/><geom type="mesh" mesh="o"/></body></worldbody></mujoco>""",
    "more.xml": "<mujocoinclude><worldbody><body name='c'><geom size='.1'/></body></worldbody></mujocoinclude>",
}
URDF: Final = """<robot name="r"><material name="grey"><color rgba="0.5 0.5 0.5 1"/></material>
<link name="base"><inertial><origin xyz="0 0 0.1" rpy="0 0 0"/><mass value="2"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
<visual><geometry><box size="0.1 0.2 0.3"/></geometry><material name="grey"/></visual>
<collision><geometry><cylinder radius="0.1" length="0.2"/></geometry></collision></link>
<link name="arm"><inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>
</inertial><visual><geometry><mesh filename="MESH" scale="1 1 1"/></geometry></visual></link>
<link name="hand"><inertial><mass value="0.2"/><inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/>
</inertial><collision><geometry><sphere radius="0.05"/></geometry></collision></link>
<joint name="elbow" type="revolute"><parent link="base"/><child link="arm"/><origin xyz="0 0 0.3"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="10" velocity="2"/><dynamics damping="0.1" friction="0.1"/></joint>
<joint name="slide" type="prismatic"><parent link="arm"/><child link="hand"/><axis xyz="1 0 0"/>
<limit lower="0" upper="0.1" effort="10" velocity="1"/><mimic joint="elbow" multiplier="0.05" offset="0"/></joint>
<transmission name="t"><type>x</type></transmission></robot>"""


def columns(rows: int = ROWS) -> dict[str, Any]:
    time = np.arange(rows) / 100
    return {
        "time": time,
        "command.elbow": np.sin(5 * time),
        "position.elbow": np.round(np.sin(5 * time - 0.1), 6),
        "effort.elbow": np.cos(time),
    }


def csv_text(table: dict[str, Any], delimiter: str = ",", point: str = ".") -> str:
    rows = zip(*table.values(), strict=True)
    said = [delimiter.join(f"{value:.6g}".replace(".", point) for value in row) for row in rows]
    return "\n".join([delimiter.join(table), *said]) + "\n"


def parquet(table: Any) -> bytes:
    out = io.BytesIO()
    pq.write_table(table if isinstance(table, pa.Table) else pa.table(table), out, compression="zstd")
    return out.getvalue()


def put(folder: Path, files: dict[str, str | bytes]) -> None:
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())


def recording_csv(folder: Path) -> None:
    put(folder, {"a.csv": csv_text(columns()), "a.json": json.dumps(FACTS)})
    put(folder, {"b.csv": csv_text(columns(30), ";", ","), "b.json": json.dumps({**FACTS, "units": {"time": "s"}})})


def recording_parquet(folder: Path) -> None:
    table = pa.table({**columns(), "note": ["a"] * ROWS, "on": [True] * ROWS, "count": pa.array([1] * ROWS, pa.int8())})
    put(folder, {"a.parquet": parquet(table), "a.json": json.dumps(FACTS)})


def recording_mapped(folder: Path) -> None:
    table = dict(zip(("stamp", "cmd", "q", "tau"), columns().values(), strict=True))
    map_file = (
        "columns:\n  stamp: {kind: time, unit: s}\n  cmd: command.elbow\n  q: {kind: position, name: elbow, unit: deg,"
        " scale: -1}\n  tau: null\nrobot: arm.xml\ninterface: position\nrate_hz: 100\n"
    )
    put(folder, {"a.csv": csv_text(table), "map.yaml": map_file})


def recording_model(folder: Path) -> None:
    put(folder, {"r/a.csv": csv_text(columns()), "r/a.json": json.dumps(FACTS), "r/arm.xml": ARM})


def motion(folder: Path) -> None:
    table = {key: columns()[key] for key in ("time", "command.elbow")}
    put(folder, {"m.csv": csv_text(table), "m.json": json.dumps({"interface": "position", "rate_hz": 25})})
    put(folder, {"y.yaml": "interface: position\nrate_hz: 10\ntime: [0, 0.5, 1]\ncommand.elbow: [0, 0.1, 0]\n"})


# Bags -----------------------------------------------------------------------------------------------------------------


def messages() -> list[tuple[str, int, str, Any]]:
    found: list[tuple[str, int, str, Any]] = []
    for k in range(ROWS):
        found.append(("/joint_states", 20_000_000 * k, "sensor_msgs/msg/JointState", [0.01 * k]))
        found.append(("/forward/commands", 20_000_000 * k + 1000, "std_msgs/msg/Float64MultiArray", [0.01 * k + 0.01]))
    return found


def bag(kind: str, compressed: bool = False) -> Callable[[Path], None]:
    """A bag in ``grasp`` (a folder) or ``grasp.bag``: ``ros1``, ``sqlite3`` or ``mcap``."""

    def write(folder: Path) -> None:
        from rosbags.rosbag1 import Writer as Writer1
        from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
        from rosbags.rosbag2 import Writer as Writer2
        from rosbags.typesys import Stores, get_typestore

        first = kind == "ros1"
        store = get_typestore(Stores.ROS1_NOETIC if first else Stores.ROS2_HUMBLE)
        if first:
            writer: Any = Writer1(folder / "grasp.bag")
            if compressed:
                writer.set_compression(Writer1.CompressionFormat.LZ4)
        else:
            plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
            writer = Writer2(folder / "grasp", version=9, storage_plugin=plugin)
            if compressed:
                writer.set_compression(
                    CompressionMode.STORAGE if kind == "mcap" else CompressionMode.MESSAGE, CompressionFormat.ZSTD
                )
        with writer:
            connections: dict[str, Any] = {}
            for topic, stamp, name, content in messages():
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, name, typestore=store)
                message = _message(store, name, content, START + stamp, first)
                raw = store.serialize_ros1(message, name) if first else store.serialize_cdr(message, name)
                writer.write(connections[topic], START + stamp, raw)

    return write


def _message(store: Any, kind: str, content: Sequence[float], stamp: int, first: bool) -> Any:
    types = store.types
    if kind.endswith("JointState"):
        when = types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
        header = types["std_msgs/msg/Header"](stamp=when, frame_id="", **({"seq": 0} if first else {}))
        return types[kind](
            header=header, name=["elbow"], position=np.array(content), velocity=np.zeros(1), effort=np.zeros(0)
        )
    layout = types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    return types[kind](layout=layout, data=np.array(content, dtype=np.float64))


def bag_of_definitions(folder: Path, definition: str, name: str = "made_up/msg/Thing") -> None:
    """A sqlite3 bag whose messages are of a type that the bag itself describes."""
    bag("sqlite3")(folder)
    path = next((folder / "grasp").glob("*.db3"))
    base = sqlite3.connect(path)
    with base:
        base.execute(
            "UPDATE message_definitions SET encoded_message_definition = ?, topic_type = ?", (definition, name)
        )
        base.execute("UPDATE topics SET type = ?", (name,))
    base.close()


# Agents and trainings -------------------------------------------------------------------------------------------------


def agent(inputs: int = 10, joints: int = 2, **more: Any) -> Any:
    from tiago_mj.learn.agent_file import Agent

    rng = np.random.default_rng(0)
    layers = tuple(
        (rng.normal(size=(out, width)).astype(np.float32), np.zeros(out, dtype=np.float32))
        for width, out in ((inputs, 8), (8, joints))
    )
    bounds = np.ones(joints, dtype=np.float32)
    return Agent(layers, "ReLU", "tanh", (("", inputs),), -bounds, bounds, origin={"env": "GripperTactile-v0"}, **more)


def agents(folder: Path) -> None:
    agent().save(folder / "plain.npz")
    agent(mean=np.zeros(10), deviation=np.ones(10)).save(folder / "normal.npz")


def tiny_settings() -> Any:
    from tiago_mj.learn.settings import Settings
    from tiago_mj.learn.zoo_form import read_hyperparameters

    name = "tiago_mj/GripperTactile-v0"
    given = read_hyperparameters("td3", name)
    given = {
        **given,
        "n_envs": 1,
        "learning_starts": 10,
        "policy_kwargs": {"net_arch": [4]},
        "train_freq": [10, "step"],
    }
    return Settings(name, "td3", 60, {"max_episode_steps": 20}, None, given)


# Data sets of others --------------------------------------------------------------------------------------------------


def xl330(folder: Path) -> None:
    from tiago_mj.recordings.imports.xl330 import MOTOR

    entries = [
        {"timestamp": 0.005 * k, "position": 0.01 * k, "speed": 0.1, "goal_position": 0.01 * k, "torque_enable": True,
         "load": 3 * k, "input_volts": 7.4, "temp": 30}
        for k in range(ROWS)
    ]  # fmt: skip
    facts = {"motor": MOTOR, "mass": 0.49, "length": 0.1, "kp": 100, "vin": 7.4, "trajectory": "sin"}
    put(folder, {"run.json": json.dumps({**facts, "entries": entries})})


def so101(folder: Path) -> None:
    stamps = [1_000_000 + 20_000 * k for k in range(ROWS)]
    sent = "\n".join(f'{t},"[{0.01 * k}, {0.02 * k}]"' for k, t in enumerate(stamps))
    seen = "\n".join(f'{t},"[{0.01 * k}, 0.1]","[0.1, 0]","[0, 0]"' for k, t in enumerate(stamps))
    put(folder, {"m/control.csv": f"timestamp,positions\n{sent}\n", "m/joint_list.txt": "pan\nJaw\n"})
    put(folder, {"m/state_motor.csv": f"timestamp,positions,velocities,torques\n{seen}\n"})


def ta11(folder: Path) -> None:
    rows = [f"first,apple,{dq},{300 * dq}" for dq in (0.001, 0.0015, 0.002, 0.0025)]
    put(folder, {"force.csv": "series,object,dq_m,force_sensor_units\n" + "\n".join(rows) + "\n"})


def tiago_arm(folder: Path) -> None:
    from tiago_mj.recordings.imports.tiago_arm import JOINTS

    for quantity in ("position", "velocity", "effort"):
        table = {"t": np.arange(ROWS) / 100, **{f"- {j}_{quantity}": np.sin(np.arange(ROWS) / 9) for j in JOINTS}}
        put(folder, {f"tiago_{quantity}.csv": csv_text(table)})


def demo_arm(folder: Path) -> None:
    from tiago_mj.demo.arm_torque import FOLDER, JOINTS

    table = {"t": np.arange(120) / 100, **{f"j{k}": np.sin(np.arange(120) / 9) for k in range(len(JOINTS))}}
    put(folder, {f"{FOLDER}/tiago_{quantity}.csv": csv_text(table) for quantity in ("position", "effort", "velocity")})


def lerobot(version: str) -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        rows, episodes = 12, 2
        count = rows * episodes
        wave = np.linspace(0, 100, count * 2, dtype=np.float32)
        lists = pa.FixedSizeListArray.from_arrays(pa.array(wave), 2)
        table = {
            "episode_index": np.repeat(np.arange(episodes), rows),
            "frame_index": np.tile(np.arange(rows), episodes),
            "timestamp": np.tile(np.arange(rows, dtype=np.float32) / np.float32(30), episodes),
            "observation.state": lists,
            "action": lists,
        }
        listed = [{"episode_index": k, "tasks": ["Grab"], "length": rows} for k in range(episodes)]
        feature = {"dtype": "float32", "shape": [2], "names": ["elbow.pos", "wrist.pos"]}
        info = {
            **{"codebase_version": version, "robot_type": "so101", "fps": 30, "total_episodes": episodes},
            "features": {"observation.state": feature, "action": feature},
        }
        put(folder, {"meta/info.json": json.dumps(info), "data/chunk-000/file-000.parquet": parquet(table)})
        if version == "v3.0":
            put(folder, {"meta/episodes/chunk-000/file-000.parquet": parquet(pa.Table.from_pylist(listed))})
        else:
            put(folder, {"meta/episodes.jsonl": "".join(json.dumps(entry) + "\n" for entry in listed)})

    return write


MINARI_MAP: Final = (
    "columns:\n  observations.0: position.elbow\n  actions.0: {kind: command, name: elbow}\nrate_hz: 25\n"
    "interface: effort\nrobot: arm.xml\n"
)


def minari(form: str) -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        said = {"total_episodes": 1, "data_format": form, "dataset_id": "mine/x-v0"}
        said["env_spec"] = json.dumps({"id": "CartPole-v1", "kwargs": {}})
        put(folder, {"data/metadata.json": json.dumps(said), "map.yaml": MINARI_MAP})
        seen = np.linspace(0, 1, 2 * ROWS).reshape(ROWS, 2)
        if form == "hdf5":
            import h5py

            with h5py.File(folder / "data" / "main_data.hdf5", "w") as file:
                group = file.create_group("episode_0")
                group.attrs["seed"] = 3
                group["observations"], group["actions"] = seen, seen[:-1, :1]
                group.create_group("infos")["x"] = seen[:, 0]
            return
        kind = pa.float64()
        batch = {
            "observations": pa.FixedSizeListArray.from_arrays(pa.array(seen.ravel(), kind), 2),
            "actions": pa.FixedSizeListArray.from_arrays(pa.array(seen[:, 0], kind), 1),
        }
        pyarrow.dataset.write_dataset(pa.table(batch), folder / "data" / "0", format=form)
        put(folder, {"data/0/metadata.json": json.dumps({"id": 0, "seed": 3})})

    return write


def meshes(folder: Path, kinds: Sequence[str] = ("stl", "obj", "dae", "ply", "glb", "off")) -> None:
    import trimesh

    box = trimesh.creation.box((0.1, 0.2, 0.3))
    for kind in kinds:
        content = box.export(file_type=kind)
        put(folder, {f"part.{kind}": content})


def png() -> bytes:
    import imageio.v3 as iio

    return iio.imwrite("<bytes>", np.full((8, 8, 3), 100, dtype=np.uint8), extension=".png")
