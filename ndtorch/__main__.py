"""`python -m ndtorch` is `ndtorch`."""

import signal
import sys


def program() -> int:
    """The command; Ctrl-C while it is still being imported, or while Python ends, prints no traceback."""
    try:
        from ndtorch.cli.commands import program as run

        return run()
    except KeyboardInterrupt:
        print("stopped before it began", file=sys.stderr)
        return 130
    finally:
        # Everything is kept and told. Python's own handler would print a traceback from whatever cleans up now.
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            signal.signal(signal.SIGINT, signal.SIG_DFL)


if __name__ == "__main__":
    sys.exit(program())
