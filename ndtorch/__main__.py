"""`python -m ndtorch` is `ndtorch`."""

import sys

from ndtorch.commands import program

sys.exit(program())
