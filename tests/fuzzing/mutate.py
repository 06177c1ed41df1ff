"""What is done to a valid file: by bytes, by numbers, by cells, by values of its tree, and by its headers.

A mutation takes the file's bytes and a generator of random numbers, and gives other bytes. Those that know a format
give None where the bytes are not (or no longer) of that format.
"""

from __future__ import annotations

import csv
import io
import json
import random
import re
import struct
import warnings
import zipfile
from collections.abc import Callable, Mapping
from typing import Any, Final
from xml.etree import ElementTree as ET

import numpy as np
import yaml
from hostile_files import BOMB, VALUES, mutated

Mutation = Callable[[bytes, random.Random], bytes | None]

#: Written where a number stood.
NUMBERS: Final = (
    "nan", "inf", "-inf", "NaN", "Infinity", "1e999", "-1e999", "1e308", "5e-324", "0", "-0.0", "-1", "1", "2", "1e20",
    "99999999999999999999", "9" * 400, "9" * 5000, "1e-300", "2147483648", "4294967295", "9223372036854775807",
    "18446744073709551615", "1_000", "0x7fffffff", "1,5", "1:30", "", " ", "true", "null", "'1'", "١", "1e", "--1",
)  # fmt: skip
#: Put anywhere into text.
TOKENS: Final = (
    "[", "]", "{", "}", ":", ",", '"', "'", "&a ", "*a", "- ", "\n", "\r", "\t", "\0", "\ufeff", "\u202e", "\x1b[2J",
    "<<: ", "!!python/object/apply:os.system [id]", "? ", "| ", "> ", "---\n", "...\n", "%YAML 1.2\n", "#", "../", "/",
    "/etc/passwd", "~", "${HOME}", "$(id)", "{{7*7}}", "<script>", "__import__('os').system('id')", "é", "\U0001f916",
    "x" * 3000, "null", "nan", "1e999", "-1", "0", ";", "=", "<a>", "</a>", "<!DOCTYPE a>", "<!--", "]]>", "&lt;",
)  # fmt: skip
_NUMBER: Final = re.compile(rb"(?<![\w.])-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
_POWERS: Final = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**64 - 1)


def flipped(data: bytes, rng: random.Random) -> bytes:
    """Some bits or bytes are others."""
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 4, 16))):
        if out:
            at = rng.randrange(len(out))
            out[at] = rng.choice((out[at] ^ 1 << rng.randrange(8), rng.randrange(256), 0, 255, 127, 128))
    return bytes(out)


def cut(data: bytes, rng: random.Random) -> bytes:
    """It ends early, begins late, or a part is gone, there twice, or elsewhere."""
    if not data:
        return data
    a, b = sorted(rng.randrange(len(data) + 1) for _ in range(2))
    part = data[a:b] if rng.random() < 0.5 else data[a : a + rng.randint(1, 16)]
    b = a + len(part)
    kind = rng.randrange(6)
    if kind == 0:
        return data[:a]
    if kind == 1:
        return data[a:]
    if kind == 2:
        return data[:a] + data[b:]
    if kind == 3:
        return data[:b] + part * rng.choice((1, 2, 40)) + data[b:]
    if kind == 4:
        rest = data[:a] + data[b:]
        at = rng.randrange(len(rest) + 1)
        return rest[:at] + part + rest[at:]
    return data[:a] + bytes(len(part)) + data[b:]


def whole_number(data: bytes, rng: random.Random) -> bytes:
    """Some bytes are a length, count or offset that is nearly or far too large."""
    out = bytearray(data)
    for _ in range(rng.randint(1, 3)):
        width = rng.choice((1, 2, 4, 8))
        if len(out) > width:
            at = rng.randrange(len(out) - width)
            value = rng.choice((*_POWERS, len(data), rng.randrange(2**32))) % 2 ** (8 * width)
            out[at : at + width] = value.to_bytes(width, rng.choice(("little", "big")))
    return bytes(out)


