"""Arrays out of archives (npz and the like) that somebody else wrote: what a header claims is checked before memory is
taken, and nothing is unpickled."""

from __future__ import annotations

import math
import tokenize
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.io.quoting import one_line

#: Of an archive that is unpacked whole [bytes]; an agent has less than 1 MB.
MAX_UNPACKED_BYTES: Final = 100_000_000
#: Parts of an archive.
_PARTS: Final = 10_000
_FORMAT: Final[Any] = np.lib.format
_HEADERS: Final = {(1, 0): _FORMAT.read_array_header_1_0, (2, 0): _FORMAT.read_array_header_2_0}
#: What zipfile, zlib and NumPy raise of damaged files.
FAULTS: Final = (
    zipfile.BadZipFile,
    zlib.error,
    EOFError,
    NotImplementedError,
    KeyError,
    IndexError,
    TypeError,
    AttributeError,
    ValueError,
    OverflowError,
    RuntimeError,
    MemoryError,
    SyntaxError,
    tokenize.TokenError,
)


@contextmanager
def opened(path: Path | BinaryIO, most: int = MAX_UNPACKED_BYTES, *, stored: bool = False) -> Iterator[zipfile.ZipFile]:
    """An open archive, refused where its parts together are larger than allowed [bytes].

    Args:
        path: of the file, or one that is open.
        most: bytes, unpacked.
        stored: whether its parts must not be packed.

    Raises:
        OSError: it cannot be opened.
        ValueError: it is no file, larger, packed, or damaged.
    """
    if isinstance(path, Path) and path.exists() and not path.is_file():
        raise ValueError("it is a folder, a pipe or a device")
    with path.open("rb") if isinstance(path, Path) else nullcontext(path) as file:
        try:
            with zipfile.ZipFile(file) as archive:
                parts = archive.infolist()
                if stored and any(part.compress_type != zipfile.ZIP_STORED for part in parts):
                    raise ValueError("a part of it is compressed")
                if len(parts) > _PARTS or sum(part.file_size for part in parts) > most:
                    raise ValueError(f"unpacked it takes more than {most / 1e6:.0f} MB")
                yield archive
        except OSError as fault:  # zipfile seeks where a damaged part is said to be
            raise ValueError(f"it is damaged ({fault.strerror})") from fault


def read_array(archive: zipfile.ZipFile, name: str) -> NDArray[Any]:
    """An array of an archive.

    Raises:
        KeyError: there is none of that name.
        ValueError: it is damaged, claims more than it holds, or holds objects.
    """
    part = archive.getinfo(name)
    with archive.open(part) as file:
        header = _HEADERS.get(_FORMAT.read_magic(file))
        if header is None:
            raise ValueError(f"{name} is of an unknown version of NumPy's format")
        shape, _, kind = header(file)
        size = math.prod(shape) * kind.itemsize
        if kind.hasobject or any(one < 0 for one in shape) or size > part.file_size:
            raise ValueError(f"{name} claims {size} bytes of {kind} and holds {part.file_size}")
    with archive.open(part) as file:
        array: NDArray[Any] = _FORMAT.read_array(file, allow_pickle=False)
        return array


def read_npz(path: Path) -> dict[str, NDArray[Any]]:
    """Every array of an npz; faults as of :func:`opened` and :func:`read_array`."""
    with opened(path) as archive:
        names = [name for name in archive.namelist() if name.endswith(".npy")]
        return {name.removesuffix(".npy"): read_array(archive, name) for name in names}


def reason(fault: BaseException) -> str:
    """Why an archive cannot be read, shortly."""
    return one_line(fault)[:200] or type(fault).__name__
