"""Compiling an MJCF that somebody else wrote, within bounds of memory and time.

A line of MJCF can ask for a billion bodies (``<replicate>`` within ``<replicate>``) or a texture of gigabytes, and
MuJoCo compiles what it is asked for. So the file, and those that it includes, are counted before. What meshes, pictures
and other files ask for shows only when they are compiled: this is tried before in a process that is bounded.
"""

from __future__ import annotations

import math
import re
import time
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NoReturn
from xml.parsers import expat

import mujoco

from tiago_mj.io import apart, mujoco_log
from tiago_mj.io.quoting import one_line, quoted
from tiago_mj.models.files import refuse_urdf

#: Bodies of a model, copies counted, and copies of anything: MuJoCo takes 0.2 s to compile as many; robots have 100.
BODIES: Final = 1000
#: Elements of all files together, copies counted: 0.5 s.
ELEMENTS: Final = 10_000
#: Of all files together, meshes and pictures apart [bytes].
BYTES: Final = 16_000_000
FILES: Final = 100
#: Elements within each other; MuJoCo reads 500, a chain of 50 joints has as many.
DEPTH: Final = 200
#: Numbers that an attribute makes MuJoCo allocate, as for a texture of 4096 × 4096.
CELLS: Final = 4096 * 4096
#: Of ``<size>``: MuJoCo keeps numbers for the user with every element, and states with every key.
USER: Final = 100
KEYS: Final = 10_000
#: Physics steps are no shorter [s], and take no more iterations of a solver.
TIMESTEP: Final = 1e-5
ITERATIONS: Final = 10_000
#: Of the simulation's state and constraints: TIAGo takes 14 MB, 5000 equalities between joints some gigabytes [bytes].
ARENA: Final = 1_000_000_000
#: Compiling with other files, or more XML than MAX_PLAIN [bytes], may take so long [s] and so much address space [MB].
SECONDS: Final = 15.0
MEGABYTES: Final = 1000.0
MAX_PLAIN: Final = 1_000_000
#: A second of simulation takes no more seconds of a processor; TIAGo takes 0.01.
SLOWEST: Final = 2.0
_COPIES: Final = ("replicate", "composite", "flexcomp")
#: Attributes that name another file, but for those that are counted here.
_FILES: Final = ("file", "fileright", "fileleft", "fileup", "filedown", "filefront", "fileback")
#: Attributes whose product is allocated, by element.
_SIZES: Final[Mapping[str, tuple[str, ...]]] = {
    "texture": ("width", "height"),
    "hfield": ("nrow", "ncol"),
    "numeric": ("size",),
    "user": ("dim",),
    "tactile": ("nsample",),
}


def load_model(path: Path, lead: str, error: type[ValueError] = ValueError) -> mujoco.MjModel:
    """Compile an MJCF file.

    Args:
        path: of the file.
        lead: how a complaint begins, such as ``model arm.xml``.
        error: that is raised.

    Raises:
        error: there is no such file, it is a URDF, it is larger than this module's bounds, or MuJoCo cannot compile it;
            one line.
    """
    try:
        refuse_urdf(path)
    except ValueError as fault:
        raise error(str(fault)) from fault
    counter = _Counter(path.parent)
    try:
        counter.file(path, 1, ())
        if counter.others or counter.bytes > MAX_PLAIN:
            _try_apart(path)
        model = mujoco.MjModel.from_xml_path(str(path))
        _check_options(model)
    # RuntimeError: "Caught an unknown exception!", of a library of MuJoCo's that is out of memory
    except (ValueError, OSError, RuntimeError, mujoco.FatalError, MemoryError) as fault:
        raise error(f"{lead}: {one_line(fault) or 'it takes more memory than there is'}") from fault
    return model


def with_movable_masses(path: Path) -> mujoco.MjModel:
    """The model of a file whose bodies' centres of mass may be moved: none is compiled as ``simple``, of which MuJoCo
    has to know that its centre stays where its joints are (manual, ``body/simple``). The file was compiled before
    (:func:`load_model`)."""
    spec = mujoco.MjSpec.from_file(str(path))
    for body in spec.bodies:
        body.simple = 0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what MuJoCo warns of, it warned of when the file was loaded
        return spec.compile()