def inserted(data: bytes, rng: random.Random) -> bytes:
    """Words of YAML, JSON, XML, shells or Python stand somewhere."""
    for _ in range(rng.randint(1, 4)):
        at = rng.randrange(len(data) + 1)
        data = data[:at] + rng.choice(TOKENS).encode() + data[at + rng.choice((0, 0, 1, 5)) :]
    return data


def numbers(data: bytes, rng: random.Random) -> bytes | None:
    """Some numbers of a text are others."""
    places = list(_NUMBER.finditer(data))
    if not places:
        return None
    for place in sorted(rng.sample(places, min(len(places), rng.choice((1, 1, 2, 5)))), key=lambda p: -p.start()):
        data = data[: place.start()] + rng.choice(NUMBERS).encode() + data[place.end() :]
    return data


def lines(data: bytes, rng: random.Random) -> bytes:
    """Some lines are gone, there again, or elsewhere."""
    listed = data.splitlines(keepends=True)
    for _ in range(rng.randint(1, 3)):
        if listed:
            at = rng.randrange(len(listed))
            kind = rng.randrange(4)
            if kind == 0:
                del listed[at]
            elif kind == 1:
                listed.insert(rng.randrange(len(listed) + 1), listed[at])
            elif kind == 2:
                listed[at] = listed[at] * rng.choice((2, 30))
            else:
                other = rng.randrange(len(listed))
                listed[at], listed[other] = listed[other], listed[at]
    return b"".join(listed)


def json_tree(data: bytes, rng: random.Random) -> bytes | None:
    """Some values of JSON are others, gone, or under other keys."""
    try:
        content = json.loads(data)
    except ValueError:
        return None
    return json.dumps(_changed(content, rng)).encode()


def json_lines(data: bytes, rng: random.Random) -> bytes | None:
    """The same of one line of several that are JSON each."""
    listed = data.splitlines()
    at = rng.randrange(len(listed)) if listed else 0
    changed = json_tree(listed[at], rng) if listed else None
    return None if changed is None else b"\n".join([*listed[:at], changed, *listed[at + 1 :]])


def yaml_tree(data: bytes, rng: random.Random) -> bytes | None:
    """The same of YAML; sometimes anchors, merges and bombs stand beside or in it."""
    if b"*" in data:  # aliases, which may be a bomb by now
        return None
    try:
        content = yaml.load(data, Loader=yaml.CSafeLoader)
        text = yaml.dump(_changed(json.loads(json.dumps(content)), rng), Dumper=yaml.CSafeDumper, width=1e9).encode()
    except (yaml.YAMLError, ValueError, TypeError):
        return None
    if rng.random() < 0.1:
        last = text.rstrip(b"\n").rpartition(b"\n")[2].partition(b":")[0] or b"x"
        text = BOMB.encode() + (text if rng.random() < 0.3 else last + b": *a9\n" + text)
    return text


def _changed(content: Any, rng: random.Random) -> Any:
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        if not isinstance(content, (dict, list)) or not content:
            return rng.choice(VALUES)
        content = mutated(content, rng)
    return content


def cells(data: bytes, rng: random.Random) -> bytes | None:
    """Cells, columns, rows or the header of a CSV are others."""
    try:
        text = data.decode()
        rows = list(csv.reader(io.StringIO(text), delimiter=";" if ";" in text.partition("\n")[0] else ","))
    except (ValueError, csv.Error):
        return None
    if len(rows) < 2 or not rows[0]:
        return None
    row, column = rng.randrange(len(rows)), rng.randrange(len(rows[0]))
    kind = rng.randrange(8)
    value = rng.choice((*NUMBERS, *TOKENS))
    if kind < 3:
        rows[row] = [*rows[row], ""]
        rows[row][min(column, len(rows[row]) - 1)] = value
        rows[row].pop()
    elif kind == 3:
        rows = [[*cell[:column], *cell[column + 1 :]] for cell in rows]
    elif kind == 4:
        rows = [[*cell, cell[min(column, len(cell) - 1)] if cell else ""] for cell in rows]
    elif kind == 5:
        rows = [rows[0], *[[*cell[:column], value, *cell[column + 1 :]] for cell in rows[1:]]]
    elif kind == 6:
        rows[0][column] = rng.choice((value, "time", "command.", "position.x.y", "force.right", rows[0][0]))
    else:
        rows = rows[: rng.randrange(len(rows))] or rows[:1]
    out = io.StringIO()
    csv.writer(out, delimiter=rng.choice(",,,;\t"), lineterminator=rng.choice(("\n", "\n", "\r\n"))).writerows(rows)
    return out.getvalue().encode("utf-8", "surrogatepass")


