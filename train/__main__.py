"""Command line of the training programs."""

from __future__ import annotations

import sys
from typing import Annotated

import tyro

from ndtorch.errors import InputError
from train.first_stage import FirstStageOptions, write_first_stage

Command = Annotated[FirstStageOptions, tyro.conf.subcommand("first-stage")]


def main(arguments: list[str] | None = None) -> int:
    """Run `python -m train ...`; returns the exit code."""
    app = tyro.extras.SubcommandApp()

    @app.command(name="first-stage")
    def first_stage(options: tyro.conf.OmitArgPrefixes[FirstStageOptions]) -> None:
        """Train the three first-stage networks on the ring stimulus and write a model folder."""
        write_first_stage(options)

    try:
        app.cli(prog="python -m train", description="Make the models.", args=arguments)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
