"""ROS 1 bags, ROS 2 bags (sqlite3, MCAP) as tables: every topic fills its own rows, the rest of a row is empty.

Which topic holds what is said by a map file's ``topics``:

    topics:
      /joint_states: {kind: joint_state, joints: [arm_1_joint]}     # sensor_msgs/JointState; all joints without a list
      /gripper/command: {kind: command, names: [finger_joint]}      # numbers: Float64, Float64MultiArray ...
      /ta11: {kind: force, names: [right, left]}
    robot: tiago_mj/TIAGoTactile-v0
    interface: position

Without a map it is the real TIAGo's, :data:`TIAGO_TOPICS`, or, where the bag has none of its commands and forces, what
``ros2_control`` publishes (:mod:`tiago_mj.recordings.read.ros2_control`). A message is stamped by its header where it
has one that agrees with the bag's clock, else by when the bag received it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tiago_mj.io import apart
from tiago_mj.io.extra import load
from tiago_mj.io.loading import load_yaml
from tiago_mj.io.quoting import quoted
from tiago_mj.io.schema import Closed, SchemaError, checked
from tiago_mj.models import names
from tiago_mj.recordings.read import ros2_control
from tiago_mj.recordings.read.tables import Table, check_names, check_size
from tiago_mj.recordings.recording import KINDS, Array, Finding, RecordingError
from tiago_mj.recordings.usable import check_values

#: The real TIAGo with TA11 load cells: finger commands are positions, readings come right before left.
TIAGO_TOPICS: Final[Mapping[str, Mapping[str, Any]]] = {
    "/joint_states": {"kind": "joint_state", "joints": list(names.TIAGO_JOINTS)},
    "/finger_right_controller/command": {"kind": "command", "names": [names.FINGERS[0]], "optional": True},
    "/finger_left_controller/command": {"kind": "command", "names": [names.FINGERS[1]], "optional": True},
    "/ta11": {"kind": "force", "names": list(names.SIDES), "optional": True},
}
TIAGO_FACTS: Final[Mapping[str, Any]] = {"robot": "tiago_ta11", "interface": "position"}
#: A header's stamp that is farther from the bag's clock [s] is of another clock.
SAME_CLOCK: Final = 1.0
#: Of topics that are not of a map file: a controller's state, and numbers whose joints are not named.
_REFERENCE, _NUMBERS = "reference", "numbers"
_STATES: Final = "/joint_states"
_AGAIN: Final = "it was cut off or is of another format; copy it again"
#: A bag may take so long, and so long more for every byte [s, bytes/s]; 10 MB/s is what a bag of states takes.
SECONDS, PER_SECOND = 10.0, 500_000.0
#: And so much memory, and so much more for every byte [MB, times]: bags are packed, and Python's numbers are large.
MEGABYTES, PER_BYTE = 350.0, 40.0
_APART: Final = apart.Reader("tiago_mj.recordings.read.bags", "read_streams")
Streams = dict[str, tuple[NDArray[np.int64], Array]]
_JOINT_STATE: Final = (("position", "position"), ("velocity", "velocity"), ("effort", "effort"))


class _Entry(Closed):
    kind: str = Field(description=f"use joint_state, {', '.join(KINDS)}")
    names: str | list[str] = Field(default=[], description="write a list of names")
    joints: str | list[str] = Field(default=[], description="write a list of names")
    optional: bool = Field(default=False, description="write true or false")
    stamp: Literal["header", "bag"] = Field(default="header", description="write header or bag")


@dataclass(frozen=True)
class Topic:
    """Channels that the numbers of a topic become.

    Attributes:
        name: of the topic.
        kind: ``joint_state``, or the kind of the channels.
        names: of the channels, in the order of the message's numbers; of a joint state, the joints that are read,
            empty for all.
        optional: whether a bag may lack it.
        stamp: ``header`` or ``bag``: whose time counts.
    """

    name: str
    kind: str
    names: tuple[str, ...]
    optional: bool = False
    stamp: str = "header"


def read_bag(path: Path, content: Mapping[str, Any], sidecar: Mapping[str, Any], sidecar_file: str) -> Table:
    """A bag as a table, with time in seconds from its first message.

    Args:
        path: a ``.bag``, ``.mcap`` or ``.db3`` file, or the folder of a ROS 2 bag.
        content: of the map file; without ``topics``, what the bag's own topics are is found out, and told.
        sidecar: its mapping.
        sidecar_file: its name.

    Raises:
        RecordingError: the bag is cut off, lacks a topic, or holds messages of another kind.
        ModuleNotFoundError: rosbags is not installed; says how to.
    """
    if "topics" in content:
        topic_map(content["topics"])  # complains of what it cannot use
    load("rosbags.highlevel", "reading ROS bags")
    size = (
        sum(file.stat().st_size for file in path.iterdir() if file.is_file()) if path.is_dir() else path.stat().st_size
    )
    asked = {"path": str(path), "topics": content.get("topics")}
    try:
        said, arrays = _APART(asked, seconds=SECONDS + size / PER_SECOND, megabytes=MEGABYTES + size / 1e6 * PER_BYTE)
    except apart.RefusedError as fault:
        raise RecordingError(str(fault)) from None
    except (TimeoutError, MemoryError) as fault:
        reason = str(fault) or f"it takes more memory than a bag of {size / 1e6:.1f} MB has any need of"
        raise RecordingError(f"{path.name}: not a ROS bag that can be read ({reason}): {_AGAIN}") from None
    streams: Streams = {name: (arrays[f"{k}.stamps"], arrays[f"{k}.values"]) for k, name in enumerate(said["names"])}
    findings = [Finding(**finding) for finding in said["findings"]]
    facts = {**said["facts"], "source": {"bag": path.name}}  # who named its joints: the robot
    if not streams:
        raise RecordingError(f"{path.name}: the recording is empty, its topics hold no message: record again")
    stamps = np.unique(np.concatenate([stream for stream, _ in streams.values()]))
    columns: dict[str, Array] = {"time": (stamps - stamps[0]) * 1e-9}
    for name, (stream, values) in streams.items():
        column = np.full(len(stamps), np.nan)
        column[np.searchsorted(stamps, stream)] = values
        columns[name] = column
    check_size(path.name, len(stamps), len(columns))
    check_names(path.name, list(columns))
    return Table(columns, path.name, sidecar, sidecar_file, {}, findings=tuple(findings), facts=facts)


def read_streams(path: str, topics: Any) -> apart.Answer:
    """Contents of a bag, as :mod:`tiago_mj.io.apart` passes them between processes.

    Args:
        path: of the bag.
        topics: of the map file; None: there is none.

    Raises:
        RecordingError: one line.
    """
    file = Path(path)
    try:
        if file.is_dir():  # rosbags reads it, too, and without bounds
            load_yaml(file / "metadata.yaml", "metadata.yaml is no YAML", error=RecordingError)
        streams, findings, facts = _read(file, None if topics is None else topic_map(topics))
    except (RecordingError, ModuleNotFoundError, MemoryError):
        raise
    except Exception as fault:  # rosbags, sqlite3, struct, lz4 ...: each has its own errors for a broken file
        reason = " ".join(str(fault).split())[:160] or type(fault).__name__
        raise RecordingError(f"{file.name}: not a whole ROS bag ({reason}): {_AGAIN}") from fault
    said = {"names": list(streams), "findings": [asdict(finding) for finding in findings], "facts": dict(facts)}
    arrays = {
        f"{k}.{part}": values
        for k, pair in enumerate(streams.values())
        for part, values in zip(("stamps", "values"), pair, strict=True)
    }
    return said, arrays


def topic_map(section: Any) -> tuple[Topic, ...]:
    """Topics from the ``topics`` of a map file.

    Raises:
        RecordingError: an entry is unusable; names it.
    """
    if not isinstance(section, Mapping) or not section:
        raise RecordingError("map file: 'topics' is no mapping: write '/joint_states: {kind: joint_state}'")
    found = []
    for name, entry in section.items():
        where = f"map file: topic {quoted(name)}"
        try:
            said = checked(_Entry, entry, "write {kind: KIND, names: [NAME]}")
        except SchemaError as fault:
            raise RecordingError(f"{where}{': ' if fault.path else ' '}{fault}") from fault
        kind = said.kind
        if kind != "joint_state" and kind not in KINDS:
            raise RecordingError(f"{where}: kind {quoted(kind)} is unknown: use joint_state, {', '.join(KINDS)}")
        listed = said.joints if kind == "joint_state" else said.names
        listed = [listed] if isinstance(listed, str) else listed
        if kind != "joint_state" and not listed:
            raise RecordingError(f"{where}: names is missing: name each of the message's numbers")
        found.append(Topic(str(name), kind, tuple(listed), said.optional, said.stamp))
    return tuple(found)


def _read(path: Path, topics: Sequence[Topic] | None) -> tuple[Streams, list[Finding], Mapping[str, Any]]:
    """Streams, findings, and defaults for sidecars; without topics, of those that the bag is found to hold."""
    highlevel: Any = load("rosbags.highlevel", "reading ROS bags")
    typesys: Any = load("rosbags.typesys", "reading ROS bags")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)  # for ROS 2 bags that do not hold their own types
    streams: Streams = {}
    findings: list[Finding] = []
    facts: Mapping[str, Any] = {}
    of_map = topics is not None
    with highlevel.AnyReader([path], default_typestore=store) as reader:
        there = {connection.topic: connection.msgtype for connection in reader.connections}
        check_size(path.name, reader.message_count, 1)
        if topics is None:
            own = any(name in there for name in TIAGO_TOPICS if name != _STATES)
            driven = None if own else ros2_control.topics(there, reader.typestore.fielddefs, path.name)
            if driven is not None:
                return _driven(path.name, reader, driven)
            topics, facts = topic_map(TIAGO_TOPICS), TIAGO_FACTS
        missing = [topic.name for topic in topics if topic.name not in there and not topic.optional]
        if missing:
            raise RecordingError(
                f"{path.name}: topic {missing[0]} is missing, the bag has {', '.join(sorted(there)) or 'none'}: "
                "record it, or name the topics in a map file (--map)"
            )
        for topic in topics:
            if topic.name in there:
                findings += _stream(path.name, topic, _of(reader, topic.name), streams)
                if of_map and topic.kind == "joint_state":
                    _check_joints(path.name, topic, streams)
    return streams, findings, facts


def _check_joints(file: str, topic: Topic, streams: Streams) -> None:
    """Refuse a joint that a map file names and the messages do not."""
    there = dict.fromkeys(name.partition(".")[2] for name in streams)
    for joint in () if topic.optional else topic.names:
        if joint not in there:
            raise RecordingError(
                f"{file}: topic {topic.name} has no joint {quoted(joint)}, which the map file names: mend or delete it"
            )


def _driven(file: str, reader: Any, topics: ros2_control.Topics) -> tuple[Streams, list[Finding], Mapping[str, Any]]:
    """States and commands of a robot driven by ``ros2_control``."""
    states: Streams = {}
    findings = _stream(file, Topic(topics.states, "joint_state", ()), _of(reader, topics.states), states)
    sent: Streams = {}
    said: dict[str, str] = {}
    interfaces: dict[str, str] = {}

    def add(topic: str, joint: str, stream: tuple[NDArray[np.int64], Array], interface: str) -> None:
        if f"command.{joint}" not in sent:
            sent[f"command.{joint}"] = stream
            said[topic] = f"{said[topic]}, {joint}" if topic in said else f"{interface} commands of {joint}"
            interfaces[topic] = interface

    for topic in topics.references:
        found: Streams = {}
        findings += _stream(file, Topic(topic, _REFERENCE, ()), _of(reader, topic), found)
        for name, stream in found.items():
            add(topic, name.partition(".")[2], stream, "position")
    for topic in topics.numbers:
        found = {}
        findings += _stream(file, Topic(topic, _NUMBERS, ()), _of(reader, topic), found)
        kind = ros2_control.interface_of(topic)
        if found:
            joints = ros2_control.followers(file, topic, list(found.values()), states, kind)
            for joint, stream in zip(joints, found.values(), strict=True):
                add(topic, joint, stream, kind)
    for topic in topics.trajectories:
        parts: dict[str, list[ros2_control.Piece]] = {}
        for received, message in _of(reader, topic):
            header = _header(message)
            header = header if abs(header - received) * 1e-9 < SAME_CLOCK else 0
            for joint, piece in ros2_control.pieces(file, topic, received, header, message).items():
                parts.setdefault(joint, []).append(piece)
        for joint, pieces in parts.items():
            if f"position.{joint}" in states:
                add(topic, joint, ros2_control.sampled(pieces, *states[f"position.{joint}"]), "position")
    if len(set(interfaces.values())) > 1:
        raise RecordingError(
            f"{file}: its commands are {' and '.join(f'{kind}s on {topic}' for topic, kind in interfaces.items())}: a "
            "recording holds one kind; name the topics that count in a map file (--map)"
        )
    findings.append(ros2_control.told(file, said, topics.states, topics.skipped))
    return {**states, **sent}, findings, {"interface": next(iter(interfaces.values()), None)}


def _of(reader: Any, topic: str) -> Iterator[tuple[int, Any]]:
    """Messages of one topic."""
    return _messages(reader, [connection for connection in reader.connections if connection.topic == topic])


def _messages(reader: Any, connections: Sequence[Any]) -> Iterator[tuple[int, Any]]:
    """When the bag received each message [ns], and the message."""
    for connection, received, raw in reader.messages(connections=connections):
        yield int(received), reader.deserialize(raw, connection.msgtype)


def _stream(file: str, topic: Topic, messages: Iterator[tuple[int, Any]], streams: Streams) -> list[Finding]:
    """Add the channels of a topic to the streams."""
    received, headers = [], []
    rows: dict[str, list[float]] = {}
    for count, (when, message) in enumerate(messages):
        received.append(when)
        headers.append(_header(message))
        for name, value in _numbers(file, topic, message).items():
            rows.setdefault(name, [np.nan] * count).append(value)
        for values in rows.values():
            values.extend([np.nan] * (count + 1 - len(values)))
    if not received:
        return []
    findings = []
    stamps = np.array(received, dtype=np.int64)
    if topic.stamp == "header" and all(headers):
        own = np.array(headers, dtype=np.int64)
        apart = float(np.median(np.abs(own - stamps))) * 1e-9
        if apart < SAME_CLOCK:
            stamps = own
        else:
            findings.append(
                Finding(
                    "time_origin",
                    file,
                    topic.name,
                    f"its headers are {apart:.3g} s from the bag's clock; stamped by when it was received",
                    repaired=True,
                )
            )
    order = np.argsort(stamps, kind="stable")
    last = np.append(np.diff(stamps[order]) > 0, True)
    if not last.all():
        findings.append(
            Finding(
                "time_not_monotonic",
                file,
                topic.name,
                f"{int((~last).sum())} of {len(stamps)} messages repeat a stamp; the last of each is used",
                repaired=True,
            )
        )
    keep = order[last]
    for name, values in rows.items():
        column = np.array(values)[keep]
        check_values(column, f"{name} of topic {topic.name}", file)
        there = ~np.isnan(column)
        if there.any():
            streams[name] = (stamps[keep][there], column[there])
    return findings


def _header(message: Any) -> int:
    """Stamp of the header [ns]; 0 where there is none."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    return 0 if stamp is None else int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def _numbers(file: str, topic: Topic, message: Any) -> dict[str, float]:
    """A message's numbers by column."""
    if topic.kind == "joint_state":
        return _joint_state(file, topic, message)
    if topic.kind == _REFERENCE:
        found = ros2_control.reference(file, topic.name, message)
        return {f"command.{joint}": value for joint, value in found.items()}
    data = getattr(message, "data", None)
    if data is None or isinstance(data, (str, bytes)):
        raise RecordingError(
            f"{file}: topic {topic.name} holds {type(message).__name__}, not numbers: use a topic with Float64 or "
            "Float64MultiArray"
        )
    values = np.atleast_1d(np.asarray(data, dtype=np.float64))
    if topic.kind == _NUMBERS:
        return {f"command.{k}": float(value) for k, value in enumerate(values)}
    if len(values) != len(topic.names):
        raise RecordingError(
            f"{file}: topic {topic.name} has {len(values)} numbers, the map names {len(topic.names)}: name each"
        )
    return {f"{topic.kind}.{name}": float(value) for name, value in zip(topic.names, values, strict=True)}


def _joint_state(file: str, topic: Topic, message: Any) -> dict[str, float]:
    if not hasattr(message, "name") or not hasattr(message, "position"):
        raise RecordingError(
            f"{file}: topic {topic.name} holds {type(message).__name__}, not a JointState: mend its kind"
        )
    wanted = topic.names or tuple(message.name)
    index = {name: k for k, name in enumerate(message.name)}
    found = {}
    for name in wanted:
        for kind, part in _JOINT_STATE:
            values = getattr(message, part)
            if name in index and index[name] < len(values):  # a part that is not measured is an empty list
                found[f"{kind}.{name}"] = float(values[index[name]])
    return found