#: Elements that ask MuJoCo, or a converter, for more than a robot.
_ELEMENTS: Final = (
    '<replicate count="1000" offset="1 0 0"><body><joint/><geom size=".1"/></body></replicate>',
    '<replicate count="-1"><body/></replicate>',
    '<include file="model.xml"/>', '<include file="/etc/passwd"/>', '<include file=""/>',
    '<body><freejoint/><geom size="nan"/></body>', '<body><joint/><geom size="1e300"/></body>', "<body/>",
    '<geom type="mesh" mesh="none"/>', '<site name="x"/>', '<flexcomp name="f" type="grid" count="1 1 1"/>',
    '<composite type="cable" count="9 1 1" size="1"/>', '<size memory="1T"/>', '<size memory="1"/>',
    '<option timestep="nan"/>', '<option timestep="1e9" gravity="nan 0 0" integrator="RK4"/>',
    '<compiler angle="none"/>', '<compiler meshdir="/"/>', '<compiler strippath="true" eulerseq="zzz"/>',
    '<default class="a"><default class="a"/></default>', '<plugin plugin="mujoco.pid"/>',
    '<extension><plugin plugin="x"/></extension>', '<joint type="ball" range="1 0"/>', "<a>" * 300 + "</a>" * 300,
    '<link name="l"><inertial><mass value="-1"/></inertial></link>', '<link name=""/>',
    '<joint name="j" type="revolute"><parent link="base"/><child link="base"/></joint>', "<mimic/>",
    '<mesh filename="package://../../etc/passwd"/>', '<mesh filename="http://127.0.0.1:9/x.stl"/>', "<box/>",
    '<texture type="2d" builtin="checker" width="4000" height="4000" name="t"/>',
    "<keyframe><key qpos='1'/></keyframe>",
)  # fmt: skip
_ATTRIBUTES: Final = (*NUMBERS, "1 2", "0 0 0", "1 1 1 1 1 1 1 1", "x" * 2000, "\u202e", "../../x", "/dev/zero", "a b")


def elements(data: bytes, rng: random.Random) -> bytes | None:
    """Elements or attributes of XML are others, gone, there again, elsewhere, or never heard of."""
    try:
        root = ET.fromstring(data)
    except (ET.ParseError, ValueError, LookupError):
        return None
    for _ in range(rng.choice((1, 1, 2, 4))):
        parents = [one for one in root.iter() if len(one)] or [root]
        parent, anywhere = rng.choice(parents), rng.choice(list(root.iter()))
        child = rng.choice(list(parent)) if len(parent) else anywhere
        kind = rng.randrange(8)
        if kind <= 2 and anywhere.attrib:
            anywhere.set(rng.choice(list(anywhere.attrib)), rng.choice(_ATTRIBUTES).replace("\0", ""))
        elif kind == 3 and anywhere.attrib:
            anywhere.attrib.pop(rng.choice(list(anywhere.attrib)))
        elif kind == 4 and child in list(parent):
            parent.remove(child)
        elif kind == 5:
            copies = rng.choice((1, 1, 3))
            if sum(1 for _ in root.iter()) < 2000:
                parent.extend([ET.fromstring(ET.tostring(child)) for _ in range(copies)])
        elif kind == 6:
            parent.insert(rng.randrange(len(parent) + 1), ET.fromstring(rng.choice(_ELEMENTS)))
        else:
            anywhere.tag = rng.choice([one.tag for one in root.iter()])
    try:
        return ET.tostring(root)
    except (ValueError, TypeError):
        return None