def check_speed(model: mujoco.MjModel, lead: str, error: type[ValueError] = ValueError) -> None:
    """Refuse a model that is too slow to simulate, measured over a few steps from its initial state.

    Args:
        model, lead, error: as of :func:`load_model`.

    Raises:
        error: a simulated second takes more than :data:`SLOWEST` seconds of a processor, or there is no memory for it.
    """
    try:
        with mujoco_log.counted():  # what MuJoCo warns of, it warns of again in the simulation
            data = mujoco.MjData(model)
            begin, steps = time.process_time(), 0
            while steps < 50 and time.process_time() - begin < 1:
                mujoco.mj_step(model, data)
                steps += 1
    except (mujoco.FatalError, MemoryError) as fault:
        raise error(f"{lead}: {one_line(fault) or 'it takes more memory than there is'}") from fault
    took = (time.process_time() - begin) / steps / model.opt.timestep
    if took > SLOWEST:
        raise error(
            f"{lead}: a second of simulation takes {took:.3g} s of a processor: leave out what does not move the "
            "robot, or give a larger timestep"
        )


def compiled(path: str) -> apart.Answer:
    """Compile a model and discard it, to find out whether that succeeds and ends.

    Raises:
        ValueError: MuJoCo cannot compile it.
    """
    mujoco.MjModel.from_xml_path(path)
    return None, {}


_APART: Final = apart.Reader(__name__, compiled.__name__)


def _try_apart(path: Path) -> None:
    mend = "give simpler meshes and smaller pictures"
    try:
        _APART({"path": str(path.absolute())}, seconds=SECONDS, megabytes=MEGABYTES)
    except TimeoutError as fault:
        raise ValueError(f"it takes more than {SECONDS:.0f} s to compile: {mend}") from fault
    except MemoryError as fault:
        raise ValueError(f"it takes more than {MEGABYTES:.0f} MB to compile: {mend}") from fault


def _check_options(model: mujoco.MjModel) -> None:
    if not model.opt.timestep >= TIMESTEP:
        raise ValueError(f"option timestep is {model.opt.timestep:g} s: give {TIMESTEP:g} s or more")
    if model.narena > ARENA:
        raise ValueError(
            f"its simulation takes {model.narena // 1_000_000} MB of memory: give {ARENA // 1_000_000} MB or less by "
            "<size memory>, or fewer bodies and constraints"
        )
    for name in ("iterations", "ls_iterations", "noslip_iterations", "ccd_iterations", "sdf_iterations"):
        if getattr(model.opt, name) > ITERATIONS:
            raise ValueError(f"option {name} is {getattr(model.opt, name)}: give {ITERATIONS} or fewer")


