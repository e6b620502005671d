"""Orientation by three oriented difference-of-Gaussian filters, applied in the frequency domain."""

from __future__ import annotations

import math

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from ndtorch.errors import InputError
from ndtorch.vision.frames import as_float, check_frames, grey
from ndtorch.vision.motion import Border, check_border

ANGLES: tuple[float, ...] = (0.0, 60.0, 120.0)


def dog_spectrum(
    rows: Tensor,
    columns: Tensor,
    angle: float,
    center: tuple[float, float] = (19.0, 6.0),
    surround: tuple[float, float] = (22.0, 9.0),
) -> Tensor:
    """Fourier transform of a difference of Gaussians with its long axis at `angle`. [B eq. 14-16]

    Each Gaussian has unit sum, so the kernel sums to zero and a uniform image gives no response. (The factor 2
    printed before `yr^2` in the surround of eq. 16 contradicts that and leaves the filters untuned; it is left
    out.) The transform of a Gaussian is a Gaussian: there is no kernel to sample and to cut off, and on a torus
    smaller than the kernel its tails wrap around.

    Args:
        rows, columns: frequencies down and to the right, cycles per pixel, any broadcastable shapes.
        angle: radians counter-clockwise as seen, 0 = vertical long axis.
        center, surround: standard deviations along and across the long axis, pixels.

    Returns:
        Real transform, in the shape that the frequencies broadcast to.
    """
    along = -columns * math.sin(angle) - rows * math.cos(angle)
    across = columns * math.cos(angle) - rows * math.sin(angle)

    def gaussian(sigma: tuple[float, float]) -> Tensor:
        return torch.exp(-2 * math.pi**2 * ((sigma[0] * along) ** 2 + (sigma[1] * across) ** 2))

    return gaussian(center) - gaussian(surround)


