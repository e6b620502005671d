"""Command line of the training programs."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from ndtorch.commands import run_subcommand
from train.first_stage import FirstStageOptions
from train.reproduce.command import Reproduce
from train.score.command import ScoreOptions
from train.sweep.command import Sweep

COMMANDS = {
    "first-stage": FirstStageOptions,
    "score": ScoreOptions,
    "reproduce": Reproduce,
    "sweep": Sweep,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `python -m train ...`; returns the exit code: 0, 2 for unusable input, 130 for Ctrl-C."""
    return run_subcommand("python -m train", "Make the models and check what they claim.", COMMANDS, arguments)


if __name__ == "__main__":
    sys.exit(main())
