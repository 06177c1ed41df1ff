"""Friction, damping, forces and force limits that effects set before every physics step."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects.chain import EACH_SUBSTEP, Chain
from tiago_mj.effects.host import Host
from tiago_mj.effects.now import Wiring

Array = NDArray[np.float64]


class StepForces:
    """What effects write into models and states before a physics step.

    Args:
        chain: the effects.
        host: the simulations.
        wiring: their parts.

    Attributes:
        any: whether an effect sets anything; if not, many physics steps can be made at once.
    """

    def __init__(self, chain: Chain, host: Host, wiring: Wiring) -> None:
        self._chain, self._host, self._wiring = chain, host, wiring
        self._friction, self._damping, self._force, self._servo, self._range = (
            chain.users(hook) for hook in EACH_SUBSTEP
        )
        self.any = any(chain.users(hook) for hook in EACH_SUBSTEP)
        if self.any:
            for name in ("qfrc_actuator", "qfrc_smooth", "actuator_force"):
                host.output(name)  # a batch fills what is asked for at its next call: ask before the first
        self._base_friction: Any = None
        self._base_damping: Any = None
        self._base_range: Any = None
        self._base_bias: Any = None

    def start(self) -> None:
        """Note what there is without them, once the effects have changed the model."""
        if not self.any:
            return
        dof, ids, kept = self._wiring.dof, self._wiring.actuators, self._chain.kept
        self._base_friction = kept("dof_frictionloss")[:, dof].copy()
        self._base_damping = kept("dof_damping")[:, dof].copy()
        if self._servo:
            self._base_bias = kept("actuator_biasprm")[:, ids, 0].copy()
        if self._range:
            self._base_range = kept("actuator_forcerange")[:, ids].copy()

    def write(self) -> None:
        """Set them for the next physics step, from the present state."""
        now, host, dof, ids = self._chain.now, self._host, self._wiring.dof, self._wiring.actuators
        if self._friction:
            friction = self._base_friction
            for effect, mask in self._friction:
                friction = np.where(mask, friction + effect.added_friction(now), friction)
            host.field("dof_frictionloss")[:, dof] = np.maximum(friction, 0.0)
        if self._damping:
            damping = self._base_damping
            for effect, mask in self._damping:
                damping = np.where(mask, damping + effect.added_damping(now), damping)
            host.field("dof_damping")[:, dof] = np.maximum(damping, 0.0)
        if self._force:
            force = np.zeros((now.nsim, len(dof)))
            for effect, mask in self._force:
                force = np.where(mask, force + effect.added_force(now), force)
            host.state("qfrc_applied")[:, dof] = force
        if self._servo:
            own = self._base_bias
            for effect, mask in self._servo:
                own = np.where(mask, own + effect.servo_force(now), own)
            host.field("actuator_biasprm")[:, ids, 0] = own
        if self._range:
            limits = self._base_range
            for effect, mask in self._range:
                limits = np.where(mask[:, :, None], effect.force_range(limits, now), limits)
            host.field("actuator_forcerange")[:, ids] = limits
