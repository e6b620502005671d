"""The one error type for input that cannot be used."""


class InputError(ValueError):
    """An argument, file or option that cannot be used.

    The message is one line that names the thing, what was given and what is wanted.
    The command lines print it and exit with code 2.
    """
