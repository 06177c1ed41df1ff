"""Many environments at once, on ``mujoco.batch.Batch``: ``gymnasium.make_vec(ID, num_envs=N)``."""
