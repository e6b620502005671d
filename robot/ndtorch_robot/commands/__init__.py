"""Subcommands of `ndtorch`, one file each."""
