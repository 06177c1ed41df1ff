"""Inputs that are made by code, because they are large, or because only a writer of their format can make them.

Each writes a whole input of one reader (:data:`tests.fuzzing.targets.TARGETS`) below a folder.
"""

from __future__ import annotations

import io
import json
import sqlite3
import struct
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
from hostile_files import BOMB

from fuzzing import seeds

MILLION: Final = 1_000_000


def _replaced(write: Callable[[Path], None], name: str, change: Callable[[bytes], bytes]) -> Callable[[Path], None]:
    """A valid input of which one file is another."""

    def made(folder: Path) -> None:
        write(folder)
        path = folder / name
        path.write_bytes(change(path.read_bytes()))

    return made


# Bags -----------------------------------------------------------------------------------------------------------------


def _database(*statements: str) -> Callable[[Path], None]:
    """A sqlite3 bag after some statements of SQL."""

    def made(folder: Path) -> None:
        seeds.bag("sqlite3")(folder)
        base = sqlite3.connect(next((folder / "grasp").glob("*.db3")))
        with base:
            for statement in statements:
                base.execute(statement)
        base.close()

    return made


_ENDLESS: Final = "WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c)"


def _definition(text: str, name: str = "made_up/msg/Thing") -> Callable[[Path], None]:
    return lambda folder: seeds.bag_of_definitions(folder, text, name)


def _idl(folder: Path) -> None:
    """A constant that takes a gigabyte."""
    text = "module a { module msg { const long x = 1 << 9000000000; struct T { double y; }; }; };"
    seeds.bag("sqlite3")(folder)
    base = sqlite3.connect(next((folder / "grasp").glob("*.db3")))
    with base:
        base.execute("UPDATE message_definitions SET encoding = 'ros2idl', encoded_message_definition = ?", (text,))
    base.close()


def _packed_chunk(folder: Path) -> None:
    """An MCAP whose one chunk is some kilobytes of zstd, and two gigabytes unpacked."""
    import pyarrow as arrow

    folder = folder / "grasp"
    folder.mkdir()
    size = 2000 * MILLION
    codec = arrow.Codec("zstd", compression_level=1)
    packed = bytes(codec.compress(bytes(size)))

    def text(value: bytes) -> bytes:
        return struct.pack("<I", len(value)) + value

    def record(kind: int, content: bytes) -> bytes:
        return struct.pack("<BQ", kind, len(content)) + content

    chunk = struct.pack("<QQQI", 0, 1, size, 0) + text(b"zstd") + struct.pack("<Q", len(packed)) + packed
    magic = b"\x89MCAP0\r\n"
    body = record(1, text(b"ros2") + text(b"x")) + record(6, chunk) + record(15, bytes(4))
    (folder / "grasp.mcap").write_bytes(magic + body + record(2, bytes(20)) + magic)
    _metadata(folder, "mcap", "grasp.mcap")


def _metadata(folder: Path, storage: str, file: str, **more: str) -> None:
    said = {
        **{"version": 5, "storage_identifier": storage, "relative_file_paths": [file], "message_count": 10},
        **{"duration": {"nanoseconds": 1}, "starting_time": {"nanoseconds_since_epoch": 1}},
        "topics_with_message_count": [],
        **more,
    }
    (folder / "metadata.yaml").write_text(json.dumps({"rosbag2_bagfile_information": said}))


def _packed_file(folder: Path) -> None:
    """A bag in one zstd file of some kilobytes that is four gigabytes unpacked."""
    folder = folder / "grasp"
    folder.mkdir()
    with (folder / "g.db3.zstd").open("wb") as file, pa.CompressedOutputStream(file, "zstd") as out:
        for _ in range(400):
            out.write(bytes(10 * MILLION))
    _metadata(folder, "sqlite3", "g.db3.zstd", compression_format="zstd", compression_mode="FILE")


def _bag_yaml(text: str) -> Callable[[Path], None]:
    return _replaced(seeds.bag("mcap"), "grasp/metadata.yaml", lambda old: text.encode() + old)


# HDF5 -----------------------------------------------------------------------------------------------------------------


def _hdf5(change: Callable[[Any], None]) -> Callable[[Path], None]:
    def made(folder: Path) -> None:
        import h5py

        seeds.minari("hdf5")(folder)
        with h5py.File(folder / "data" / "main_data.hdf5", "a") as file:
            change(file)

    return made


def _circle(file: Any) -> None:
    """Groups that hold each other: paths without end, and ever more of them."""
    group = file["episode_0"].create_group("infos/a")
    for name in ("x", "y", "z"):
        group[name] = group


