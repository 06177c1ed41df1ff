"""An environment of a user's own, with effects in it whose cost is known: each step pays what the effects say."""

from __future__ import annotations

import gymnasium
import numpy as np

from tiago_mj.effects import Entry


class Toy(gymnasium.Env):
    """Ten steps; the reward is -(a drawn difficulty) - what the effects cost - the distance of the action from 1.

    ``payload`` costs its mass [kg] a step, ``backlash`` nothing; ``encoder_bias`` acts on what is observed, so that it
    costs a policy alone that looks.
    """

    observation_space = gymnasium.spaces.Box(-10.0, 10.0, (1,))
    action_space = gymnasium.spaces.Box(-10.0, 10.0, (1,))

    def __init__(self, effects: list[Entry]) -> None:
        self.effects = effects
        self.seeds: list[int | None] = []

    def amount(self, name: str, parameter: str) -> float:
        return sum(one.parameters[parameter] for one in self.effects if one.name == name)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.seeds.append(seed)
        self.difficulty, self.left = float(self.np_random.uniform(0, 5)), 10
        return self._seen(), {}

    def _seen(self):
        return np.array([1.0 + self.amount("encoder_bias", "offset")])

    def step(self, action):
        self.left -= 1
        lost = self.difficulty + self.amount("payload", "mass") + abs(float(np.asarray(action).ravel()[0]) - 1.0)
        return self._seen(), -lost, False, self.left == 0, {"is_success": lost < 4.0}


PAYLOAD = {"name": "payload", "parameters": {"mass": {"value": 2.0, "low": 1.9, "high": 2.1}}}
BACKLASH = {"name": "backlash", "parameters": {"width": {"value": 0.01, "low": 0.009, "high": 0.011}}}
BIAS = {"name": "encoder_bias", "parameters": {"offset": {"value": 0.1, "low": 0.09, "high": 0.11}}}


def follows(observation):
    """A policy that does what it sees."""
    return observation


def knows(observation):
    """A policy that looks at nothing."""
    return np.array([1.0])
