"""The options of a navigator as keys of files, as options of commands, and in recordings."""

from __future__ import annotations

import dataclasses
import logging
from typing import Any

from pydantic import ValidationInfo, field_validator

from ndtorch.navigation.body import Body
from ndtorch.navigation.options import OPTION_NAMES, NavigatorOptions, check_option, options_of
from ndtorch.navigation.stereo.rig import StereoRig
from ndtorch.utils.toml import Strict


class NavigatorTable(Strict, NavigatorOptions):
    """A table of a file with the options of a navigator among its keys; `NavigatorOptions` says what they are."""

    @field_validator(*OPTION_NAMES)
    @classmethod
    def usable(cls, value: Any, info: ValidationInfo) -> Any:
        check_option(str(info.field_name), value)
        return value

    def options(self) -> NavigatorOptions:
        return options_of({name: getattr(self, name) for name in OPTION_NAMES})


def configuration(options: NavigatorOptions, rig: StereoRig, rate: float, body: Body | None = None) -> dict[str, Any]:
    """For a recording: everything from which the same navigator can be made again."""
    return {
        "rig": dataclasses.asdict(rig),
        "body": dataclasses.asdict(body or Body()),
        "rate_hz": rate,
        **dataclasses.asdict(options_of(dataclasses.asdict(options))),
    }


def print_note(line: str) -> None:
    """Tell the user, beside the results."""
    logging.getLogger(__name__).info(line)