_SHAPES: Final = (
    (), (0,), (1,), (-1,), (10**13,), (10**9, 10**9), (2**63,), (1, 1), (2, 2, 2), (3, 0), ("x",), (1.5,), 3, None,
)  # fmt: skip
_KINDS: Final = ("<f4", "<f8", "|O", "<i8", "|b1", "<U10", "<U4000000000", "|V8", "<c16", "<M8[s]", ">f4", "x", [], "")


def array(data: bytes, rng: random.Random) -> bytes:
    """The header of an array in NumPy's format claims something else, or its numbers are others."""
    kind = rng.randrange(4)
    if kind == 0:  # numbers
        try:
            values = np.lib.format.read_array(io.BytesIO(data), allow_pickle=False).copy()
        except (ValueError, EOFError):
            return flipped(data, rng)
        if values.dtype.kind == "f" and values.size:
            with np.errstate(over="ignore"):
                values.flat[rng.randrange(values.size)] = rng.choice(
                    (np.nan, np.inf, -np.inf, 1e300, 1e-300, -1.0, 0.0)
                )
        elif values.dtype.kind == "i" and values.size:
            values.flat[rng.randrange(values.size)] = rng.choice((-1, 0, 2**62, 10**9))
        values = rng.choice((values, values, values, values.reshape(-1), values[..., None], values.reshape(-1)[:0]))
        out = io.BytesIO()
        np.lib.format.write_array(out, np.asarray(values), allow_pickle=False)
        return out.getvalue()
    if kind == 1:
        return rng.choice((flipped, cut))(data, rng)
    text = repr({"descr": rng.choice(_KINDS), "fortran_order": rng.random() < 0.2, "shape": rng.choice(_SHAPES)})
    if kind == 3:
        text = rng.choice((text[:-1], "[" * 300, "{'a': 1}", "__import__('os').system('id')", text + "#", "9" * 5000))
    head = text.encode() + b" " * 7 + b"\n"
    version = rng.choice((b"\x01\x00", b"\x01\x00", b"\x02\x00", b"\x03\x00", b"\x09\x00"))
    length = struct.pack("<H" if version[0] == 1 else "<I", len(head) % 65536)
    return b"\x93NUMPY" + version + length + head + data[-64:]


def zipped(inner: Mapping[str, Mutation], stored: bool) -> Mutation:
    """A part of an archive is another, gone, or there twice; by the part's suffix."""

    def change(data: bytes, rng: random.Random) -> bytes | None:
        try:
            with zipfile.ZipFile(io.BytesIO(data)) as archive:
                parts = [(name, archive.read(name)) for name in archive.namelist()]
        except Exception:  # no archive any more
            return None
        if not parts:
            return None
        at = rng.randrange(len(parts))
        name, content = parts[at]
        kind = rng.randrange(10)
        if kind < 6:
            fit = next((m for suffix, m in inner.items() if name.endswith(suffix)), flipped)
            changed = fit(content, rng)
            parts[at] = (name, flipped(content, rng) if changed is None else changed)
        elif kind == 6:
            del parts[at]
        elif kind == 7:
            parts[at] = (name, parts[rng.randrange(len(parts))][1])
        elif kind == 8:
            parts.append((rng.choice((name, "../x.npy", "/etc/x.npy", "x/", "x" * 300, "weight_9.npy")), content))
        else:
            parts[at] = (rng.choice(("x.npy", "header.npy", "mean.npy", "bias_0.npy", "state.json")), content)
        out = io.BytesIO()
        packed = zipfile.ZIP_DEFLATED if not stored or rng.random() < 0.05 else zipfile.ZIP_STORED
        with warnings.catch_warnings(), zipfile.ZipFile(out, "w", packed) as archive:
            warnings.simplefilter("ignore")  # of parts that are there twice
            for part, content in parts:
                archive.writestr(part, content)
        return out.getvalue()

    return change


