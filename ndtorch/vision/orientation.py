"""Orientation by three oriented difference-of-Gaussian filters, applied in the frequency domain."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from ndtorch.arguments import Backend, FullPrecision, check_size, is_finite, without_autocast
from ndtorch.errors import InputError
from ndtorch.vision.frames import as_float, check_frames, grey, trial_by_trial
from ndtorch.vision.motion import Border, check_border

ANGLES: tuple[float, ...] = (0.0, 60.0, 120.0)
"""Preferred orientations in degrees, counter-clockwise from vertical. [B §2.1.2]"""

# Responses are summed over two grids, shifted by half a cell both ways: together they have twice the lines along
# rows and columns, where a single grid misses or hits a whole zero crossing of an upright edge at once.
OFFSETS = (0.0, 0.5)

# Pixels a side below which the grids are twice as fine, since few responses leave errors that do not average out, and
# below which they hold every pixel.
SMALL, TINY = 384, 96

Deviations = tuple[float, float] | Tensor
"""Standard deviations along and across the long axis of a filter, pixels."""


def dog_spectrum(
    rows: Tensor,
    columns: Tensor,
    angle: float,
    center: Deviations = (19.0, 6.0),
    surround: Deviations = (22.0, 9.0),
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

    def gaussian(sigma: Deviations) -> Tensor:
        return torch.exp(-2 * math.pi**2 * ((sigma[0] * along) ** 2 + (sigma[1] * across) ** 2))

    return gaussian(center) - gaussian(surround)


class OrientedDoG(FullPrecision):
    """Responses of three oriented DoG filters (0, 60 and 120 degrees) and the sums of their magnitudes.

    Two methods of summing. `exact=True` filters at full resolution. Otherwise the kernels' narrow band is used: no
    response holds anything finer than their smallest sigma, so rows and columns are halved (twice, for the published
    filters), higher frequencies are left out, and the responses are evaluated on two interleaved grids of about
    `0.9 sigma_min` pixels. The sums then differ from the exact ones by less than 0.5 % (0.1 % on average) at a tenth
    of the cost. Response images are always exact. [B §2.1.2]

    Args:
        size: height and width of the frames, pixels.
        angles: preferred orientations, degrees counter-clockwise from vertical.
        center, surround: standard deviations along and across the long axis, pixels: two numbers, or a tensor `[2]`,
            which as a `torch.nn.Parameter` is learned; then responses are summed exactly.
        border: "wrap" (toroidal scenes) or "reflect" (real video: the image is mirrored at its edges).
        exact: sum the full-resolution responses.

    Shapes:
        frames `[..., C, H, W]` with C = 3 or 1 and one leading dim or more -> `[..., 3, H, W]`, signed.
        No state: call it with whatever frames you have.

    >>> image = torch.zeros(1, 1, 100, 100)
    >>> image[..., 40:60, 49:52] = 1.0  # an upright bar
    >>> filtered = OrientedDoG((100, 100))(image)  # at 0, 60 and 120 degrees
    >>> filtered.shape, int(filtered.abs().sum((-2, -1)).argmax())
    (torch.Size([1, 3, 100, 100]), 0)
    """

    fixed_spectrum: Tensor
    fast_parts: Tensor
    kept_rows: Tensor
    row_frequencies: Tensor
    column_frequencies: Tensor
    exact_filter: RealFilter | None
    fast_filter: RealFilter | None
    row_weights: Tensor
    column_weights: Tensor
    backend: Backend = "auto"

    def __init__(
        self,
        size: tuple[int, int],
        angles: tuple[float, ...] = ANGLES,
        center: Deviations = (19.0, 6.0),
        surround: Deviations = (22.0, 9.0),
        border: Border = "wrap",
        exact: bool = False,
    ) -> None:
        super().__init__()
        check_border(border)
        self.learned = isinstance(center, Tensor) or isinstance(surround, Tensor)
        self.center, self.surround = center, surround
        pairs: Any = [pair.tolist() if isinstance(pair, Tensor) else pair for pair in (center, surround)]
        if not (isinstance(angles, tuple | list) and angles and all(map(is_finite, angles))):
            raise InputError(f"angles must be degrees, one or more, got {repr(angles)[:40]}")
        for name, pair in zip(("center", "surround"), pairs, strict=True):
            good = isinstance(pair, tuple | list) and len(pair) == 2 and all(is_finite(s) and s > 0 for s in pair)
            if not good:
                raise InputError(f"{name} must hold two positive standard deviations, got {repr(pair)[:40]}")
        check_size("size", size, 1)
        center, surround = pairs
        sigmas = (*center, *surround)
        self.size, self.border, self.exact = size, border, exact or self.learned
        self.exact_filter = self.fast_filter = None
        # Mirrored margins reach three sigma, but never further than there is image to mirror.
        wanted = 0 if border == "wrap" else math.ceil(3 * max(sigmas))
        self.margin = smooth_margin(size[0], wanted), smooth_margin(size[1], wanted)
        self.padded = (size[0] + 2 * self.margin[0], size[1] + 2 * self.margin[1])
        self.radians = radians = [math.radians(a) for a in angles]
        rows, columns = torch.fft.fftfreq(self.padded[0]), torch.fft.rfftfreq(self.padded[1])
        self.register_buffer("fixed_spectrum", self.full_spectrum(rows, columns, center, surround), persistent=False)
        self.register_buffer("row_frequencies", rows, persistent=False)
        self.register_buffer("column_frequencies", columns, persistent=False)

        side, spacing = max(self.padded), min(sigmas) / 1.08
        spacing = 1.0 if side < TINY else spacing / 2 if side < SMALL else spacing
        self.grid = tuple(smooth_length(math.ceil(n / spacing)) for n in self.padded)
        # How often a side can be halved while its samples stay within the spacing.
        halvings = [max(0, int(math.log2(min(spacing, n / g)))) for n, g in zip(self.padded, self.grid, strict=True)]
        self.blocks = math.gcd(self.padded[0], 2 ** halvings[0]), math.gcd(self.padded[1], 2 ** halvings[1])
        # What becomes of an image before `sums_of_thinned` takes it.
        self.thinning = Thinning(size, (1, 1), (0, 0))
        if not self.exact:
            left = self.padded[0] // self.blocks[0], self.padded[1] // self.blocks[1]
            self.thinning = Thinning(left, self.blocks, self.margin)
        # Both grids can be one, but for a small one, where some frequencies are their own mirror images.
        rows = torch.fft.fftfreq(self.grid[0]) * (self.grid[0] / self.padded[0])
        columns = columns[: self.grid[1] // 2 + 1]
        fast = torch.stack([dog_spectrum(rows[:, None], columns, a, center, surround) for a in radians])
        for frequencies, block in ((rows[:, None], self.blocks[0]), (columns, self.blocks[1])):
            fast = fast / thinning_gain(frequencies, block).clamp_min(0.01)
        # A frequency that is its own mirror image on the coarse grid stands for two on the fine one.
        for g, n, dim in zip(self.grid, self.padded, (-2, -1), strict=True):
            if g < n and g % 2 == 0:
                fast.narrow(dim, g // 2, 1).zero_()
        cells = [n / g for n, g in zip(self.padded, self.grid, strict=True)]
        # A line of samples and its mirror image, N - 1 - n for pixel n of N, are the same around -1/2, on it or half a
        # cell from it: the nearest to 0 of those, which is 0 where every pixel is a sample.
        self.starts = [-0.5 + round(1 / cell) * cell / 2 for cell in cells]
        # The first of the thinned rows and columns lie in the middle of their blocks.
        down, across = (start - (block - 1) / 2 for start, block in zip(self.starts, self.blocks, strict=True))
        turns = [rows[:, None] * (cells[0] * o + down) + columns * (cells[1] * o + across) for o in OFFSETS]
        shifts = torch.stack([torch.polar(torch.ones_like(turn), 2 * math.pi * turn) for turn in turns])
        # In real numbers: `Module.to(dtype)` would take the imaginary parts away.
        spectrum = shifts.unsqueeze(1) * fast / len(OFFSETS)
        self.register_buffer("kept_rows", low_rows(self.padded[0] // self.blocks[0], self.grid[0]), persistent=False)
        self.register_buffer("fast_parts", torch.view_as_real(spectrum), persistent=False)
        lines = zip(self.padded, self.grid, self.margin, self.starts, cells, strict=True)
        for name, (n, g, m, start, cell) in zip(("row_weights", "column_weights"), lines, strict=True):
            weights = torch.stack([inside_weights(n, g, m, o + start / cell) for o in OFFSETS])
            self.register_buffer(name, weights.float(), persistent=False)

    def images(self, image: Tensor) -> Tensor:
        """Signed responses `[..., 3, H, W]` to grey images `[..., H, W]`, exact."""
        image = self._pad(image).unsqueeze(-3)
        response: Tensor
        if self.exact_filter is not None:
            response = self.exact_filter(image)
        else:
            response = torch.fft.irfft2(torch.fft.rfft2(image) * self.spectrum, s=self.padded)
        top, left = self.margin
        return response[..., top : top + self.size[0], left : left + self.size[1]]

    @property
    def spectrum(self) -> Tensor:
        """The filters in the frequency domain, `[3, h, w // 2 + 1]`; of learned deviations computed anew."""
        if not self.learned:
            return self.fixed_spectrum
        return self.full_spectrum(self.row_frequencies, self.column_frequencies, self.center, self.surround)

    def full_spectrum(self, rows: Tensor, columns: Tensor, center: Deviations, surround: Deviations) -> Tensor:
        """`dog_spectrum` of every angle. The highest frequency is its own mirror image: what a tilted filter does to it
        is the mean over both signs."""
        up, left = rows.where(rows > -0.5, -rows), columns.where(columns < 0.5, -columns)
        signs = [(r[:, None], c) for r in (rows, up) for c in (columns, left)]
        each = [torch.stack([dog_spectrum(*s, a, center, surround) for s in signs]).mean(0) for a in self.radians]
        return torch.stack(each)

    def use_real_arithmetic(self) -> None:
        """Filter by real matrices in place of FFTs from now on, for exporters that know no complex numbers; slower."""
        self.exact_filter = RealFilter(self.padded, self.spectrum.detach(), self.padded)
        if not self.exact:
            size = (self.padded[0] // self.blocks[0], self.padded[1] // self.blocks[1])
            self.fast_filter = RealFilter(size, torch.view_as_complex(self.fast_parts), (self.grid[0], self.grid[1]))

    def sums(self, image: Tensor) -> Tensor:
        """Sums over space of the magnitudes, `[..., 3]`, of grey images `[..., H, W]`."""
        return self.sums_of_thinned(image if self.exact else self.thinned(image))

    def sums_of_thinned(self, images: Tensor) -> Tensor:
        """`sums` of grey images `[..., h, w]` that are mirrored and thinned already, see `thinning`."""
        if self.exact:
            return self.images(images).abs().sum((-1, -2))
        size = self.magnitudes_of_thinned(images)
        if self.border == "wrap":
            return size.sum((-4, -2, -1))
        rows, columns = self.row_weights.to(size.dtype), self.column_weights.to(size.dtype)
        return (rows[:, None, None] @ (size @ columns[:, None, :, None])).sum((-4, -2, -1))

    def thinned(self, image: Tensor) -> Tensor:
        """Grey images with their mirrored margins and fewer rows and columns, see `thinning`."""
        return thin_rows(thin_rows(self._pad(image), self.blocks[0]).mT, self.blocks[1]).mT

    def magnitudes_of_thinned(self, image: Tensor) -> Tensor:
        """Magnitudes on the two coarse grids, `[..., 2, 3, h, w]`, of images as of `thinned`.

        Every value stands for the pixels around its place (`places`): summed up they are the sums of `sums`.
        """
        if self.fast_filter is not None:
            fast: Tensor = self.fast_filter(image[..., None, None, :, :])
            return fast.abs()
        # At once in both directions: only so is the transform of an image the same to the bit in any batch.
        low = torch.fft.rfft2(image)[..., self.kept_rows, : self.grid[1] // 2 + 1][..., None, None, :, :]
        # irfft2 divides by the grid's points and a sum has that many fewer terms: the two cancel.
        size: Tensor = torch.fft.irfft2(low * torch.view_as_complex(self.fast_parts).to(low.dtype), s=self.grid).abs_()
        return size

    def places(self) -> tuple[Tensor, Tensor]:
        """Rows `[2, h]` and columns `[2, w]` of the coarse grids, in pixels of the frame; pixel n is at n + 1/2."""
        found = []
        for padded, points, margin, start in zip(self.padded, self.grid, self.margin, self.starts, strict=True):
            cell = padded / points
            found.append((torch.arange(points) + torch.tensor(OFFSETS)[:, None]) * cell + start - margin + 0.5)
        return found[0], found[1]

    @without_autocast
    def forward(self, frames: Tensor) -> Tensor:
        return self.responses(frames, None)[0]

    @trial_by_trial()
    def responses(self, frames: Tensor, _: None) -> tuple[Tensor, None]:
        return self.images(grey(as_float(check_frames(frames, self.size, device=self.fixed_spectrum.device)))), None

    def _pad(self, image: Tensor) -> Tensor:
        if self.border == "wrap":
            return image
        top, left = self.margin
        flat = image.reshape(-1, 1, *image.shape[-2:])
        padded = F.pad(flat, (left, left, top, top), mode="reflect")
        return padded.reshape(*image.shape[:-2], *self.padded)


class RealFilter(nn.Module):
    """Images times a spectrum and back, `irfft2(rfft2(x) * spectrum)`, by products of real matrices.

    For programs that know no complex numbers, such as ONNX: n^2 sums for n points, exact, and slower than an FFT.

    Args:
        size: height and width of the images.
        spectrum: complex or real, `[..., g0, g1 // 2 + 1]`, of the filters on a grid that is no larger than the images.
        grid: height and width of what comes out, (g0, g1). Frequencies that it cannot hold are left out.

    Shapes:
        `[..., *spectrum's leading dims or 1, h, w]` broadcast as a product -> `[..., g0, g1]`.
    """

    def __init__(self, size: tuple[int, int], spectrum: Tensor, grid: tuple[int, int]) -> None:
        super().__init__()
        kept = spectrum.shape[-1]
        eye = torch.eye(kept, dtype=torch.complex128)
        matrices = {
            "columns": torch.fft.rfft(torch.eye(size[1], dtype=torch.float64))[:, :kept],
            "rows": torch.fft.fft(torch.eye(size[0], dtype=torch.float64), dim=0)[low_rows(size[0], grid[0])],
            "rows_back": torch.fft.ifft(torch.eye(grid[0], dtype=torch.float64), dim=0),
            "columns_back": torch.complex(torch.fft.irfft(eye, grid[1]), torch.fft.irfft(eye * 1j, grid[1])),
            "spectrum": spectrum.to(torch.complex128),
        }
        for name, matrix in matrices.items():
            self.register_buffer(f"{name}_real", matrix.real.float().contiguous(), persistent=False)
            self.register_buffer(f"{name}_imaginary", matrix.imag.float().contiguous(), persistent=False)

    def pair(self, name: str, like: Tensor) -> tuple[Tensor, Tensor]:
        """Real and imaginary part of a matrix, in the precision of `like`."""
        return tuple(self.get_buffer(f"{name}_{part}").to(like.dtype) for part in ("real", "imaginary"))  # type: ignore[return-value]

    def forward(self, images: Tensor) -> Tensor:
        columns, rows, back = (self.pair(name, images) for name in ("columns", "rows", "rows_back"))
        real, imaginary = images @ columns[0], images @ columns[1]
        real, imaginary = rows[0] @ real - rows[1] @ imaginary, rows[0] @ imaginary + rows[1] @ real
        one, other = self.pair("spectrum", images)
        real, imaginary = real * one - imaginary * other, real * other + imaginary * one
        real, imaginary = back[0] @ real - back[1] @ imaginary, back[0] @ imaginary + back[1] @ real
        one, other = self.pair("columns_back", images)
        return real @ one + imaginary @ other


class Thinning(NamedTuple):
    """An image with fewer rows and columns.

    Attributes:
        size: height and width of what is left, margins included.
        blocks: rows, and columns, that become one.
        margins: mirrored rows above and below, and columns at both sides.
    """

    size: tuple[int, int]
    blocks: tuple[int, int]
    margins: tuple[int, int]


def thinning_gain(frequency: Tensor, block: int) -> Tensor:
    """Gain of `thin_rows` at frequencies in cycles per pixel; taking one line of each block divides it by `block`."""
    gain, step = (math.pi * frequency).cos() if block > 1 else torch.ones_like(frequency), 1
    while step < block:
        gain = gain * (math.pi * frequency * step).cos().square()
        step *= 2
    return gain


def thin_rows(image: Tensor, block: int) -> Tensor:
    """One row for each `block` rows of `[..., H, W]` (H a multiple of it, toroidal), at their middle.

    Weights fall off as a triangle from that middle over the length of a block: 1/4, 3/4, 3/4, 1/4 for two. The
    smoothing keeps what lies beyond the new Nyquist frequency from folding back onto the filters' band; and what is
    made of a mirror image is the mirror image of what is made.
    """
    if block == 1:
        return image
    away = (torch.arange(block, dtype=image.dtype, device=image.device) - (block - 1) / 2) / block
    weights = torch.stack([1 - away.abs(), away.clamp_min(0), (-away).clamp_min(0)])
    own, down, up = (weights @ image.reshape(*image.shape[:-2], -1, block, image.shape[-1])).unbind(-2)
    return own + down.roll(1, -2) + up.roll(-1, -2)


def smooth_margin(length: int, wanted: int) -> int:
    """Smallest margin >= `wanted` that makes `length + 2 margin` a product of 2, 3 and 5: a quick transform."""
    most = range(min(wanted, length - 1), length if wanted else 1)
    return next((margin for margin in most if smooth_length(length + 2 * margin) == length + 2 * margin), most.start)


def smooth_length(at_least: int) -> int:
    """Smallest n >= `at_least` that is a product of 2, 3 and 5: a quick transform."""
    n = max(1, at_least)
    while 30**20 % n:
        n += 1
    return n


def low_rows(length: int, rows: int) -> Tensor:
    """Numbers of the lowest `rows` of the frequencies of a line of `length`, in the order of a transform of `rows`."""
    negative = (rows - 1) // 2
    return torch.cat([torch.arange(rows - negative), torch.arange(length - negative, length)])


def inside_weights(length: int, points: int, margin: int, offset: float) -> Tensor:
    """Share of each of `points` equal cells over `length` that lies inside the margins, `[points]`.

    Pixel n covers n - 1/2 to n + 1/2 and a cell is centered on its sample; `offset` shifts samples, in cells.
    """
    cell = length / points
    middle = (torch.arange(points, dtype=torch.float64) + offset) * cell
    left, right = ((middle + half).clamp(margin - 0.5, length - margin - 0.5) for half in (-cell / 2, cell / 2))
    return (right - left) / cell
