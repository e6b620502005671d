"""The ten features as one would write them with NumPy, with SciPy's FFT or with OpenCV's filters."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
import scipy.fft

Array = np.ndarray[Any, np.dtype[np.float32]]


def kernels(size: int) -> Array:
    """The three DoG kernels, sampled on `size` x `size` pixels, `[3, size, size]`."""
    y, x = np.mgrid[:size, :size] - size // 2
    out = []
    for angle in np.deg2rad([0, 60, 120]):
        along = -x * math.sin(angle) - y * math.cos(angle)
        across = x * math.cos(angle) - y * math.sin(angle)
        center = np.exp(-(along**2) / (2 * 19**2) - across**2 / (2 * 6**2))
        surround = np.exp(-(along**2) / (2 * 22**2) - across**2 / (2 * 9**2))
        out.append(center / center.sum() - surround / surround.sum())
    return np.stack(out).astype(np.float32)


class NumpyFeatures:
    """Ten sums of one frame `[3, H, W]` after the other. `filters` is "fft" (SciPy) or "filter2d" (OpenCV)."""

    def __init__(self, size: int, filters: str, dt: float = 0.01) -> None:
        self.a_high, self.a_low = dt / (0.5 + dt), dt / (0.05 + dt)
        self.slow: Array | None = None
        self.delayed: Array | None = None
        self.filters = filters
        if filters == "fft":
            self.spectrum = scipy.fft.rfft2(np.fft.ifftshift(kernels(size), axes=(-2, -1)))
        else:
            # Three sigma: beyond that the kernels are empty.
            self.kernels = [np.ascontiguousarray(k[::-1, ::-1]) for k in kernels(133)]

    def __call__(self, frame: Array) -> Array:
        grey = frame.mean(0)
        if self.slow is None or self.delayed is None:
            self.slow, self.delayed = grey.copy(), np.zeros_like(grey)
        self.slow += self.a_high * (grey - self.slow)
        high = grey - self.slow
        self.delayed += self.a_low * (high - self.delayed)
        sums = []
        for axis in (1, 0):
            signed = np.roll(high, -1, axis) * self.delayed - high * np.roll(self.delayed, -1, axis)
            sums += [-signed[signed < 0].sum(), signed[signed > 0].sum()]
        left, right, up, down = sums
        if self.filters == "fft":
            responses = scipy.fft.irfft2(scipy.fft.rfft2(grey) * self.spectrum, s=grey.shape)
        else:
            padded = cv2.copyMakeBorder(grey, 66, 66, 66, 66, cv2.BORDER_WRAP)
            inner = (slice(66, -66), slice(66, -66))
            responses = np.stack([cv2.filter2D(padded, -1, kernel)[inner] for kernel in self.kernels])
        oriented = np.abs(responses).sum((1, 2))
        return np.array([left, right, down, up, *oriented, *frame.sum((1, 2))], dtype=np.float32)
