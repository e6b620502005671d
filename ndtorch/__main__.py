"""`python -m ndtorch` is `ndtorch`."""

import sys

from ndtorch.commands import main

sys.exit(main())
