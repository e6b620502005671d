"""The numbers of windows that follow objects, as their kernel takes them."""

from __future__ import annotations

from typing import NamedTuple


class WindowNumbers(NamedTuple):
    """`WindowParams` as plain numbers, and the time between updates."""

    dt: float
    window: float
    crowd: float
    visible: float
    birth: float
    contrast: float
    claim: float
    tau_peak: float
    gain: float
    drift: float
    young: float
    young_gain: float
    young_drift: float
    updates: float
    reach: float
    fastest: float
    aim: float
    aimed: float
    slow: float
    confirm: float
    blind: float
    lost: float
    same: float
    near: float
    known: float
    alike: float
    alike_speed: float
    tau_high: float
    tau_bind: float
    tau_light: float
