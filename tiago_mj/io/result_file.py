"""Files of results, as JSON of a schema: read back, or refused in one line."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

from pydantic import TypeAdapter, ValidationError

from tiago_mj.io.loading import load_json
from tiago_mj.io.quoting import quoted
from tiago_mj.io.schema import first_fault

T = TypeVar("T")


@dataclass(frozen=True)
class ResultFile(Generic[T]):
    """One kind of file.

    Attributes:
        what: it holds, in a word.
        name: of the file.
        command: that writes it.
        schema: its name and version, under the key ``schema``.
        adapter: declares what it holds.
    """

    what: str
    name: str
    command: str
    schema: str
    adapter: TypeAdapter[T]

    def load(self, path: Path) -> T:
        """Read a file.

        Raises:
            ValueError: there is no such file, it is of another schema, or something is missing in it; one line.
        """
        if not path.is_file():
            raise ValueError(f"no {self.what} at {path}: give the {self.name} that {self.command} wrote")
        mend = f"write it anew with {self.command}"
        data = load_json(path, f"{self.what} {path} cannot be read as JSON", mend=mend)
        schema = data.get("schema") if isinstance(data, dict) else None
        if schema != self.schema:
            raise ValueError(f"{self.what} {path} has schema {quoted(schema)}: this version reads {self.schema!r}")
        try:
            return self.adapter.validate_json(json.dumps(data), strict=True)
        except ValidationError as error:
            fault = first_fault(error, data)
            raise ValueError(f"{self.what} {path} is incomplete: {fault.path} {fault.problem}; {mend}") from error
