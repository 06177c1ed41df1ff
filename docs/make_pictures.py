"""Render the README's pictures of the robots: `python docs/make_pictures.py`."""

from pathlib import Path

import tiago_mj  # noqa: F401  (chooses the headless renderer before mujoco is imported)

import gymnasium  # isort: skip
import imageio.v3 as iio
import numpy as np

IMAGES = Path(__file__).parent / "images"
ROBOTS = {
    "gripper_ta11": "GripperTactile-v0",
    "tiago_ta11": "TIAGoTactile-v0",
    "tiago_pal_gripper": "TIAGoPALGripper-v0",
}


def main() -> None:
    """Each robot with its fingers half closed."""
    IMAGES.mkdir(exist_ok=True)
    for robot, name in ROBOTS.items():
        env = gymnasium.make(f"tiago_mj/{name}", render_mode="rgb_array", width=1280, height=960)
        env.reset(seed=0)
        action = np.zeros(env.action_space.shape)
        action[-2:] = -1
        for _ in range(60):
            env.step(action)
        iio.imwrite(IMAGES / f"{robot}.png", antialiased(env.render()), optimize=True)
        env.close()


def antialiased(frame: np.ndarray) -> np.ndarray:
    """Half the size, each pixel the mean of four."""
    height, width = frame.shape[0] // 2, frame.shape[1] // 2
    return frame.reshape(height, 2, width, 2, 3).mean(axis=(1, 3)).astype(np.uint8)


if __name__ == "__main__":
    main()
