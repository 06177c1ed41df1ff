"""Play commands in a model file with whatever MuJoCo this interpreter has: `python play_alone.py MODEL IN.npz OUT.npy [mjx | warp | patch FILE]`.

It imports nothing of this package, so that older versions of MuJoCo can run it.
"""  # noqa: E501

import sys
from pathlib import Path

import mujoco
import numpy as np


def start(model, said):
    """A simulation at the start of a motion, and the joints whose sum is observed."""
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    joints = []
    for name, value in zip(said["joints"], said["qpos"], strict=True):
        own = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name + end) for end in ("", "_play", "_spring")]
        joints.append([model.jnt_qposadr[j] for j in own if j >= 0])
        data.qpos[joints[-1][0]] = value
    for name, held in zip(said["actuators"], said["held"], strict=True):
        actuator = model.actuator(name).id
        if model.actuator_delay[actuator] > 0:
            samples = np.full(int(model.actuator_history[actuator, 0]), held)
            mujoco.mj_initCtrlHistory(model, data, actuator, None, samples)
    mujoco.mj_forward(model, data)
    return data, joints


def rows_of(model, said):
    data, joints = start(model, said)
    actuators = [model.actuator(name).id for name in said["actuators"]]
    rows = []
    for command in said["commands"]:
        rows.append([sum(data.qpos[a] for a in own) for own in joints])
        data.ctrl[actuators] = command
        for _ in range(int(said["substeps"])):
            mujoco.mj_step(model, data)
    return np.array(rows)


def rows_of_mjx(model, said):
    import jax
    import jax.numpy as jnp
    from mujoco import mjx

    data, joints = start(model, said)
    there = mjx.put_data(model, data)
    on_it = mjx.put_model(model)
    actuators = np.array([model.actuator(name).id for name in said["actuators"]])
    first = np.array([[own[0], own[-1]] for own in joints])
    split = np.array([len(own) > 1 for own in joints])

    def row(state, command):
        position = state.qpos[first[:, 0]] + jnp.where(split, state.qpos[first[:, 1]], 0.0)
        state = state.replace(ctrl=state.ctrl.at[actuators].set(command))
        state = jax.lax.fori_loop(0, int(said["substeps"]), lambda _, one: mjx.step(on_it, one), state)
        return state, position

    _, rows = jax.jit(lambda state: jax.lax.scan(row, state, jnp.asarray(said["commands"])))(there)
    return np.array(rows)


def rows_of_warp(model, said):
    import mujoco_warp as mjw
    import warp as wp

    data, joints = start(model, said)
    on_it, there = mjw.put_model(model), mjw.put_data(model, data)
    actuators = [model.actuator(name).id for name in said["actuators"]]
    control = np.zeros((1, model.nu), dtype=np.float32)
    rows = []
    for command in said["commands"]:
        position = there.qpos.numpy()[0]
        rows.append([sum(position[a] for a in own) for own in joints])
        control[0, actuators] = command
        wp.copy(there.ctrl, wp.array(control, dtype=float))
        for _ in range(int(said["substeps"])):
            mjw.step(on_it, there)
    return np.array(rows)


ENGINES = {"mjx": rows_of_mjx, "warp": rows_of_warp}

if __name__ == "__main__":
    loaded = mujoco.MjModel.from_xml_path(sys.argv[1])
    given = np.load(sys.argv[2])
    names = {}
    if sys.argv[4:5] == ["patch"]:
        exec(Path(sys.argv[5]).read_text(), names)
        names["patch"](loaded)
    np.save(sys.argv[3], ENGINES.get((sys.argv[4:] or [""])[0], rows_of)(loaded, given))
    print(mujoco.__version__)
