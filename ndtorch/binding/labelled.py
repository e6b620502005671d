"""Signals as labelled arrays of xarray."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ndtorch.errors import InputError
from ndtorch.vision.features import FEATURES


def signal_dataset(time: Any, signals: Mapping[str, Any], units: Mapping[str, str]) -> Any:
    """An `xarray.Dataset` of signals `[..., T, 10]` with the names of `FEATURES`; dimensions before are trials.

    Args:
        time: seconds, `[T]`.
        signals: tensors or arrays by the names of the variables.
        units: of those that have some.

    Raises:
        InputError: xarray is not installed.
    """
    try:
        import xarray
    except ImportError:
        raise InputError("xarray is not installed; pip install 'ndtorch[xarray]'") from None
    variables = {}
    for name, signal in signals.items():
        array = signal.detach().cpu().numpy() if hasattr(signal, "detach") else np.asarray(signal)
        trials = [f"trial_{n}" if n else "trial" for n in range(array.ndim - 2)]
        variables[name] = ((*trials, "time", "signal"), array, {"units": units.get(name, "1")})
    coords = {"time": ("time", np.asarray(time), {"units": "s"}), "signal": list(FEATURES)}
    return xarray.Dataset(variables, coords=coords)