def _packed_rows(file: Any) -> None:
    group = file["episode_0"]
    for k in range(40):
        group.create_dataset(f"infos/p{k}", (900_000, 40), "f8", compression="gzip", chunks=(900_000, 1))


def _named_type(file: Any) -> None:
    file["episode_0/infos/t"] = np.dtype("f8")


def _external(file: Any) -> None:
    import h5py

    file["episode_0/infos/e"] = h5py.ExternalLink("/etc/passwd", "/")
    del file["episode_0/actions"]
    file["episode_0"].create_dataset("actions", (400,), "u1", external=[("/etc/passwd", 0, 400)])


# Tables and meshes ------------------------------------------------------------------------------------------------


def _columns(**more: Any) -> Callable[[Path], None]:
    def made(folder: Path) -> None:
        table = pa.table({**seeds.columns(2000), **{name: build() for name, build in more.items()}})
        seeds.put(folder, {"a.parquet": seeds.parquet(table), "a.json": json.dumps(seeds.FACTS)})

    return made


def _repeated(value: Any) -> Any:
    return pa.DictionaryArray.from_arrays(pa.array(np.zeros(2000, dtype=np.int32)), pa.array([value]))


def _many_rows(folder: Path) -> None:
    """900 000 rows of 40 columns in some kilobytes: as many as are read."""
    count = 44
    table = pa.table({"time": np.arange(900_000) / 1000, **{f"position.j{k}": np.zeros(900_000) for k in range(count)}})
    out = io.BytesIO()
    import pyarrow.parquet as pq

    pq.write_table(table, out, compression="zstd")
    seeds.put(folder, {"a.parquet": out.getvalue(), "a.json": json.dumps(seeds.FACTS)})


def _mesh(
    kind: str, content: bytes | None = None, change: Callable[[bytes], bytes] | None = None
) -> Callable[[Path], None]:
    def made(folder: Path) -> None:
        seeds.meshes(folder, (kind,))
        path = folder / f"part.{kind}"
        if content is not None:
            path.write_bytes(content)
        if change is not None:
            path.write_bytes(change(path.read_bytes()))
        seeds.put(folder, {"robot.urdf": seeds.URDF.replace("MESH", f"part.{kind}")})

    return made


_LAUGHS: Final = (
    "<!DOCTYPE x [<!ENTITY a0 'xxxxxxxxxx'>"
    + "".join(f"<!ENTITY a{k} '{f'&a{k - 1};' * 10}'>" for k in range(1, 10))
    + "]>"
)


_A_FILE: Final = "<!DOCTYPE x [<!ENTITY e SYSTEM 'file:///etc/passwd'>]>"
_POINTS: Final = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"


def _with_type(declared: str, entity: str) -> Callable[[bytes], bytes]:
    """A DAE with a document type, whose creation date is an entity."""

    def change(old: bytes) -> bytes:
        text = old.decode()
        begin = text.index("<COLLADA")
        return (declared + text[begin:].replace("<created>", f"<created>{entity}", 1)).encode()

    return change


def _glb(document: Mapping[str, Any]) -> bytes:
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    return struct.pack("<4sIIII", b"glTF", 2, 20 + len(text), len(text), 0x4E4F534A) + text


def _glb_with(**changes: Callable[[Any], Any]) -> Callable[[bytes], bytes]:
    """A valid GLB with parts of its JSON changed."""

    def change(old: bytes) -> bytes:
        (length,) = struct.unpack_from("<I", old, 12)
        document = json.loads(old[20 : 20 + length])
        for key, new in changes.items():
            document[key] = new(document.get(key))
        head = _glb(document)
        rest = old[20 + length :]
        return struct.pack("<4sII", b"glTF", 2, len(head) + len(rest)) + head[12:] + rest

    return change


def _doubling(nodes: list[Any]) -> list[Any]:
    """Nodes each of which has the next one twice."""
    count = 40
    leaf = next(node for node in nodes if "mesh" in node)
    return [*({"children": [k + 1, k + 1]} for k in range(count)), {**leaf, "children": []}]


def _words(rows: int, name: str) -> bytes:
    return ("\n".join([name] * rows) + "\n").encode()


