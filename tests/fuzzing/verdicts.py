"""What is asked of a reader on any input: one line of its own error or a result, and nothing else."""

from __future__ import annotations

import contextlib
import io
import sys
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from fuzzing.targets import Target
from tiago_mj.io import mujoco_log
from tiago_mj.io.quoting import HIDDEN

#: Characters of a complaint.
LONGEST: Final = 2500
ACCEPTED, REFUSED = "accepted", "refused"

#: Events of the interpreter (``sys.audit``) that no reader has any need of.
_NEVER: Final = (
    "os.system", "os.exec", "os.posix_spawn", "os.spawn", "os.fork", "os.forkpty", "os.startfile", "pty.spawn",
    "socket.connect", "socket.bind", "socket.sendto", "socket.gethostbyname", "socket.getaddrinfo", "urllib.Request",
    "webbrowser.open", "ftplib.connect", "smtplib.connect", "telnetlib.Telnet.open", "http.client.connect",
    "pickle.find_class", "code.__new__", "os.putenv", "os.unsetenv", "os.kill", "os.chown", "os.link", "os.symlink",
    "ctypes.dlopen", "sys.addaudithook", "cpython.run_command", "cpython.run_file", "subprocess.Popen",
    "shutil.unpack_archive",
)  # fmt: skip
_WRITING: Final = ("w", "a", "x", "+")


class Watch:
    """What happens while a reader works, seen by the interpreter itself; one for a process, as hooks stay."""

    def __init__(self) -> None:
        self.seen: list[str] = []
        self.folder: Path | None = None
        sys.addaudithook(self._hook)

    @contextlib.contextmanager
    def on(self, folder: Path) -> Iterator[list[str]]:
        """Note what is done that no reader may do; files may be written below the folder alone."""
        self.seen, self.folder = [], folder
        try:
            yield self.seen
        finally:
            self.folder = None

    def _hook(self, event: str, arguments: tuple[Any, ...]) -> None:
        folder = self.folder
        if folder is None:
            return
        if event in _NEVER:
            if event in ("subprocess.Popen", "os.kill") and _within("tiago_mj.io.apart"):
                return  # what reads in a process of its own, bounded by the system
            if event in ("os.link", "os.chown") and _within("tiago_mj.io.atomic") and self._is_below(arguments):
                return  # how a folder is exchanged whole: links to the files that stay, and the old folder's group
            self.seen.append(f"{event} {str(arguments)[:200]}")
        elif event == "exec" and not _of_code(arguments[0]):
            self.seen.append(f"exec {arguments[0]!r}"[:200])
        elif event == "open" and isinstance(arguments[0], str) and isinstance(arguments[1], str):
            path, mode = arguments[0], arguments[1]
            if any(letter in mode for letter in _WRITING) and not path.startswith((str(folder), "/dev/null", "/tmp/")):
                self.seen.append(f"open {path} {mode}"[:200])
        elif event in ("os.remove", "os.rename", "os.rmdir", "os.mkdir", "shutil.rmtree"):
            path = str(arguments[0])
            if not path.startswith((str(folder), "/tmp/")) and path.startswith("/"):
                self.seen.append(f"{event} {path}"[:200])

    def _is_below(self, arguments: tuple[Any, ...]) -> bool:
        """Whether every path among these is below the folder."""
        paths = [Path(one) for one in arguments if isinstance(one, (str, Path))]
        return bool(paths) and all(self.folder is not None and one.is_relative_to(self.folder) for one in paths)


#: Libraries that write code of their own. That of rosbags is made of names which its grammar has checked.
_WRITE_CODE: Final = (
    "dataclasses", "collections", "pydantic", "rosbags", "typing", "enum", "torch", "trimesh", "scipy", "functools",
)  # fmt: skip


def _of_code(code: Any) -> bool:
    """Whether code that is run comes from an installed module, or from a library that writes its own."""
    name = getattr(code, "co_filename", "")
    return name.endswith(".py") or name.startswith(("<frozen", "<attrs", "<__array")) or _within(*_WRITE_CODE)


