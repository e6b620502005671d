"""The ten features of a frame: motion in four directions, three orientations, three colors."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ndtorch.arguments import (
    Backend,
    FullPrecision,
    check_backend,
    check_size,
    check_state,
    has_values,
    kernels_wanted,
    without_autocast,
)
from ndtorch.errors import InputError
from ndtorch.utils.tensors import keep_freed_memory
from ndtorch.vision._kernels_frame import PassConstants, front_end
from ndtorch.vision.frames import as_float, check_frames, each_trial, grey
from ndtorch.vision.motion import Border, HassensteinReichardt, MotionState
from ndtorch.vision.orientation import Deviations, OrientedDoG
from ndtorch.vision.temporal import Discretization, Seconds, ratio

FEATURES: tuple[str, ...] = (
    "left",
    "right",
    "down",
    "up",
    "0°",
    "60°",
    "120°",
    "red",
    "green",
    "blue",
)
"""Names of the ten features, in the order used everywhere. [B §2]"""

GROUPS: dict[str, slice] = {"motion": slice(0, 4), "orientation": slice(4, 7), "color": slice(7, 10)}
"""Where each visual submodality lies among the ten."""

# Working sets beyond this many pixels leave a CPU's second-level cache, and every pass gets 2-4x slower.
CPU_PIXELS = 1 << 18
CUDA_PIXELS = 1 << 25


class VisualFeatures(FullPrecision):
    """Ten wide-field signals of a sequence of frames, and the images they are sums of. [B §2.1, fig. 1]

    `forward` gives the spatial sums, the input of the binding networks; `images` gives the feature images,
    the material of attention. Both advance the same state: use one or the other on a stream.

    Args:
        size: height and width of the frames in pixels.
        dt: seconds between frames.
        tau_high, tau_low: time constants of the motion detectors, seconds; as `torch.nn.Parameter` they are learned.
        border: "wrap" for toroidal scenes, "reflect" for real video.
        exact: sum the orientation responses at full resolution instead of on a coarse grid (see `OrientedDoG`).
        center, surround: deviations of the orientation filters along and across, pixels, see `OrientedDoG`.
        backend: "numba" takes the sums by kernels, "torch" by tensor operations, "auto" by kernels where no gradient
            is needed and the frames are on a CPU.
        discretization: of the motion detectors' filters, "euler" or "exact", see `smoothing_factor`.

    Shapes:
        frames `[..., T, C, H, W]` (C = 3 or 1; float 0..1 or uint8) -> `[..., T, 10]`, in the order of
        `FEATURES`. State: `MotionState`; `None` settles on the first frame.

    Raises:
        InputError: frames of another shape, size or type, or that hold NaN or infinite values.

    >>> sums, state = VisualFeatures(size=(100, 100))(torch.rand(8, 3, 100, 100))
    >>> sums.shape
    torch.Size([8, 10])
    """

    def __init__(
        self,
        size: tuple[int, int] = (500, 500),
        dt: float = 0.01,
        tau_high: Seconds = 0.5,
        tau_low: Seconds = 0.05,
        border: Border = "wrap",
        exact: bool = False,
        center: Deviations = (19.0, 6.0),
        surround: Deviations = (22.0, 9.0),
        *,
        backend: Backend = "auto",
        discretization: Discretization = "euler",
    ) -> None:
        super().__init__()
        check_size("size", size, 2)
        self.size = (int(size[0]), int(size[1]))
        self.backend = check_backend(backend)
        self.motion = HassensteinReichardt(dt, tau_high, tau_low, border, discretization=discretization)
        self.orientation = OrientedDoG(self.size, center=center, surround=surround, border=border, exact=exact)
        self.orientation.backend = self.backend
        keep_freed_memory()

    @without_autocast
    def forward(self, frames: Tensor, state: MotionState | None = None) -> tuple[Tensor, MotionState]:
        check_state(state, MotionState)
        frames = check_frames(frames, self.size, device=self.orientation.fixed_spectrum.device)
        return self._sums(frames, state)

    def _sums(self, frames: Tensor, state: MotionState | None) -> tuple[Tensor, MotionState]:
        batch = frames.shape[:-4]
        kernels = kernels_wanted(frames, *(state or ()), *self.parameters(), backend=self.backend)
        if batch and (kernels or (frames.is_cpu and 2 * frames.shape[-1] * frames.shape[-2] > CPU_PIXELS)):
            # One trial after the other: so kernels take them, and large frames do not leave the cache.
            start = state and MotionState(*(part.expand(*batch, *self.size) for part in state))
            sums, end = each_trial(self._sums, frames, start, frames.shape[-4])
            return sums, end
        kind = torch.float64 if frames.dtype == torch.float64 else torch.float32
        if kernels and (state is None or (state.slow.shape == self.size and state.slow.dtype == kind)):
            return self._one_pass(frames, state, kind)
        sums, pixels = [], CPU_PIXELS if frames.is_cpu else CUDA_PIXELS
        for some in torch.split(frames, max(1, pixels // frames[..., 0, 0, :, :].numel()), -4):
            block = as_float(some)
            # In this order, every plane is used while it is still in the cache.
            color = block.sum((-1, -2))
            image = grey(block)
            orientation = self.orientation.sums(image)
            high, delayed, state = self.motion.scan(image, state)
            sums.append(torch.cat([self.motion.sums(high, delayed), orientation, color], -1))
        assert state is not None
        out = sums[0] if len(sums) == 1 else torch.cat(sums, -2)
        if has_values(out) and not torch.isfinite(out).all():
            raise InputError("frames must be finite, got NaN or infinite values")
        return out, state

    def images(self, frames: Tensor, state: MotionState | None = None) -> tuple[Tensor, MotionState]:
        """Feature images `[..., T, 10, H, W]`, non-negative; their sums over space are what `forward` gives."""
        frames = as_float(check_frames(frames, self.size, device=self.orientation.fixed_spectrum.device))
        image = grey(frames)
        high, delayed, state = self.motion.scan(image, state)
        motion = self.motion.images(high, delayed)
        return torch.cat([motion, self.orientation.images(image).abs(), frames], -3), state

    def images_at(self, frame: Tensor, state: MotionState) -> Tensor:
        """Feature images `[..., 10, H, W]` of one frame `[..., C, H, W]`, given the state right after it.

        For pictures of every n-th frame of a stream that otherwise only needs its sums.
        """
        frame = as_float(check_frames(frame.unsqueeze(-4), self.size)).squeeze(-4)
        image = grey(frame)
        motion = self.motion.images(image - state.slow, state.delayed)
        return torch.cat([motion, self.orientation.images(image).abs(), frame], -3)

    def _one_pass(self, frames: Tensor, state: MotionState | None, kind: torch.dtype) -> tuple[Tensor, MotionState]:
        """The sums of `[T, 3, H, W]` by kernels: the motion, the colors and thinned grey images in one pass."""
        motion, o, unit = self.motion, self.orientation, 1.0 if frames.is_floating_point() else 1 / 255
        after = MotionState(torch.empty(self.size, dtype=kind), torch.empty(self.size, dtype=kind))
        if state is not None:
            after.slow.copy_(state.slow)
            after.delayed.copy_(state.delayed)
        high, low = (float(ratio(tau, motion.dt, motion.discretization)) for tau in (motion.tau_high, motion.tau_low))
        constants = PassConstants(high, low, motion.border == "wrap", o.thinning.blocks[0], o.thinning.margins)
        # In double precision one at a time: some transforms of several are not the same to the bit as of one.
        together = 1 if kind == torch.float64 else max(1, (1 << 17) // math.prod(o.thinning.size))
        passed, oriented = torch.empty(len(frames), 7, dtype=torch.float64), list[Tensor]()
        for some, sums in zip(torch.split(frames, together), torch.split(passed, together), strict=True):
            last = some.movedim(-3, -1)
            beside = not some.is_contiguous() and last.is_contiguous()
            pixels = (last if beside else some.contiguous()).numpy()
            images = torch.empty(len(some), *o.thinning.size, dtype=kind)
            states, settle = (after.slow.numpy(), after.delayed.numpy()), state is None and not oriented
            front_end.run(pixels, beside, unit, settle, *states, constants, images.numpy(), sums.numpy())
            oriented.append(o.sums_of_thinned(images))
        moved = (passed[:, :4] @ motion.directions.double()).clamp_min(0)
        out = torch.cat([moved.to(kind), torch.cat(oriented), passed[:, 4:].to(kind)], -1)
        if not torch.isfinite(out).all():
            raise InputError("frames must be finite, got NaN or infinite values")
        return out, after
