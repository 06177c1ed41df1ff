"""What ``tiago-mj train`` takes."""

from __future__ import annotations

import argparse
from pathlib import Path

from tiago_mj.cli import options
from tiago_mj.io import outputs
from tiago_mj.io.numbers_option import add_numbers
from tiago_mj.learn.zoo_form import ALGORITHMS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the command."""
    options.add_environment(parser)
    parser.add_argument("--algo", default="td3", metavar="NAME", help=f"{', '.join(ALGORITHMS)} (td3)")
    parser.add_argument(
        "--out", type=outputs.folder, required=True, metavar="DIR", help="what is trained goes there; see below"
    )
    parser.add_argument("--seeds", type=int, default=1, metavar="N", help="seeds 0 to N - 1 (1)")
    parser.add_argument("--steps", type=int, metavar="N", help="environment steps a seed (as the hyperparameters say)")
    parser.add_argument(
        "--hyperparameters", type=Path, metavar="FILE", help="YAML in rl-zoo3's form (the paper's, for td3)"
    )
    parser.add_argument(
        "--gradient-steps", type=float, metavar="R", help="updates per environment step (as the hyperparameters say)"
    )
    parser.add_argument("--envs", type=int, metavar="N", help="environments of a seed (as the hyperparameters say)")
    parser.add_argument("--effects", type=Path, metavar="FILE", help="calibration.yaml whose effects act on it")
    add_numbers(parser)
    parser.add_argument(
        "--randomise",
        type=Path,
        metavar="FILE",
        help="every episode draws its own simulator: YAML with ranges of effects, or a folder that diagnose wrote",
    )
    parser.add_argument("--evaluate-every", type=int, default=10_000, metavar="N", help="environment steps (10000)")
    parser.add_argument("--evaluation-episodes", type=int, default=10, metavar="N", help="of each evaluation (10)")
    parser.add_argument("--checkpoint-every", type=int, default=12_000, metavar="N", help="environment steps (12000)")
    parser.add_argument("--tensorboard", action="store_true", help="log for TensorBoard, in DIR/seed-N/tensorboard")
    parser.add_argument("--quiet", action="store_true", help="show no progress")
    parser.add_argument("--json", action="store_true", help="print the result as data")
    options.add_processes(parser)
    parser.set_defaults(jobs=None)
    parser.epilog = "The same command again goes on where the training was stopped. See docs/learning.md."
