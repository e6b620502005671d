"""`python -m train ...` of version 0.1: says what the command is called now."""

import sys

print(f"error: `python -m train` is `ndtorch` now: ndtorch {' '.join(sys.argv[1:])}".rstrip(), file=sys.stderr)
sys.exit(2)
