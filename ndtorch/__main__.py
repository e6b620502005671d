"""`python -m ndtorch` is `ndtorch`."""

import sys

from ndtorch.cli.commands import program

if __name__ == "__main__":
    sys.exit(program())