def _within(*modules: str) -> bool:
    """Whether one of these is what made something happen."""
    frame: Any = sys._getframe(3)
    for _ in range(12):
        if frame is None:
            return False
        name = frame.f_globals.get("__name__", "")
        if name.startswith(modules):
            return True
        frame = frame.f_back
    return False


def said_well(message: str) -> str:
    """What is wrong with a complaint; empty if nothing is."""
    if not message.strip():
        return "a complaint without words"
    if len(message.splitlines()) != 1:
        return f"a complaint of {len(message.splitlines())} lines"
    if HIDDEN.search(message):
        return "a complaint with characters that are not shown"
    if len(message) > LONGEST:
        return f"a complaint of {len(message)} characters"
    return ""


def tried(target: Target, folder: Path, watch: Watch | None = None) -> tuple[str, str]:
    """Read an input.

    Returns:
        :data:`ACCEPTED`, :data:`REFUSED`, or what is wrong; and the complaint.
    """
    said = ""
    quiet = contextlib.redirect_stdout(io.StringIO())
    with warnings.catch_warnings(record=True) as warned, quiet, mujoco_log.counted():
        warnings.simplefilter("always")
        with watch.on(folder) if watch is not None else contextlib.nullcontext([]) as seen:
            try:
                target.read(folder)
                verdict = ACCEPTED
            except target.errors as fault:
                said, verdict = str(fault), REFUSED
                if type(fault) not in target.errors:
                    verdict = f"{type(fault).__name__} in place of {target.errors[0].__name__}"
                else:
                    verdict = said_well(said) or verdict
            except BaseException as fault:
                if isinstance(fault, KeyboardInterrupt):
                    raise
                said, verdict = f"{fault}"[:500], f"{type(fault).__name__} from {_place(fault)}"
    if seen:
        verdict = f"did {seen[0]}"
    # What MuJoCo says of a model that it takes is the command's to tell (tiago_mj.io.mujoco_log).
    several = [one for one in warned if issubclass(one.category, (RuntimeWarning, UserWarning))]
    told = [one for one in several if "Check model" not in str(one.message)]
    if told and verdict in (ACCEPTED, REFUSED):
        first = told[0]
        place = f"{Path(first.filename).name}:{first.lineno}"
        verdict = f"warned {first.category.__name__}: {str(first.message)[:120]} at {place}"
    return verdict, said


def _place(fault: BaseException) -> str:
    """Where it was raised, in this package's own terms: the innermost of its lines."""
    frame, place = fault.__traceback__, ""
    while frame is not None:
        file = Path(frame.tb_frame.f_code.co_filename)
        if "tiago_mj" in file.parts and "tests" not in file.parts:
            place = f"{file.name}:{frame.tb_lineno}"
        last = f"{file.name}:{frame.tb_lineno}"
        frame = frame.tb_next
    return place or last


def by_command(words: Sequence[str], source: Path, out: Path) -> tuple[str, str]:
    """The same through the command line: exit status 0, or 2 with one line and nothing written."""
    from tiago_mj import cli

    filled = [word.replace("{in}", str(source)).replace("{out}", str(out)) for word in words]
    told, complaint = io.StringIO(), io.StringIO()
    out.mkdir(exist_ok=True)
    before = sorted(out.rglob("*"))
    try:
        with contextlib.redirect_stdout(told), contextlib.redirect_stderr(complaint):
            status = cli.main(filled)
    except SystemExit as left:
        status = left.code if isinstance(left.code, int) else 1
    except BaseException as fault:
        if isinstance(fault, KeyboardInterrupt):
            raise
        return f"{type(fault).__name__} from {_place(fault)}", str(fault)[:500]
    said = complaint.getvalue()
    if status == 0:
        return ACCEPTED, ""
    if status != 2:
        return f"exit status {status}", said
    after = sorted(out.rglob("*"))
    if [path for path in after if path.is_file()] != [path for path in before if path.is_file()]:
        return f"refused, and left {[path.name for path in after][:4]}", said
    return said_well(said.rstrip("\n")) or REFUSED, said
