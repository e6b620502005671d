"""A parameter of a trial, and the trial: a value for every parameter."""

from __future__ import annotations

import hashlib
import json
import math
import sys
from dataclasses import dataclass

from ndtorch.errors import InputError, did_you_mean
from ndtorch.utils.toml import shown

Value = float | int | str
Trial = dict[str, Value]


@dataclass(frozen=True)
class Parameter:
    """A parameter of a trial: its default, the smallest and largest value, or the words it may be."""

    default: Value
    low: float = -math.inf
    high: float = math.inf
    words: tuple[str, ...] = ()

    def check(self, name: str, value: object, where: str) -> Value:
        """The value as the parameter has it. Raises `InputError`: of another type, or out of range."""
        if isinstance(self.default, str):
            if value not in self.words:
                raise InputError(
                    f"{where}: {name} must be one of {', '.join(self.words)}, got {value!r}"
                    f"{did_you_mean(value, self.words)}"
                )
            return str(value)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise InputError(f"{where}: {name} must be a number, got {shown(value)}")
        too_long = isinstance(value, int) and abs(value) > sys.float_info.max
        if too_long or not self.low <= value <= self.high:
            raise InputError(f"{where}: {name} must lie in {self.low:g}..{self.high:g}, got {shown(value)}")
        if isinstance(self.default, int) and not (math.isfinite(value) and value == int(value)):
            raise InputError(f"{where}: {name} must be a whole number, got {shown(value)}")
        return int(value) if isinstance(self.default, int) else float(value)


def trial_id(trial: Trial) -> str:
    """Sixteen hexadecimal digits of a trial's parameters."""
    return hashlib.sha256(json.dumps(trial, sort_keys=True).encode()).hexdigest()[:16]
