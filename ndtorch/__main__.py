"""`python -m ndtorch` is `ndtorch`."""

import sys


def program() -> int:
    """The command; Ctrl-C while it is still being imported ends it with no more than its exit code."""
    try:
        from ndtorch.commands import program as run

        return run()
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":
    sys.exit(program())
