"""`python -m robot ...` of version 0.1: says what the command is called now."""

import sys

print(f"error: `python -m robot` is `ndtorch` now: ndtorch {' '.join(sys.argv[1:])}".rstrip(), file=sys.stderr)
sys.exit(2)
