"""The options of a navigator as keys of files, as options of commands, and in recordings."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Mapping
from typing import Any, ClassVar

from pydantic import ValidationInfo, field_validator, model_validator

from ndtorch.errors import InputError
from ndtorch.navigation.body import Body
from ndtorch.navigation.options import OPTION_NAMES, NavigatorOptions, check_option, options_of
from ndtorch.navigation.stereo.rig import StereoRig
from ndtorch.utils.toml import Strict
from ndtorch_robot.navigator_options import GONE, RENAMED


def key_of(flag: str) -> str:
    return flag.removeprefix("--").replace("-", "_")


class NavigatorTable(Strict, NavigatorOptions):
    """A table of a file with the options of a navigator among its keys; `NavigatorOptions` says what they are."""

    renamed: ClassVar[Mapping[str, str]] = {key_of(old): key_of(now) for old, now in RENAMED.items()}

    @model_validator(mode="before")
    @classmethod
    def of_now(cls, values: Any) -> Any:
        for flag, instead in GONE.items():
            if isinstance(values, dict) and key_of(flag) in values:
                raise InputError(f"{key_of(flag)} is gone: {instead}")
        return values

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
