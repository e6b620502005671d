"""Subcommands of `python -m robot`, one file each."""
