"""A fault of this program: it ends a diagnosis as what it is, and keeps the best answer until then."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Final

from tiago_mj.io import atomic
from tiago_mj.io.deadline import OutOfTimeError
from tiago_mj.io.quoting import one_line
from tiago_mj.recordings.recording import RecordingError

if TYPE_CHECKING:
    from tiago_mj.gap.result import Diagnosis


#: Where a fault of this program came from.
FAULT: Final = "fault.txt"


class FaultError(Exception):
    """A diagnosis met a fault of this program.

    Attributes:
        fault: that it met.
        answer: the best until then.
    """

    def __init__(self, fault: Exception, answer: Diagnosis) -> None:
        super().__init__(f"{type(fault).__name__}: {one_line(fault)}")
        self.fault, self.answer = fault, answer


@contextmanager
def keeping(answer: Callable[[Exception], Diagnosis]) -> Iterator[None]:
    """Let what the block may meet pass: the end of its time, an interrupt, recordings that cannot be used. Whatever
    else it raises is a fault.

    Args:
        answer: the best that is known where a fault was met.

    Raises:
        FaultError: of that fault, with the answer.
    """
    try:
        yield
    except (RecordingError, OutOfTimeError, FaultError):
        raise
    except Exception as fault:
        raise FaultError(fault, answer(fault)) from fault


def write(fault: BaseException, folder: Path) -> None:
    """Write a fault's traceback into a folder, as :data:`FAULT`."""
    atomic.write_text(folder / FAULT, "".join(traceback.format_exception(fault)))