class OrientedDoG(nn.Module):
    """Responses of three oriented DoG filters (0, 60 and 120 degrees) and the sums of their magnitudes.

    Two ways of summing. `exact=True` filters at full resolution. Otherwise the kernels' narrow band is used: no
    response holds anything finer than their smallest sigma, so the image is halved (twice, for the published
    filters), and the responses are evaluated on a grid of about `sigma_min / 1.5` pixels. The sums then differ from
    the exact ones by less than 0.5 % at a tenth of the cost. Response images are always exact. [B §2.1.2]

    Args:
        size: height and width of the frames, pixels.
        angles: preferred orientations, degrees counter-clockwise from vertical.
        center, surround: standard deviations along and across the long axis, pixels.
        border: "wrap" (toroidal scenes) or "reflect" (real video: the image is mirrored at its edges).
        exact: sum the full-resolution responses.

    Shapes:
        frames `[..., C, H, W]` with C = 3 or 1 and one leading dim or more -> `[..., 3, H, W]`, signed.
        No state: call it with whatever frames you have.
    """

    spectrum: Tensor
    fast_spectrum: Tensor
    row_weights: Tensor
    column_weights: Tensor

    def __init__(
        self,
        size: tuple[int, int],
        angles: tuple[float, ...] = ANGLES,
        center: tuple[float, float] = (19.0, 6.0),
        surround: tuple[float, float] = (22.0, 9.0),
        border: Border = "wrap",
        exact: bool = False,
    ) -> None:
        super().__init__()
        check_border(border)
        sigmas = (*center, *surround)
        if min(sigmas) <= 0:
            raise InputError(f"the filters' standard deviations must be positive, got {sigmas}")
        self.size, self.border, self.exact = size, border, exact
        # Mirrored margins reach three sigma, but never further than there is image to mirror.
        wanted = 0 if border == "wrap" else math.ceil(3 * max(sigmas))
        self.margin = tuple(smooth_margin(n, wanted) for n in size)
        padded = (size[0] + 2 * self.margin[0], size[1] + 2 * self.margin[1])
        self.padded = padded
        spacing = min(sigmas) / 1.5
        self.halvings = tuple(halvings(n, spacing) for n in padded)
        reduced = tuple(n >> h for n, h in zip(padded, self.halvings, strict=True))
        self.grid = tuple(fast_length(math.ceil(n / spacing)) for n in padded)
        self.kept = tuple(min(r, g) for r, g in zip(reduced, self.grid, strict=True))
        radians = [math.radians(a) for a in angles]
        rows, columns = torch.fft.fftfreq(padded[0]), torch.fft.rfftfreq(padded[1])
        full = torch.stack([dog_spectrum(rows[:, None], columns, a, center, surround) for a in radians])
        rows = torch.fft.fftfreq(self.grid[0]) * (self.grid[0] / padded[0])
        columns = columns[: (self.kept[1] + 1) // 2]
        fast = torch.stack([dog_spectrum(rows[:, None], columns, a, center, surround) for a in radians])
        loss = halving_gain(rows, self.halvings[0])[:, None] * halving_gain(columns, self.halvings[1])
        # Beyond the band there is nothing to make up for, and the gain may be zero.
        fast = torch.where(loss > 0.01, fast / loss, 0.0)
        self.register_buffer("spectrum", full.float(), persistent=False)
        self.register_buffer("fast_spectrum", fast.float(), persistent=False)
        for name, n, g, m in zip(("row_weights", "column_weights"), padded, self.grid, self.margin, strict=True):
            self.register_buffer(name, inside_weights(n, g, m).float(), persistent=False)

    def extra_repr(self) -> str:
        return f"size={self.size}, border={self.border!r}, exact={self.exact}, grid={self.grid}"

    def images(self, image: Tensor) -> Tensor:
        """Signed responses `[..., 3, H, W]` to grey images `[..., H, W]`, exact."""
        spectrum = torch.fft.rfft2(self._pad(image)).unsqueeze(-3) * self.spectrum
        response: Tensor = torch.fft.irfft2(spectrum, s=self.padded)
        top, left = self.margin
        return response[..., top : top + self.size[0], left : left + self.size[1]]

    def sums(self, image: Tensor) -> Tensor:
        """Sums over space of the magnitudes, `[..., 3]`, of grey images `[..., H, W]`."""
        if self.exact:
            return self.images(image).abs().sum((-1, -2))
        response = self.coarse(image).abs_()
        # irfft2 divides by the grid's points and the sum has that many fewer terms: the two cancel.
        if self.border == "wrap":
            return response.sum((-1, -2))
        return (response @ self.column_weights.to(response.dtype)) @ self.row_weights.to(response.dtype)

    def coarse(self, image: Tensor) -> Tensor:
        """Responses on the coarse grid, `[..., 3, *grid]`, too large by pixels over grid points."""
        image = self._pad(image)
        for dim, times in ((-2, self.halvings[0]), (-1, self.halvings[1])):
            for _ in range(times):
                image = halve(image, dim)
        spectrum = resize_spectrum(torch.fft.rfft2(image), self.kept, self.grid[0]).unsqueeze(-3)
        response: Tensor = torch.fft.irfft2(spectrum * self.fast_spectrum, s=self.grid)
        return response

    def forward(self, frames: Tensor) -> Tensor:
        return self.images(grey(as_float(check_frames(frames, self.size))))

    def _pad(self, image: Tensor) -> Tensor:
        if self.border == "wrap":
            return image
        top, left = self.margin
        flat = image.reshape(-1, 1, *image.shape[-2:])
        padded = F.pad(flat, (left, left, top, top), mode="reflect")
        return padded.reshape(*image.shape[:-2], *self.padded)


def halvings(length: int, spacing: float) -> int:
    """How often a line of `length` can be halved while its samples stay within `spacing`."""
    times = 0
    while length % 2 == 0 and 2 ** (times + 1) <= spacing:
        length //= 2
        times += 1
    return times


def halving_gain(frequency: Tensor, times: int) -> Tensor:
    """Gain of `times` calls of `halve` at frequencies in cycles per pixel; taking every second line halves it."""
    gain = torch.ones_like(frequency)
    for i in range(times):
        gain = gain * (math.pi * frequency * 2**i).cos().square()
    return gain


def halve(image: Tensor, dim: int) -> Tensor:
    """Every second line along `dim` (-1 or -2; even length, toroidal), smoothed with weights 1/2, 1, 1/2 beforehand.

    The smoothing keeps what lies beyond the new Nyquist frequency from folding back onto the filters' band.
    """
    step = (slice(None, None, 2), slice(1, None, 2))
    even, odd = (image[..., s, :] if dim == -2 else image[..., s] for s in step)
    out = torch.add(even, odd, alpha=0.5)
    n = odd.shape[dim] - 1
    out.narrow(dim, 1, n).add_(odd.narrow(dim, 0, n), alpha=0.5)
    out.narrow(dim, 0, 1).add_(odd.narrow(dim, n, 1), alpha=0.5)
    return out


def smooth_margin(length: int, wanted: int) -> int:
    """Smallest margin >= `wanted` that makes `length + 2 margin` a product of 2, 3 and 5: a quick transform."""
    for margin in range(min(wanted, length - 1), length if wanted else 1):
        n = length + 2 * margin
        for factor in (2, 3, 5):
            while n % factor == 0:
                n //= factor
        if n == 1:
            return margin
    return min(wanted, length - 1)


def fast_length(at_least: int) -> int:
    """Smallest n >= `at_least` that is a quick FFT length: a power of 2, or 3 or 5 times one."""
    return min(f << max(0, math.ceil(math.log2(at_least / f))) for f in (1, 3, 5))


def resize_spectrum(spectrum: Tensor, kept: tuple[int, ...], rows: int) -> Tensor:
    """The `kept` lowest frequencies of a half spectrum `[..., H, W // 2 + 1]`, as one of `rows` rows.

    Rows in between are zero, and so is a frequency that would be its own mirror image.
    """
    positive, negative = (kept[0] + 1) // 2, (kept[0] - 1) // 2
    columns = spectrum[..., : (kept[1] + 1) // 2]
    middle = columns.new_zeros(*columns.shape[:-2], rows - positive - negative, columns.shape[-1])
    return torch.cat([columns[..., :positive, :], middle, columns[..., spectrum.shape[-2] - negative :, :]], -2)


def inside_weights(length: int, points: int, margin: int) -> Tensor:
    """Share of each of `points` equal cells over `length` that lies inside the margins, `[points]`.

    Pixel n covers n - 1/2 to n + 1/2 and a cell is centred on its sample.
    """
    cell = length / points
    middle = torch.arange(points, dtype=torch.float64) * cell
    low, high = margin - 0.5, length - margin - 0.5
    right = (middle + cell / 2).clamp(low, high)
    left = (middle - cell / 2).clamp(low, high)
    inside = (right - left) / cell
    return inside
