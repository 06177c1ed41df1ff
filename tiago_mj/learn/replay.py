"""Hindsight replay buffer that keeps the list of valid transitions instead of searching it at every update."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import HerReplayBuffer
from stable_baselines3.common.type_aliases import DictReplayBufferSamples


class HindsightBuffer(HerReplayBuffer):  # type: ignore[misc]
    """stable-baselines3's hindsight replay, drawing the same transitions from the same random numbers.

    Which transitions belong to finished episodes changes only when one is added; searching the whole buffer at every
    update takes longer than the update.
    """

    _replayable: NDArray[np.intp] | None = None

    def add(self, *args: Any, **kwargs: Any) -> None:
        """Store a transition of every environment."""
        self._replayable = None
        super().add(*args, **kwargs)

    def truncate_last_trajectory(self) -> None:
        """Mark unfinished episodes as finished."""
        self._replayable = None
        super().truncate_last_trajectory()

    def sample(self, batch_size: int, env: Any = None) -> DictReplayBufferSamples:
        """A batch: with ``n_sampled_goal`` = 4, four fifths have goals that their episodes reached later.

        Raises:
            RuntimeError: no episode is over yet.
        """
        if self._replayable is None:
            self._replayable = np.flatnonzero(self.ep_length > 0)
        if not len(self._replayable):
            raise RuntimeError("no episode is over yet: nothing can be replayed")
        chosen = np.random.choice(self._replayable, size=batch_size, replace=True)  # noqa: NPY002  (as the parent does)
        rows, columns = np.unravel_index(chosen, self.ep_length.shape)
        relabelled = int(self.her_ratio * batch_size)
        new = self._get_virtual_samples(rows[:relabelled], columns[:relabelled], env)
        old = self._get_real_samples(rows[relabelled:], columns[relabelled:], env)

        def together(name: str) -> Any:
            first, second = getattr(old, name), getattr(new, name)
            if isinstance(first, dict):
                return {key: torch.cat((first[key], second[key])) for key in first}
            return torch.cat((first, second))

        names = ("observations", "actions", "next_observations", "dones", "rewards")
        return DictReplayBufferSamples(**{name: together(name) for name in names})
