"""Masks of tracks, kept while a run goes on: they are small, but a day has millions, which go into a file."""

from __future__ import annotations

import tempfile
from array import array
from typing import Any

import numpy as np
import numpy.typing as npt
from torch import Tensor

from ndtorch.run.watchers import Watcher

IN_MEMORY = 2**26
"""Bytes after which masks are kept in a temporary file."""
FIELDS = 7
"""Numbers kept of every mask: track, step, top, left, height, width and place in the file."""


class MaskStore(Watcher):
    """The mask of every track at every step, packed; on a full disk those from then on are left out.

    Attributes:
        size: height and width of the working image, pixels; (0, 0) before the first step.
    """

    def __init__(self) -> None:
        self._file = tempfile.SpooledTemporaryFile(IN_MEMORY)  # noqa: SIM115  it lives as long as the store
        self._full = False
        self._index, self._times, self._end = array("q"), array("d"), 0
        self._found: dict[tuple[int, int], int] | None = None
        self.size = (0, 0)

    def signals(self, signals: Any, weights: Tensor, state: Any) -> None:
        if self._full or not hasattr(signals, "labels"):
            return
        for time, labels in zip(signals.time.tolist(), signals.labels.cpu().numpy(), strict=True):
            try:
                self.add(time, labels)
            except OSError:
                self._full = True
                return

    def add(self, time: float, labels: npt.NDArray[np.int32]) -> None:
        """Take the labels of a step, number of a track plus one at each pixel, `[h, w]`."""
        self.size = (labels.shape[0], labels.shape[1])
        step, self._found = len(self._times), None
        self._times.append(time)
        flat = labels.ravel()
        where = np.flatnonzero(flat)
        if len(where) == 0:
            return
        numbers, owner = np.unique(flat[where], return_inverse=True)
        rows, columns = np.divmod(where, labels.shape[1])
        for k, number in enumerate(numbers.tolist()):
            mine = owner == k
            own, across = rows[mine], columns[mine]
            top, bottom, left, right = int(own.min()), int(own.max()) + 1, int(across.min()), int(across.max()) + 1
            packed = np.packbits(labels[top:bottom, left:right] == number).tobytes()
            self._file.write(packed)
            self._index.extend((number - 1, step, top, left, bottom - top, right - left, self._end))
            self._end += len(packed)

    def close(self) -> None:
        """Let go of the file; masks can no longer be found."""
        self._file.close()

    def summary(self) -> tuple[int, float, float]:
        """Number of tracks, and in pixels of the working image their largest side and how far one got."""
        rows = np.array(self._index, np.int64).reshape(-1, FIELDS)
        if len(rows) == 0:
            return 0, 0.0, 0.0
        center = rows[:, 2:4] + rows[:, 4:6] / 2
        tracks = np.unique(rows[:, 0])
        spans = [float(np.hypot(*np.ptp(center[rows[:, 0] == track], axis=0))) for track in tracks[:1000]]
        return len(tracks), float(rows[:, 4:6].max()), max(spans)

    def find(self, track: int, time: float) -> tuple[int, int, npt.NDArray[np.bool_]] | None:
        """Top, left and pixels `[h, w]` of a track at a step, in the working image; None where it has none."""
        if self._found is None:
            rows = np.array(self._index, np.int64).reshape(-1, FIELDS)
            pairs = zip(rows[:, 0].tolist(), rows[:, 1].tolist(), strict=True)
            self._found = {pair: k for k, pair in enumerate(pairs)}
        step = int(np.searchsorted(np.frombuffer(self._times), time - 1e-6)) if self._times else 0
        if step >= len(self._times) or abs(self._times[step] - time) > 1e-6:
            return None
        k = self._found.get((track, step))
        if k is None:
            return None
        top, left, height, width, place = self._index[FIELDS * k + 2 : FIELDS * (k + 1)]
        self._file.seek(place)
        bits = np.unpackbits(np.frombuffer(self._file.read(-(-height * width // 8)), np.uint8), count=height * width)
        self._file.seek(self._end)
        return top, left, bits.reshape(height, width).astype(bool)