def zip_headers(data: bytes, rng: random.Random) -> bytes:
    """Sizes, offsets, methods and flags that an archive's directory states are others."""
    out = bytearray(data)
    begins = [found.start() for found in re.finditer(rb"PK(?:\x01\x02|\x03\x04|\x05\x06|\x06\x06|\x06\x07)", data)]
    for _ in range(rng.randint(1, 3)):
        if begins:
            at = min(rng.choice(begins) + rng.randrange(4, 46), len(out) - 1)
            width = rng.choice((1, 2, 4))
            out[at : at + width] = (rng.choice((*_POWERS, 8, 12, 14, 99)) % 256**width).to_bytes(width, "little")
    return bytes(out[: len(data)])


def footer(data: bytes, rng: random.Random) -> bytes:
    """The same of what stands at the end of a Parquet, Arrow or MCAP file, or of what begins a bag."""
    span = min(len(data), rng.choice((64, 600, 4000)))
    begin = rng.choice((len(data) - span, 0))
    part = rng.choice((flipped, whole_number, cut))(data[begin : begin + span], rng)
    return data[:begin] + part + data[begin + span :]


BYTES: Final[Mapping[str, Mutation]] = {"bytes": flipped, "cut": cut, "lengths": whole_number}
WORDS: Final[Mapping[str, Mutation]] = {"words": inserted, "numbers": numbers, "lines": lines}
_NPZ: Final = {"arrays": zipped({".npy": array, ".json": json_tree}, False), "zip headers": zip_headers}
#: By a file's suffix: the mutations that fit it, by name; bytes of any file.
BY_SUFFIX: Final[Mapping[str, Mapping[str, Mutation]]] = {
    ".json": {**WORDS, "tree": json_tree, "tree again": json_tree},
    ".jsonl": {**WORDS, "tree": json_lines},
    ".yaml": {**WORDS, "tree": yaml_tree, "tree again": yaml_tree},
    ".yml": {**WORDS, "tree": yaml_tree},
    ".csv": {**WORDS, "cells": cells, "cells again": cells},
    ".tsv": {**WORDS, "cells": cells},
    ".txt": WORDS,
    ".xml": {**WORDS, "elements": elements, "elements again": elements},
    ".urdf": {**WORDS, "elements": elements, "elements again": elements},
    ".dae": {**WORDS, "elements": elements},
    ".obj": WORDS,
    ".stl": {"headers": footer},
    ".ply": {**WORDS, "headers": footer},
    ".npz": {**_NPZ, "arrays again": _NPZ["arrays"]},
    ".zip": {
        "arrays": zipped({".npy": array, ".json": json_tree, "data": json_tree}, True),
        "zip headers": zip_headers,
    },
    ".parquet": {"headers": footer, "headers again": footer},
    ".arrow": {"headers": footer},
    ".hdf5": {"headers": footer},
    ".bag": {"headers": footer, "words": inserted},
    ".mcap": {"headers": footer, "words": inserted},
    ".db3": {"headers": footer, "words": inserted},
}  # fmt: skip


def mutations(name: str) -> dict[str, Mutation]:
    """Those that fit a file, by its name."""
    suffix = next((s for s in BY_SUFFIX if name.endswith(s)), "")
    return {**BYTES, **BY_SUFFIX.get(suffix, {})}


def changed(name: str, data: bytes, rng: random.Random) -> tuple[str, bytes]:
    """One of them, drawn, and the other bytes; sometimes a second one on top."""
    fitting = mutations(name)
    label = rng.choice(list(fitting))
    out = fitting[label](data, rng)
    if out is None:
        label, out = "bytes", flipped(data, rng)
    if rng.random() < 0.2:
        again = fitting[rng.choice(list(fitting))](out, rng)
        out = out if again is None else again
    return label.removesuffix(" again"), out
