"""Public data sets: where their files are, at which commit, and what their contents hash to.

Nothing of them is part of this package. ``SRC`` of ``tiago-mj import`` is a folder that holds the files, or the word
``download``, which fetches them from GitHub and checks every one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from tiago_mj.io.extra import load
from tiago_mj.recordings.recording import RecordingError

DOWNLOAD: Final = "download"


@dataclass(frozen=True)
class DataSet:
    """Files of a repository at a commit.

    Attributes:
        name: of the importer, and of the folder in the cache.
        repository: owner and name on GitHub.
        commit: 40 hexadecimal digits.
        path: folder of the files in the repository.
        licence: of the files.
        sha256: by path below that folder.
    """

    name: str
    repository: str
    commit: str
    path: str
    licence: str
    sha256: Mapping[str, str]

    @property
    def source(self) -> dict[str, str]:
        """Origin of the data, for the sidecar."""
        return {"repository": self.repository, "commit": self.commit, "path": self.path, "licence": self.licence}

    def url(self, file: str) -> str:
        """Address of one file at that commit."""
        return f"https://raw.githubusercontent.com/{self.repository}/{self.commit}/{self.path}/{file}"


def folder_of(data: DataSet, source: str) -> Path:
    """The folder that holds the files.

    Args:
        data: which.
        source: a folder, or :data:`DOWNLOAD`.

    Raises:
        RecordingError: there is no such folder.
        ValueError: a downloaded file is not the one that it was.
    """
    if source == DOWNLOAD:
        pooch: Any = load("pooch", "downloading recordings")
        cache = Path(pooch.os_cache("tiago_mj")) / data.name
        for file, digest in data.sha256.items():
            pooch.retrieve(data.url(file), f"sha256:{digest}", fname=Path(file).name, path=cache / Path(file).parent)
        return cache
    folder = Path(source)
    if not folder.is_dir():
        raise RecordingError(
            f"{source}: no such folder: give the one with the files of {data.repository}, or '{DOWNLOAD}'"
        )
    return folder


def need(folder: Path, file: str) -> Path:
    """A file of a data set.

    Raises:
        RecordingError: it is not there.
    """
    path = folder / file
    if not path.is_file():
        raise RecordingError(f"{folder}: {file} is missing: give the folder that holds it")
    return path
