"""The options of a navigator as keys of files, as options of commands, and in recordings."""

from __future__ import annotations

import dataclasses
import inspect
import logging
import re
from collections.abc import Callable
from typing import Annotated, Any, TypeVar, get_type_hints

import tyro
from pydantic import ValidationInfo, field_validator

from ndtorch.navigation.options import OPTION_NAMES, NavigatorOptions, check_option, options_of
from ndtorch.navigation.rig import StereoRig
from ndtorch.toml import Strict

Command = TypeVar("Command", bound=type)


class NavigatorTable(Strict, NavigatorOptions):
    """A table of a file with the options of a navigator among its keys; `NavigatorOptions` says what they are."""

    @field_validator(*OPTION_NAMES)
    @classmethod
    def usable(cls, value: Any, info: ValidationInfo) -> Any:
        """The same check as in Python."""
        check_option(str(info.field_name), value)
        return value

    def options(self) -> NavigatorOptions:
        """The navigator's alone."""
        return options_of({name: getattr(self, name) for name in OPTION_NAMES})


def navigator_flags(*left_out: str) -> Callable[[Command], Command]:
    """Class decorator, under `dataclass`: a command gets an option for each of `NavigatorOptions`.

    What is not given is None, or False where the option is a flag.

    Args:
        left_out: options that the command does not have.
    """

    def add(command: Command) -> Command:
        kinds, words = get_type_hints(NavigatorOptions), option_help()
        for option in dataclasses.fields(NavigatorOptions):
            if option.name in left_out:
                continue
            kind, flag = kinds[option.name], option.default is False
            text = words[option.name] if flag else f"{words[option.name]} (default {option.default})"
            wanted = Annotated[kind if flag else kind | None, tyro.conf.arg(help=text)]  # type: ignore[valid-type]
            command.__annotations__[option.name] = wanted
            setattr(command, option.name, False if flag else None)
        return command

    return add


def option_help() -> dict[str, str]:
    """What the docstring of `NavigatorOptions` says of each option."""
    text = inspect.cleandoc(NavigatorOptions.__doc__ or "")
    block = re.split(r"^\w+:\n", text, flags=re.MULTILINE)[1]
    entries = re.split(r"^    (\w+): ", block, flags=re.MULTILINE)[1:]
    lines = zip(entries[::2], entries[1::2], strict=True)
    return {name: " ".join(words.split()).rstrip(".").replace("`", "") for name, words in lines}


def configuration(options: NavigatorOptions, rig: StereoRig, rate: float) -> dict[str, Any]:
    """For a recording: everything from which the same navigator can be made again."""
    return {
        "program": "navigator",
        "rig": dataclasses.asdict(rig),
        "rate_hz": rate,
        **dataclasses.asdict(options_of(dataclasses.asdict(options))),
    }


def print_note(line: str) -> None:
    """Tell the user, beside the results."""
    logging.getLogger(__name__).info(line)