class _Counter:
    """Number of elements of a model, with replicated copies."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.bodies = self.elements = self.bytes = self.files = 0
        self.others = False  # whether it names meshes, pictures or the like

    def file(self, path: Path, copies: int, within: tuple[Path, ...]) -> None:
        """Count a file, and those that it includes or attaches."""
        self.files += 1
        if path in within or self.files > FILES:
            raise ValueError(f"{path.name} is included within itself, or there are more than {FILES} files")
        try:
            with path.open("rb") as file:
                content = file.read(BYTES + 1)
        except OSError as fault:
            raise ValueError(f"{path.name} cannot be read ({(fault.strerror or str(fault)).lower()})") from fault
        self.bytes += len(content)
        if self.bytes > BYTES:
            raise ValueError(f"{path.name}: more than {BYTES // 1_000_000} MB of XML")
        _File(self, path, copies, within).parse(content)


class _File:
    """Elements of one file, counted as they are parsed."""

    def __init__(self, total: _Counter, path: Path, copies: int, within: tuple[Path, ...]) -> None:
        self.total, self.path, self.within = total, path, (*within, path)
        self.copies = [copies]
        self.models: dict[str, str] = {}
        self.parser = expat.ParserCreate()
        self.parser.StartElementHandler = self.start
        self.parser.EndElementHandler = self.end
        self.parser.StartDoctypeDeclHandler = lambda *_: self.wrong("declares a document type: remove it")

    def parse(self, content: bytes) -> None:
        try:
            self.parser.Parse(content, True)
        except expat.ExpatError as fault:
            raise ValueError(f"{self.path.name}:{fault.lineno}: {expat.ErrorString(fault.code)}") from fault
        except LookupError as fault:
            raise ValueError(f"{self.path.name}: of an unknown encoding: save it as UTF-8") from fault

    def wrong(self, what: str) -> NoReturn:
        raise ValueError(f"{self.path.name}:{self.parser.CurrentLineNumber}: {what}")

    def start(self, tag: str, given: dict[str, str]) -> None:
        copies = self.copies[-1]
        if len(self.copies) > DEPTH:
            self.wrong(f"elements are nested more than {DEPTH} deep")
        self.total.elements += copies
        if tag in _COPIES:
            copies *= int(math.prod(max(one, 1) for one in self.numbers(tag, given, "count")))
            self.total.elements += copies
            if copies > BODIES:
                self.wrong(f"<{tag}> makes more than {BODIES} copies: write fewer")
        self.copies.append(copies)
        self.total.bodies += copies * (tag == "body")
        if self.total.bodies > BODIES:
            self.wrong(f"more than {BODIES} bodies: leave out what does not move the robot")
        if self.total.elements > ELEMENTS:
            self.wrong(f"more than {ELEMENTS} elements: leave out what does not move the robot")
        self.total.others |= tag != "include" and any(name in given for name in _FILES)
        self.sizes(tag, given)
        self.others(tag, given, copies)

    def end(self, tag: str) -> None:
        self.copies.pop()

    def sizes(self, tag: str, given: dict[str, str]) -> None:
        """Refuse element sizes for which MuJoCo would allocate too much memory."""
        if math.prod(max(one, 1) for name in _SIZES.get(tag, ()) for one in self.numbers(tag, given, name)) > CELLS:
            self.wrong(f"<{tag}> is of more than {CELLS} numbers: make it smaller")
        for name in given if tag == "size" else ():
            most: float = USER if name.startswith("nuser_") else KEYS if name in ("nkey", "nuserdata") else CELLS
            if name == "memory":
                self.memory(given[name])
            elif any(one > most for one in self.numbers(tag, given, name)):
                self.wrong(f"{name} of <size> is {quoted(given[name])}: give {most} or less")
        if "nsample" in given and any(one > ELEMENTS for one in self.numbers(tag, given, "nsample")):
            self.wrong(f"nsample of <{tag}> is {quoted(given['nsample'])}: give {ELEMENTS} or less")

    def memory(self, text: str) -> None:
        """Refuse a size such as ``2G`` above :data:`ARENA`; a malformed one is left to MuJoCo to report."""
        found = re.fullmatch(r"\s*(\d{1,18})([KMGTPE]?)\s*", text, re.IGNORECASE)
        if found and int(found[1]) * 1024 ** " KMGTPE".index(found[2].upper() or " ") > ARENA:
            self.wrong(f"memory of <size> is {quoted(text)}: give {ARENA // 1_000_000} MB or less")

    def others(self, tag: str, given: dict[str, str], copies: int) -> None:
        """Count the files that this file includes or attaches."""
        if tag == "include":
            self.count(given.get("file", ""), copies)
        elif tag == "model" and "file" in given:
            self.models[given.get("name", Path(given["file"]).stem)] = given["file"]
        elif tag == "attach" and (file := self.models.get(given.get("model", ""))) is not None:
            self.count(file, copies)

    def count(self, name: str, copies: int) -> None:
        """Count an included file where it exists; a missing one is left to MuJoCo to report."""
        near = [folder / name for folder in (self.path.parent, self.total.folder)]
        found = next((path for path in near if path.exists()), None)
        if found is None:
            return
        if not found.is_file():
            self.wrong(f"{quoted(name)} is no file: name one")
        self.total.file(found.resolve(), copies, self.within)

    def numbers(self, tag: str, given: dict[str, Any], name: str) -> list[float]:
        """Numbers of an attribute; none where it is not there."""
        try:
            values = [float(word) for word in given.get(name, "").split()]
        except ValueError:
            self.wrong(f"{name} of <{tag}> is {quoted(given[name])}: give numbers")
        if not all(map(math.isfinite, values)):
            self.wrong(f"{name} of <{tag}> is {quoted(given[name])}: give finite numbers")
        return values
