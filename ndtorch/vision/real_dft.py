"""Filters in the frequency domain by real matrices, for programs that know no complex numbers, such as ONNX."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from ndtorch.vision.decimation import low_rows


class RealFilter(nn.Module):
    """Images times a spectrum and back, `irfft2(rfft2(x) * spectrum)`, by products of real matrices.

    A transform of n points takes n^2 sums: it is exact, and slower than an FFT.

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
            "rows": low_rows(torch.fft.fft(torch.eye(size[0], dtype=torch.float64), dim=0), grid[0]),
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
