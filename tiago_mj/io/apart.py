"""A function that reads what somebody else wrote with a library that cannot be bounded, in a process that is.

A few bytes can ask such a library for gigabytes or for ever. So it runs in a process of its own, which may take so much
memory and time, start no program, open no connection, and write into a folder of its own alone. One process serves one
function as long as nothing goes wrong; asks and answers are JSON and arrays, nothing is unpickled.
"""

from __future__ import annotations

import atexit
import contextlib
import importlib
import io
import json
import os
import struct
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Mapping
from typing import Any, BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.io.arrays import opened, read_array
from tiago_mj.io.quoting import one_line

#: What a function takes and gives: JSON, and arrays by name.
Answer = tuple[Any, Mapping[str, NDArray[Any]]]
#: Events of the interpreter that end what is read.
_NEVER: Final = (
    "subprocess.",
    "os.system",
    "os.exec",
    "os.posix_spawn",
    "os.spawn",
    "os.fork",
    "socket.",
    "ctypes.dlopen",
)
_LENGTH: Final = struct.Struct("<Q")
#: Of an answer, what is not arrays, as text.
_SAID: Final = "said.npy"


class RefusedError(ValueError):
    """The function refused its input; one line."""


class Reader:
    """A function of a module, in a process of its own.

    Args:
        module, function: whose name it has; it takes JSON, as keyword arguments, and gives JSON and arrays.
    """

    def __init__(self, module: str, function: str) -> None:
        self._name = (module, function)
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._owner = 0

    def __call__(self, asked: Mapping[str, Any], *, seconds: float, megabytes: float) -> Answer:
        """Result of the function.

        Args:
            asked: its arguments, as JSON has them.
            seconds: after which the process is ended.
            megabytes: that it may take more than at its beginning, and write.

        Raises:
            RefusedError: the function raised a ValueError or OSError.
            ModuleNotFoundError: a library that it needs is not installed.
            TimeoutError, MemoryError: it took longer, or more.
        """
        with self._lock:
            process = self._started()
            assert process.stdin is not None
            assert process.stdout is not None
            late = threading.Event()

            def end() -> None:
                late.set()
                process.kill()

            clock = threading.Timer(seconds, end)
            clock.start()
            answer = b""
            try:
                _put(process.stdin, json.dumps([dict(asked), megabytes]).encode())
                answer = _get(process.stdout)
            except (OSError, EOFError):
                self._process = None
                process.kill()
            finally:
                clock.cancel()
            if not answer:
                process.wait()
                raise TimeoutError(f"it takes more than {seconds:.0f} s") if late.is_set() else MemoryError
        return _understood(answer)

    def _end(self) -> None:
        process = self._process
        if process is not None and self._owner == os.getpid():
            process.kill()
            process.wait()
            for pipe in (process.stdin, process.stdout):
                if pipe is not None:
                    with contextlib.suppress(OSError):
                        pipe.close()

    def _started(self) -> subprocess.Popen[bytes]:
        there = self._process
        if there is None or self._owner != os.getpid() or there.poll() is not None:
            places = os.pathsep.join(path for path in sys.path if path)
            there = subprocess.Popen(
                [sys.executable, "-P", "-m", "tiago_mj.io.apart", *self._name],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env={**os.environ, "PYTHONPATH": places, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
            )
            if self._process is None and not self._owner:
                atexit.register(self._end)
            self._process, self._owner = there, os.getpid()
        return there


def _understood(answer: bytes) -> Answer:
    kind, content = answer[:1], answer[1:]
    if kind == b"+":
        with opened(io.BytesIO(content), len(content) + 1, stored=True) as archive:
            arrays = {
                name.removesuffix(".npy"): read_array(archive, name) for name in archive.namelist() if name != _SAID
            }
            return json.loads(str(read_array(archive, _SAID))), arrays
    said = content.decode("utf-8", "replace")
    if kind == b"?":
        raise ModuleNotFoundError(said)
    if kind == b"!":
        raise MemoryError
    raise RefusedError(said)


def _put(pipe: Any, content: bytes) -> None:
    pipe.write(_LENGTH.pack(len(content)))
    pipe.write(content)
    pipe.flush()


def _get(pipe: Any) -> bytes:
    head = pipe.read(_LENGTH.size)
    if len(head) < _LENGTH.size:
        raise EOFError
    (length,) = _LENGTH.unpack(head)
    content = bytes(pipe.read(length))
    if len(content) < length:
        raise EOFError
    return content


# In the process -------------------------------------------------------------------------------------------------------


def main(module: str, function: str) -> None:
    """Answer requests until standard input ends."""
    asks, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    nowhere = os.open(os.devnull, os.O_RDWR)
    os.dup2(nowhere, 0)
    os.dup2(nowhere, 1)
    call = getattr(importlib.import_module(module), function)
    with tempfile.TemporaryDirectory(prefix="tiago-mj-") as folder:
        tempfile.tempdir = folder
        _guard(folder)
        with contextlib.suppress(EOFError):
            while True:
                _serve(call, asks, answers)


def _serve(call: Callable[..., Answer], asks: BinaryIO, answers: BinaryIO) -> None:
    asked, megabytes = json.loads(_get(asks))
    try:
        _limit(megabytes)
        said, arrays = call(**asked)
        out = io.BytesIO()
        np.savez(out, allow_pickle=False, **{_SAID.removesuffix(".npy"): np.array(json.dumps(said)), **arrays})
        answer = b"+" + out.getvalue()
    except ModuleNotFoundError as fault:
        answer = b"?" + one_line(fault).encode()
    except MemoryError:
        answer = b"!"
    except Exception as fault:
        answer = b"-" + (one_line(str(fault)[:2000]) or type(fault).__name__).encode()
    _limit(None)
    _put(answers, answer)


def _limit(megabytes: float | None) -> None:
    """Bound the address space and every file that is written; None: no longer. Nothing on systems without limits."""
    try:
        import resource
    except ModuleNotFoundError:
        return
    most = resource.RLIM_INFINITY
    files = most
    if megabytes is not None:
        with contextlib.suppress(OSError), open("/proc/self/statm") as file:
            most = int(file.read().split()[0]) * resource.getpagesize() + int(megabytes * 1e6)
        files = int(megabytes * 1e6)
    for kind, bound in ((resource.RLIMIT_AS, most), (resource.RLIMIT_FSIZE, files)):
        hard = resource.getrlimit(kind)[1]
        with contextlib.suppress(ValueError, OSError):
            resource.setrlimit(kind, (bound if hard == resource.RLIM_INFINITY else min(bound, hard), hard))


def _guard(folder: str) -> None:
    """Forbid starting programs, opening connections and writing elsewhere."""

    def look(event: str, arguments: tuple[Any, ...]) -> None:
        if event.startswith(_NEVER):
            raise PermissionError(f"it asks for {event}, which no recording has any need of")
        if event == "open" and isinstance(arguments[0], str) and arguments[1] and set(str(arguments[1])) & set("wax+"):
            path = os.path.abspath(arguments[0])
            if not path.startswith(folder + os.sep):
                raise PermissionError("it asks for a file to be written, which no recording has any need of")

    sys.addaudithook(look)


if __name__ == "__main__":
    main(*sys.argv[1:])
