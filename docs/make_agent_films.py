"""Film the agents that come with the package, for the pages of learning: `python docs/make_agent_films.py [NAME ...]`.

Each is an animated WebP of a few episodes that no training used, in images/agents.
"""

import argparse
from pathlib import Path

import tiago_mj  # noqa: F401  (chooses the headless renderer before mujoco is imported)

import gymnasium  # isort: skip
import imageio.v3 as iio
from make_pictures import IMAGES, antialiased

from tiago_mj.io import atomic
from tiago_mj.rollout.episode import play
from tiago_mj.rollout.policies import make_policy
from tiago_mj.view.drawing import Camera
from tiago_mj.view.film import Film

FILMS = IMAGES / "agents"
#: Agent: environment and its options, episodes, and how many steps of each are shown.
FILMED = {
    "td3-whole-robot": ("TIAGoTactile-v0", {"object_offset": 0.0}, 1, 100),
    "her-td3-reach": ("TIAGoReach-v0", {}, 4, 25),
    "dagger-push": ("TIAGoPush-v0", {}, 3, 60),
    "dagger-pick": ("TIAGoPickAndPlace-v0", {}, 3, 60),
    "ppo-close": ("GripperCloseGoal-v0", {"goal": [0.0, 0.045]}, 3, 150),
}
#: What moves on the table is small from where the whole task is seen.
CLOSER = {name: Camera((0.64, 0.0, 0.63), 0.85, 135, -30) for name in ("dagger-push", "dagger-pick")}
#: Seed of the first episode: neither trainings nor the benchmarks' evaluations use it.
FIRST_SEED = 30_000
SIZE = {"width": 800, "height": 600}


def filmed(name: str) -> Path:
    """Play an agent's episodes and write its film."""
    env_id, options, episodes, shown = FILMED[name]
    env = gymnasium.make(f"tiago_mj/{env_id}", render_mode="rgb_array", **SIZE, **options)
    film, policy = Film(env, camera=CLOSER.get(name)), make_policy(name, env, seed=0, trust=False)
    for seed in range(FIRST_SEED, FIRST_SEED + episodes):
        play(env, policy, seed=seed, watch=lambda step: film(step) if step <= shown else None)
    path = FILMS / f"{name}.webp"
    path.parent.mkdir(exist_ok=True)
    with atomic.replacing(path) as temporary:
        frames = [antialiased(frame) for frame in film.draw()]
        iio.imwrite(temporary, frames, extension=".webp", duration=round(1000 / film.fps), loop=0, quality=60)
    env.close()
    return path


def main() -> None:
    """All films, or those that are named."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", default=list(FILMED), metavar="NAME")
    for name in parser.parse_args().names:
        path = filmed(name)
        print(f"{path.name}: {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
