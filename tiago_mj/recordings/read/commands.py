"""Commands in the form that the model takes: named by actuator, of a known interface."""

from __future__ import annotations

from collections.abc import Mapping

from tiago_mj.io.quoting import quoted
from tiago_mj.recordings.recording import Array, Finding, RecordingError
from tiago_mj.recordings.robot import Robot


def by_actuator(commands: Mapping[str, Array], robot: Robot, file: str) -> tuple[dict[str, Array], list[Finding]]:
    """Commands named by joint, renamed to the only actuator of that joint.

    Args:
        commands: by the names of their columns, (T,) each.
        robot: whose actuators they are of; an actuator's own name counts more than a joint's.
        file: for messages.

    Returns:
        Commands by actuator, and what was taken for what. A name that is neither stays as it is.

    Raises:
        RecordingError: several actuators drive that joint, or its actuator has a column of its own, too.
    """
    named: dict[str, Array] = {}
    findings: list[Finding] = []
    for name, sent in commands.items():
        drives = robot.drives(name)
        if name in robot.actuators or not drives:
            named[name] = sent
            continue
        if len(drives) > 1:
            raise RecordingError(
                f"{file}: column command.{name}: the joint {quoted(name)} is driven by {', '.join(drives)}: name the "
                "column after one of them, or map it (--map)"
            )
        (actuator,) = drives
        if actuator in commands:
            raise RecordingError(
                f"{file}: columns command.{actuator} and command.{name} both are of the actuator {quoted(actuator)}, "
                "which drives that joint: map one to null (--map)"
            )
        named[actuator] = sent
        message = f"it is named by a joint; taken for the command of its actuator {actuator!r}"
        findings.append(Finding("missing_column", file, f"command.{name}", message, repaired=True))
    return named, findings


def interface_of_model(commands: Mapping[str, Array], robot: Robot, file: str) -> tuple[str, Finding] | None:
    """Interface of the commands from the actuators of the model, and a finding on it; None where these do not tell.

    Raises:
        RecordingError: the actuators take commands of several kinds.
    """
    takes = {name: robot.interfaces[name][0] for name in commands if robot.interfaces.get(name)}
    if not takes:
        return None
    kinds = {kind: name for name, kind in takes.items()}
    if len(kinds) > 1:
        listed = ", ".join(f"{name} {kind}" for kind, name in kinds.items())
        raise RecordingError(
            f"{file}: what its commands are is unknown, and the model's actuators take several kinds ({listed}): write "
            '"interface" into the sidecar or the map file'
        )
    (kind,) = kinds
    message = f"nothing says what its commands are; read as what the model's actuators take: {kind}"
    return kind, Finding("missing_column", file, "", message, repaired=True)
