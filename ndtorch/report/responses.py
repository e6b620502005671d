"""Responses over time: a table with a row a step of the network, and labelled arrays."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from torch import Tensor

from ndtorch.arguments import check_kind
from ndtorch.binding.models.whole_field import BindingSignals
from ndtorch.run.watchers import Watcher
from ndtorch.utils.packages import need
from ndtorch.vision.features import FEATURES

NAMES = tuple(name.replace("°", "deg") for name in FEATURES)
READ_EVERY = 1.0
"""Seconds between rows with weights, number of objects and confidence."""


class ResponseFile(Watcher):
    """responses.parquet: time, ten inputs and ten outputs of every step of a model over the whole field.

    About once a second a row also has the weights `[10, 10]`, row after row, the number of objects and its confidence;
    these are null in other rows.

    Args:
        path: the file, written as the run goes.
        model: the model that runs.

    Attributes:
        trouble: why nothing was written any more, which does not end the run.
    """

    def __init__(self, path: Path, model: Any) -> None:
        import pyarrow
        import pyarrow.parquet

        single = pyarrow.float32()
        fields = [(f"{kind}_{name}", single) for kind in ("input", "output") for name in NAMES]
        read = [("weights", pyarrow.list_(single, 100)), ("objects", pyarrow.int32()), ("confidence", single)]
        self.schema = pyarrow.schema([("time", pyarrow.float64()), *fields, *read])
        self.model, self.due = model, 0.0
        self.trouble: OSError | None = None
        try:
            self.writer = pyarrow.parquet.ParquetWriter(path, self.schema)
        except OSError as error:
            self.trouble = error

    def signals(self, signals: Any, weights: Tensor, state: Any) -> None:
        import pyarrow

        steps = len(signals.time)
        if self.trouble is not None or not steps:
            return
        time = signals.time.cpu().double().numpy()
        columns = [time]
        for values in (signals.inputs, signals.outputs):
            columns += list(values.cpu().float().numpy().T)
        read: list[list[Any]] = [[None] * steps for _ in range(3)]
        if time[-1] >= self.due:
            self.due = float(time[-1]) + READ_EVERY
            confidence = self.model.confidence(state)
            read[0][-1] = weights.cpu().float().flatten().tolist()
            read[1][-1], read[2][-1] = len(self.model.objects(state)), confidence
        try:
            self.writer.write_table(pyarrow.table([*columns, *read], schema=self.schema))
        except OSError as error:
            self.trouble = error

    def close(self) -> None:
        """Write the end of the file."""
        try:
            if self.trouble is None:
                self.writer.close()
        except OSError as error:
            self.trouble = error


def to_xarray(signals: BindingSignals) -> Any:
    """Signals of a model as an `xarray.Dataset` with dimensions trial, time and feature.

    Args:
        signals: of one trial, `[T', 10]` each, or of several, `[B, T', 10]`.

    Returns:
        Variables `sums`, `inputs`, `refined` and `outputs`; coordinates `time` in seconds and `feature` by name.

    Raises:
        InputError: signals of another kind of model, or xarray is not installed.
    """
    check_kind("signals", signals, BindingSignals)
    xarray = need("xarray", "to_xarray")
    variables = {}
    for name in ("sums", "inputs", "refined", "outputs"):
        values = getattr(signals, name).detach().cpu().numpy()
        variables[name] = (("trial", "time", "feature"), values.reshape(-1, *values.shape[-2:]))
    coordinates = {"time": np.asarray(signals.time.detach().cpu()), "feature": list(FEATURES)}
    return xarray.Dataset(variables, coordinates)
