"""What is left looks like: the right shape of a closed form, none of noise, and the stage by what carries it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.signal import lfilter

from tiago_mj.effects.declare import STAGES
from tiago_mj.gap.analysis import residual_shape, unexplained
from tiago_mj.gap.analysis.regressors import Trajectory
from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.result import CARRIERS, SHAPES

PERIOD = 0.02
TRIALS, ROWS = 8, 300


def course(seed, trials=TRIALS, rows=ROWS):
    """A joint that swings and steps, and touches something from 0.25 rad on."""
    rng = np.random.default_rng(seed)
    time = np.arange(rows) * PERIOD
    size, rate, angle = (rng.uniform(*ends, (trials, 3, 1)) for ends in ((0.1, 0.3), (0.15, 0.9), (0, 2 * np.pi)))
    command = np.repeat(rng.uniform(-0.3, 0.3, (trials, 10)), rows // 10, axis=1)
    swing = (size * np.sin(2 * np.pi * rate * time + angle)).sum(axis=1)
    position = swing + gaussian_filter1d(command, 3, axis=1)
    velocity = np.gradient(position, axis=1) / PERIOD
    touching = position > 0.25
    return Trajectory(position, velocity, command, touching, 30 * np.maximum(position - 0.25, 0), PERIOD)


def noise(rng, shape, decay):
    """White, or correlated with a time constant in rows, of unit variance."""
    white = rng.standard_normal(shape)
    last = np.exp(-1 / decay) if decay else 0.0
    return lfilter([np.sqrt(1 - last**2)], [1, -last], white, axis=1)


def fading(events, seconds):
    return lfilter([1], [1, -np.exp(-PERIOD / seconds)], events, axis=1)


def begins(flags):
    return np.maximum(np.diff(flags.astype(float), axis=1, prepend=flags[:, :1].astype(float)), 0)


def turns(velocity):
    sign = np.sign(velocity)
    return np.where(np.diff(sign, axis=1, prepend=sign[:, :1]) != 0, sign, 0.0)


CLOSED = {
    "constant": ("offset", lambda c: np.ones_like(c.velocity)),
    "clock": ("drift", lambda c: np.ones_like(c.velocity) * np.arange(ROWS)),
    "session": ("drift", lambda c: np.ones_like(c.velocity) * np.arange(TRIALS)[:, None] ** 1.5),
    "late": ("speed", lambda c: c.velocity),
    "slower both ways": ("speed", lambda c: np.abs(c.velocity)),
    "drag": ("speed", lambda c: c.velocity**3),
    "inertia": ("acceleration", lambda c: np.gradient(c.velocity, axis=1)),
    "spring": ("position", lambda c: c.position**3),
    "dent": ("position", lambda c: np.exp(-(((c.position - 0.1) / 0.15) ** 2))),
    "teeth": ("periodic", lambda c: np.sin(2 * np.pi * c.position / 0.12 + 1)),
    "dry friction": ("direction", lambda c: np.sign(c.velocity)),
    "friction of one place": ("place", lambda c: np.sign(c.velocity) * np.exp(-(((c.position + 0.2) / 0.1) ** 2))),
    "after turning": ("reversal", lambda c: fading(turns(c.velocity), 0.08)),
    "after a jump": ("jump", lambda c: fading(np.diff(c.command, axis=1, prepend=c.command[:, :1]), 0.06)),
    "in touch": ("touch", lambda c: c.touching.astype(float)),
    "stiffer": ("force", lambda c: c.force),
    "impact": ("onset", lambda c: fading(begins(c.touching), 0.15) * c.touching),
    "clings": ("release", lambda c: fading(begins(~c.touching), 0.15) * ~c.touching),
    "hum": ("frequency", lambda c: np.sin(2 * np.pi * 9.3 * np.arange(ROWS) * PERIOD + np.arange(TRIALS)[:, None])),
}


@pytest.mark.parametrize("name", CLOSED)
@pytest.mark.parametrize("seed", [1, 2])
def test_a_closed_form_under_noise_has_its_shape(name, seed):
    shape, form = CLOSED[name]
    on = course(seed)
    residual = form(on) / np.sqrt(np.mean(form(on) ** 2))
    residual = residual + 0.6 * noise(np.random.default_rng(seed), residual.shape, 5)
    found = residual_shape.named(residual_shape.shares(residual, on), TRIALS)
    assert found.shape == shape
    assert 0.4 < found.share < 1 / (1 + 0.6**2) + 0.05  # no more than all that is not noise
    if shape == "frequency":
        assert found.at == pytest.approx(9.3, abs=0.2)
    if shape == "periodic":
        assert found.at == pytest.approx(0.12, rel=0.05)


@pytest.mark.parametrize(("decay", "trials"), [(0, TRIALS), (15, TRIALS), (15, 2), (5, 1)], ids=str)
def test_noise_has_no_shape(decay, trials):
    """White noise, and noise that is correlated over a tenth of a trial, less of a single one."""
    named = []
    for seed in range(40):
        on = course(seed, trials, 150)
        found = residual_shape.shares(noise(np.random.default_rng([seed, 9]), on.position.shape, decay), on)
        named.append(residual_shape.named(found, trials).shape)
    assert np.mean([one != "irregular" for one in named]) <= 0.05


def test_what_is_missing_changes_no_shape_and_uncertain_rows_count_less():
    on = course(3)
    rng = np.random.default_rng(3)
    residual = on.velocity / on.velocity.std() + 0.3 * rng.standard_normal(on.velocity.shape)
    residual[rng.random(residual.shape) < 0.2] = np.nan
    assert residual_shape.shares(residual, on)[0].shape == "speed"
    off = np.where(rng.random(residual.shape) < 0.05, 40.0, 0.0)
    sigma = np.where(off > 0, 40.0, 1.0)
    assert residual_shape.shares(residual + off, on, sigma)[0].shape == "speed"
    assert residual_shape.shares(np.full_like(residual, np.nan), on) == []
    assert residual_shape.named([], TRIALS).shape == "irregular"


def test_a_line_of_the_motion_itself_is_no_shape():
    time = np.arange(ROWS) * PERIOD
    swing = np.sin(2 * np.pi * 2 * time) * np.ones((TRIALS, 1))
    still = np.zeros_like(swing)
    on = Trajectory(swing, np.gradient(swing, axis=1) / PERIOD, swing, still > 0, still, PERIOD)
    found = residual_shape.shares(swing**2 * np.sign(swing) + 0.1 * swing, on)
    assert "frequency" not in [one.shape for one in found]


# What carries it -----------------------------------------------------------------------------------------------------


def residuals(seed=0):
    """Of a joint that swings away by a few mrad: position and velocity."""
    time = np.arange(400) * 0.01
    angle = np.random.default_rng(seed).uniform(0, 6, (5, 1))
    omega = 2 * np.pi * 1.3
    return 4e-3 * np.sin(omega * time + angle), 4e-3 * omega * np.cos(omega * time + angle)


def agreement(position, velocity, seed=0):
    rng = np.random.default_rng(seed)
    read = position + 1e-4 * rng.standard_normal(position.shape), velocity + 2e-3 * rng.standard_normal(velocity.shape)
    return unexplained.agreement(*read, 1e-4, 2e-3, 0.01)


def test_readings_that_agree_are_a_motion_and_one_alone_is_its_sensor():
    position, velocity = residuals()
    nothing = np.zeros_like(position)
    assert agreement(position, velocity) == "motion"
    assert agreement(position, nothing) == "position"
    assert agreement(nothing, velocity) == "velocity"
    assert agreement(position, -velocity) == "apart"
    assert agreement(nothing, nothing) == "unclear"
    assert agreement(position + 0.1, velocity) == "motion"  # an offset does not move
    assert agreement(nothing + 0.1, nothing) == "unclear"
    missing = position.copy()
    missing[:, ::7] = np.nan
    assert agreement(missing, velocity) == "motion"
    assert agreement(np.full_like(position, np.nan), velocity) == "unclear"


def data(channels):
    value = np.zeros((5, 400, len(channels)))
    noise_of = np.array([{"p": 1e-4, "v": 2e-3, "f": 8e-3}[name[0]] for name in channels])
    sigma = np.broadcast_to(noise_of, value.shape)
    return Data(channels, np.zeros(len(channels), dtype=int), value, noise_of, sigma, 0 * sigma)


def test_forces_without_a_motion_are_the_force_sensor_and_both_are_both():
    position, velocity = residuals()
    here = data(("position.j", "velocity.j", "force.a"))
    force = 0.5 * np.ones_like(position)
    still = 1e-4 * np.random.default_rng(1).standard_normal(position.shape)
    alone = np.stack([still, 20 * still, force], axis=-1)
    assert unexplained.loudness(here, alone).argmax() == 2
    assert unexplained.carrier(here, alone, 2, 0.01) == "force"
    assert unexplained.stages("force", "force") == ("force_sensor",)
    both = np.stack([position, velocity, force / 2], axis=-1)
    assert unexplained.carrier(here, both, 2, 0.01) == "both"
    assert "force_sensor" in unexplained.stages("both", "force")
    assert unexplained.carrier(data(("position.j", "force.a")), both[:, :, [0, 2]], 0, 0.01) == "unclear"


def test_every_stage_is_one_of_the_chain_and_only_a_reading_alone_points_to_its_sensor():
    for carrier in CARRIERS:
        for shape in SHAPES:
            found = unexplained.stages(carrier, shape)
            assert set(found) <= set(STAGES)
            assert len(set(found)) == len(found)
    assert unexplained.stages("velocity", "acceleration") == ("joint_sensor",)
    assert unexplained.stages("motion", "place") == ("transmission",)
    assert {"command", "transmission"} <= set(unexplained.stages("motion", "speed"))
    assert unexplained.stages("motion", "irregular") == ()
