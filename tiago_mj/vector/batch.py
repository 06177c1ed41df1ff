"""A ``mujoco.batch.Batch`` that ``copy.deepcopy`` and ``pickle`` copy, in mid-episode too."""

from __future__ import annotations

import contextlib
from typing import Any

import mujoco
import mujoco.batch
from numpy.typing import NDArray


class CopiedBatch(mujoco.batch.Batch):  # type: ignore[misc]
    """The same batch; a copy has its states, its values of the model, and its outputs as of the last call.

    Args:
        model: of all simulations.
        count: how many.
        threads: to step them on.
    """

    def __init__(self, model: mujoco.MjModel, count: int, threads: int) -> None:
        self._outputs: dict[str, NDArray[Any]] = {}
        super().__init__(model, count, threads)

    def bind(self, name: str) -> NDArray[Any]:
        """As the base's."""
        bound: NDArray[Any] = super().bind(name)
        if not bound.flags.writeable:  # no view of the state
            self._outputs[name] = bound
        return bound

    def __getstate__(self) -> dict[str, Any]:
        own = {name: values for name in mujoco.batch.MODEL_FIELDS if (values := self.expanded(name)) is not None}
        return {
            "made_of": (self.model, self.nsim, self.nthread),
            "state": self.state,
            "warning": self.warning,
            "own": own,
            "outputs": self._outputs,
        }

    def __setstate__(self, kept: dict[str, Any]) -> None:
        self.__init__(*kept["made_of"])  # type: ignore[misc]
        self.state[:], self.warning[:] = kept["state"], kept["warning"]
        for name, values in kept["own"].items():
            self.expand(name)[:] = values
        for name, values in kept["outputs"].items():
            with _writeable(self.bind(name)) as output:
                output[:] = values


@contextlib.contextmanager
def _writeable(values: NDArray[Any]) -> Any:
    values.flags.writeable = True
    try:
        yield values
    finally:
        values.flags.writeable = False