BOMBS: Final[Mapping[str, tuple[str, Callable[[Path], None]]]] = {
    "bag: a view without end": (
        "bag sqlite3",
        _database(
            "ALTER TABLE message_definitions RENAME TO old",
            f"CREATE VIEW message_definitions AS {_ENDLESS} SELECT x AS id, 'a' AS topic_type, 'ros2msg' AS encoding, "
            "'' AS encoded_message_definition, '' AS type_description_hash FROM c",
        ),
    ),
    "bag: a large array in a definition": ("bag sqlite3", _definition("float64[4000000000] data\n")),
    "bag: a type within itself": ("bag sqlite3", _definition("made_up/msg/Thing[] data\n")),
    "bag: code in a definition": (
        "bag sqlite3",
        _definition("float64 data\nstring x=\"');__import__('os').system('touch /tmp/tiago-mj-ran')#\"\n"),
    ),
    "bag: code in a type's name": (
        "bag sqlite3",
        _definition("float64 data\n", "a/msg/B:\n __import__('os').system('touch /tmp/tiago-mj-ran')#"),
    ),
    "bag: many fields": ("bag sqlite3", _definition("".join(f"float64 x{k}\n" for k in range(3000)))),
    "bag: a huge constant": ("bag sqlite3", _idl),
    "bag: a packed chunk": ("bag mcap", _packed_chunk),
    "bag: a packed file": ("bag sqlite3", _packed_file),
    "bag: aliases of aliases": ("bag mcap", _bag_yaml(BOMB + "b: *a9\n")),
    "bag: merges of merges": (
        "bag mcap",
        _bag_yaml(
            "a0: &a0 {x: 1}\n"
            + "".join(f"a{k}: &a{k} {{<<: [{', '.join([f'*a{k - 1}'] * 9)}]}}\n" for k in range(1, 10))
        ),
    ),
    "bag: nested metadata": ("bag mcap", _bag_yaml("x: " + "[" * 100_000 + "\n")),
    "bag: a bomb in a message": (
        "bag mcap",
        lambda folder: (
            seeds.bag("mcap")(folder),
            (folder / "grasp" / "metadata.yaml").write_text(
                BOMB
                + "rosbag2_bagfile_information: {version: 9, relative_file_paths: [grasp.mcap], storage_identifier: "
                "mcap, compression_mode: file, compression_format: *a9}\n"
            ),
        )[0],
    ),
    "hdf5: groups in a circle": ("import minari hdf5", _hdf5(_circle)),
    "hdf5: packed rows": ("import minari hdf5", _hdf5(_packed_rows)),
    "hdf5: a type among the arrays": ("import minari hdf5", _hdf5(_named_type)),
    "hdf5: another's file": ("import minari hdf5", _hdf5(_external)),
    "parquet: repeated text": ("recordings parquet", _columns(note=lambda: _repeated("x" * MILLION))),
    "parquet: many rows": ("recordings parquet", _many_rows),
    "mesh: entities of entities": ("urdf dae", _mesh("dae", change=_with_type(_LAUGHS, "&a9;"))),
    "mesh: an entity that is a file": ("urdf dae", _mesh("dae", change=_with_type(_A_FILE, "&e;"))),
    "mesh: an accessor of gigabytes": (
        "urdf glb",
        _mesh("glb", change=_glb_with(accessors=lambda old: [{**one, "count": 4 * 10**9} for one in old])),
    ),
    "mesh: nodes that double": (
        "urdf glb",
        _mesh("glb", change=_glb_with(nodes=_doubling, scenes=lambda _: [{"nodes": [0]}])),
    ),
    "mesh: a PLY that claims rows": (
        "urdf ply",
        _mesh(
            "ply",
            b"ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nproperty float x\nproperty float y\n"
            b"property float z\nelement face 4000000000\nproperty list uchar int vertex_indices\nend_header\n"
            + bytes(400),
        ),
    ),
    "mesh: an STL that claims rows": ("urdf stl", _mesh("stl", bytes(80) + struct.pack("<I", 2**32 - 1) + bytes(100))),
    "mesh: an OFF that claims rows": ("urdf off", _mesh("off", b"OFF\n4000000000 4000000000 0\n0 0 0\n")),
    "mesh: an OBJ of many faces": ("urdf obj", _mesh("obj", _POINTS + _words(3 * MILLION, "f 1 2 3"))),
    "joints: a path for a name": (
        "import so101 apart",
        _replaced(seeds.so101, "m/joint_list.txt", lambda _: b"../../out\nJaw\n"),
    ),
    "curve: a path for a name": (
        "import ta11-curve",
        _replaced(seeds.ta11, "force.csv", lambda old: old.replace(b"first,", b"../../../first,")),
    ),
}  # fmt: skip
