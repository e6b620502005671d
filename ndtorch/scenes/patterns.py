"""Stimuli of visual physiology by formulas of place and time: gratings, edges, flashes, discs, dots, pictures.

Places are pixels right of and above the middle of the image, directions degrees counter-clockwise as seen: 0 right, 90
up. A number of a stimulus may be a list or tensor `[B]` or `[A, B]`, for a batch of scenes; all of them broadcast.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, TypedDict, Unpack

import numpy.typing as npt
import torch
from torch import Tensor

from ndtorch.arguments import check_number
from ndtorch.errors import InputError
from ndtorch.scenes.base import PerBar, PerScene, RenderedScene, check_seed, numbers

Profile = Literal["sine", "square"]
Light = Callable[[Tensor, Tensor, Tensor], Tensor]
"""Luminance 0..1 at x `[W]`, y `[H, 1]` and a time `[]`, float64; what it returns broadcasts to `[..., C, H, W]`."""


class Screen(TypedDict, total=False):
    """What all stimuli take: seconds (5), fps (100), size (height and width, (100, 100) pixels), channels (3, or 1 for
    grey frames) and device (to which frames are moved)."""

    seconds: float
    fps: float
    size: tuple[int, int]
    channels: int
    device: torch.device | str


class Pattern(RenderedScene):
    """A scene by a formula.

    Args:
        name: short name, fit for a folder name.
        light: luminance at a place and a time, see `Light`; what is outside 0..1 is clipped.
        screen: see `Screen`.

    Shapes:
        frames `[..., T, C, H, W]`.

    >>> ramp = Pattern("ramp", lambda x, y, t: (x + 50) / 100 * t, seconds=1.0)
    >>> ramp.frames(0, 10).shape
    torch.Size([10, 3, 100, 100])
    """

    def __init__(self, name: str, light: Light, **screen: Unpack[Screen]) -> None:
        self.light, self.channels = light, screen.get("channels", 3)
        if self.channels not in (1, 3):
            raise InputError(f"channels must be 1 or 3, got {self.channels!r}")
        size, fps, device = screen.get("size", (100, 100)), screen.get("fps", 100.0), screen.get("device", "cpu")
        super().__init__(name, screen.get("seconds", 5.0), fps, size, device)
        height, width = self.size
        self.x = torch.arange(width, dtype=torch.float64) - (width - 1) / 2
        self.y = (height - 1) / 2 - torch.arange(height, dtype=torch.float64)[:, None]
        self.frames(0, 1)  # what does not fit is found now

    def frames(self, start: int, stop: int) -> Tensor:
        # A frame at a time: so its numbers do not depend on the chunk that it is in.
        times = torch.arange(start, stop, dtype=torch.float64) / self.fps
        images = [self.light(self.x, self.y, time).clamp(0, 1) for time in times]
        shape = (self.channels, *self.size)
        each = [image.broadcast_to(*image.shape[:-3], *shape) for image in images]
        return torch.stack(each, -4).to(self.device, torch.get_default_dtype())


def number(name: str, value: PerBar, least: float | None = None, above: float | None = None) -> Tensor:
    """A number of each scene, `[..., 1, 1, 1]`."""
    found = numbers(name, value, 2)
    if (least is not None and bool((found < least).any())) or (above is not None and bool((found <= above).any())):
        raise InputError(f"{name} must be {'>=' if above is None else '>'} {least if above is None else above:g}")
    return found[..., None, None, None]


def along(direction: PerBar) -> Callable[[Tensor, Tensor], Tensor]:
    """The coordinate of a place along a direction."""
    angle = torch.deg2rad(number("direction", direction))
    cosine, sine = angle.cos(), angle.sin()
    return lambda x, y: x * cosine + y * sine


def wave(cycles: Tensor, profile: Profile, duty: float = 0.5, pixel: Tensor | float = 0.0) -> Tensor:
    """A sine, or a square wave that is 1 for the share `duty` of a cycle and else -1, from -1 to 1; of the latter the
    mean over a pixel, in cycles."""
    if profile == "sine":
        return (2 * math.pi * cycles).sin()
    if profile != "square":
        raise InputError(f"profile must be sine or square, got {profile!r}")
    check_number("duty", duty, least=0)

    def bright_until(z: Tensor) -> Tensor:
        return z.floor() * duty + (z - z.floor()).clamp(max=duty)

    if isinstance(pixel, Tensor):
        return 2 * (bright_until(cycles + pixel / 2) - bright_until(cycles - pixel / 2)) / pixel - 1
    return 2.0 * ((cycles + 1e-9) % 1 < duty) - 1


def grating(
    wavelength: PerBar = 20.0,
    temporal_frequency: PerBar = 2.0,
    direction: PerBar = 0.0,
    contrast: PerBar = 1.0,
    *,
    profile: Profile = "sine",
    duty: float = 0.5,
    phase: PerBar = 0.0,
    mean: float = 0.5,
    **screen: Unpack[Screen],
) -> Pattern:
    """A drifting grating, `mean (1 + contrast sin(2 pi (u / wavelength - temporal_frequency t) + phase))`.

    Args:
        wavelength: spatial, pixels a cycle.
        temporal_frequency: cycles a second at a place; the speed is `wavelength temporal_frequency`.
        direction: of motion, degrees; u is the place along it.
        contrast: Michelson, 0..1.
        profile, duty: "square" is bright for that share of a cycle, averaged over a pixel along u. [A Methods]
        phase: degrees at the middle of the image.
        mean: luminance halfway between dark and bright.
        screen: see `Screen`.

    >>> grating(wavelength=[10.0, 20.0], seconds=1.0).frames(0, 2).shape
    torch.Size([2, 2, 3, 100, 100])
    """
    length, rate = number("wavelength", wavelength, above=0), number("temporal_frequency", temporal_frequency)
    u, shift, depth = along(direction), number("phase", phase) / 360, number("contrast", contrast)
    return Pattern(
        "grating",
        lambda x, y, t: mean * (1 + depth * wave(u(x, y) / length - rate * t + shift, profile, duty, 1 / length)),
        **screen,
    )


def counterphase_grating(
    wavelength: PerBar = 20.0,
    temporal_frequency: PerBar = 2.0,
    direction: PerBar = 0.0,
    contrast: PerBar = 1.0,
    *,
    phase: PerBar = 0.0,
    mean: float = 0.5,
    **screen: Unpack[Screen],
) -> Pattern:
    """A standing grating whose contrast reverses, `mean (1 + contrast sin(2 pi u / wavelength + phase) cos(2 pi
    temporal_frequency t))`. Arguments as of `grating`; `direction` is across its bars."""
    length, rate = number("wavelength", wavelength, above=0), number("temporal_frequency", temporal_frequency)
    u, shift, depth = along(direction), number("phase", phase) / 360, number("contrast", contrast)
    return Pattern(
        "counterphase-grating",
        lambda x, y, t: mean * (1 + depth * wave(u(x, y) / length + shift, "sine") * (2 * math.pi * rate * t).cos()),
        **screen,
    )


def plaid(
    wavelength: PerBar = 20.0,
    temporal_frequency: PerBar = 2.0,
    direction: PerBar = 0.0,
    contrast: PerBar = 1.0,
    *,
    angle: PerBar = 90.0,
    phase: PerBar = 0.0,
    mean: float = 0.5,
    **screen: Unpack[Screen],
) -> Pattern:
    """The mean of two drifting sine gratings whose directions are `angle` degrees apart, half of it at each side of
    `direction`. Arguments as of `grating`."""
    half, middle = numbers("angle", angle, 2) / 2, numbers("direction", direction, 2)
    both = [
        grating(wavelength, temporal_frequency, middle + side, contrast, phase=phase, mean=mean, **screen)
        for side in (half, -half)
    ]
    return Pattern("plaid", lambda x, y, t: (both[0].light(x, y, t) + both[1].light(x, y, t)) / 2, **screen)


def edge(
    polarity: Literal["on", "off"] = "on",
    speed: PerBar = 50.0,
    direction: PerBar = 0.0,
    contrast: PerBar = 1.0,
    *,
    mean: float = 0.5,
    **screen: Unpack[Screen],
) -> Pattern:
    """An edge that crosses the image once, from its border on: behind an "on" edge it is bright, behind an "off" edge
    dark.

    Args:
        speed: pixels a second.
        direction: of motion, degrees.
        contrast: Michelson, 0..1.
        mean: luminance halfway between dark and bright.
        screen: see `Screen`.
    """
    if polarity not in ("on", "off"):
        raise InputError(f"polarity must be on or off, got {polarity!r}")
    height, width = screen.get("size", (100, 100))
    angle = torch.deg2rad(number("direction", direction))
    begin = -(width * angle.cos().abs() + height * angle.sin().abs()) / 2
    u, pace, depth = along(direction), number("speed", speed), number("contrast", contrast)
    depth = depth if polarity == "on" else -depth
    return Pattern(
        f"{polarity}-edge",
        lambda x, y, t: mean * (1 + depth * (2 * (begin + pace * t - u(x, y) + 0.5).clamp(0, 1) - 1)),
        **screen,
    )


def flash(
    start: PerBar = 1.0, duration: PerBar = 0.1, contrast: PerBar = 1.0, *, mean: float = 0.5, **screen: Unpack[Screen]
) -> Pattern:
    """A flash of the whole field: `mean (1 + contrast)` from `start` for `duration` seconds, else `mean`; dark where
    the contrast (Weber) is negative."""
    begin, length, depth = number("start", start), number("duration", duration, least=0), number("contrast", contrast)

    def light(x: Tensor, y: Tensor, t: Tensor) -> Tensor:
        since = t - begin + 1e-9  # the first frame may be a rounding before
        return mean * (1 + depth * ((since >= 0) & (since < length)))

    return Pattern("flash", light, **screen)


def flicker(
    temporal_frequency: PerBar = 2.0,
    contrast: PerBar = 1.0,
    *,
    profile: Profile = "sine",
    duty: float = 0.5,
    mean: float = 0.5,
    **screen: Unpack[Screen],
) -> Pattern:
    """Flicker of the whole field, `mean (1 + contrast sin(2 pi temporal_frequency t))`, or a square wave that is bright
    for the share `duty` of a cycle."""
    rate, depth = number("temporal_frequency", temporal_frequency), number("contrast", contrast)
    return Pattern("flicker", lambda x, y, t: mean * (1 + depth * wave(rate * t, profile, duty)), **screen)


def looming_disc(
    lv: PerBar = 0.05,
    collision: PerScene | None = None,
    contrast: PerBar = -1.0,
    *,
    receding: bool = False,
    pixels_per_degree: float = 1.0,
    mean: float = 0.5,
    **screen: Unpack[Screen],
) -> Pattern:
    """A disc that approaches at constant speed, whose angular size is `2 atan(lv / (collision - t))`.

    Args:
        lv: half of its size over its speed, l/v, seconds.
        collision: when it would touch the eye, seconds; at the end by default. From then on it covers 180 degrees.
        contrast: Weber, of the disc against the ground.
        receding: the same film from its end to its start.
        pixels_per_degree: of visual angle, everywhere in the image.
        mean: luminance of the ground.
        screen: see `Screen`.
    """
    check_number("pixels_per_degree", pixels_per_degree, above=0)
    end = screen.get("seconds", 5.0)
    ratio, touch = number("lv", lv, above=0), number("collision", end if collision is None else collision)
    depth = number("contrast", contrast)

    def light(x: Tensor, y: Tensor, t: Tensor) -> Tensor:
        left = touch - (end - t if receding else t)
        radius = torch.atan2(ratio, left.clamp(min=0)).rad2deg() * pixels_per_degree
        return mean * (1 + depth * (radius - torch.hypot(x, y) + 0.5).clamp(0, 1))

    return Pattern("receding-disc" if receding else "looming-disc", light, **screen)


def random_dots(
    dots: int = 100,
    speed: PerBar = 50.0,
    direction: PerBar = 0.0,
    coherence: float = 1.0,
    *,
    lifetime: float | None = None,
    side: float = 3.0,
    contrast: float = 1.0,
    mean: float = 0.5,
    seed: int = 0,
    **screen: Unpack[Screen],
) -> Pattern:
    """Square dots that move together, wrapping around the edges; the rest of them moves as fast in random directions.

    Args:
        dots: number of dots.
        speed, direction: pixels a second, degrees.
        coherence: share of the dots that move in `direction`, 0..1.
        lifetime: seconds after which a dot appears at another place; None for never.
        side: of a dot, pixels.
        contrast: Weber, of a dot against the ground of luminance `mean`.
        seed: of places and directions.
        screen: see `Screen`.
    """
    check_seed(seed)
    check_number("dots", dots, above=0, whole=True)
    for name, value in (("coherence", coherence), ("side", side), ("lifetime", lifetime or 1.0)):
        check_number(name, value, least=0)
    height, width = screen.get("size", (100, 100))
    noise, life = torch.Generator().manual_seed(seed), lifetime or math.inf
    lives = 1 + math.ceil(screen.get("seconds", 5.0) / life)
    places = torch.rand(2, lives, dots, generator=noise, dtype=torch.float64)
    age, turn = torch.rand(2, dots, generator=noise, dtype=torch.float64)
    age = age * life if lifetime else torch.zeros(dots)
    own = number("direction", direction)[..., 0, 0] + 360 * turn * (torch.arange(dots) >= round(coherence * dots))
    pace, angle, each = number("speed", speed)[..., 0, 0], torch.deg2rad(own), torch.arange(dots)

    def covered(place: Tensor, pixels: Tensor, length: int) -> Tensor:
        away = (place[..., None] - pixels + length / 2) % length - length / 2
        return (side / 2 + 0.5 - away.abs()).clamp(0, min(1.0, side))

    def light(x: Tensor, y: Tensor, t: Tensor) -> Tensor:
        life_number = ((t + age) / life).long() if lifetime else torch.zeros(dots, dtype=torch.long)
        since = t - (life_number * life - age).clamp(min=0) if lifetime else t
        across = places[0, life_number, each] * width + pace * since * angle.cos()
        up = places[1, life_number, each] * height + pace * since * angle.sin()
        cover = covered(up, y[:, 0], height).mT @ covered(across, x, width)
        return mean * (1 + contrast * cover.clamp(max=1))[..., None, :, :]

    return Pattern("random-dots", light, **screen)


def panned_picture(
    picture: str | Path | Tensor | npt.NDArray[Any] | None = None,
    speed: PerBar = 50.0,
    direction: PerBar = 0.0,
    *,
    seed: int = 0,
    **screen: Unpack[Screen],
) -> Pattern:
    """A picture that moves past at constant speed and repeats at its edges, between pixels by linear interpolation.

    Args:
        picture: file, or `[C, H, W]` or `[H, W]` in 0..1 or uint8; None for noise of `seed` with the amplitude spectrum
            1/f of natural pictures, of the size of the screen.
        speed, direction: pixels a second, degrees.
        screen: see `Screen`.

    Raises:
        InputError: a file that is no picture.
    """
    image = pink_noise(screen.get("size", (100, 100)), seed) if picture is None else read_picture(picture)
    image = image if image.ndim == 3 else image[None]
    if screen.get("channels") == 1:
        image = image.mean(0, keepdim=True)
    angle, pace = torch.deg2rad(number("direction", direction)), number("speed", speed)

    def lines(place: Tensor, length: int) -> tuple[Tensor, Tensor, Tensor]:
        first = place.floor()
        return first.long() % length, (first.long() + 1) % length, place - first

    def light(x: Tensor, y: Tensor, t: Tensor) -> Tensor:
        # Column 0 of the picture is at the left border of the image at time 0.
        left, right, across = lines(x - x[0] - pace * t * angle.cos(), image.shape[-1])
        top, bottom, down = lines(y[0] - y + pace * t * angle.sin(), image.shape[-2])
        planes = torch.arange(len(image), device=image.device)[:, None, None]
        upper = torch.lerp(image[planes, top, left], image[planes, top, right], across)
        return torch.lerp(upper, torch.lerp(image[planes, bottom, left], image[planes, bottom, right], across), down)

    return Pattern("panned-picture", light, **screen)


def rings(
    sigma: float = 25.0,
    flicker: float = 0.5,
    ring_frequency: float = 0.2,
    ring_rate: float = 0.5,
    **screen: Unpack[Screen],
) -> Pattern:
    """Contracting rings under a Gaussian envelope, flickering, which train the first stage: they drive all directions,
    orientations and colors alike. [B eq. 25-27]

    `exp(-r² / (2 sigma²)) (1 + sin(2 pi flicker t)) / 2 (1 + cos(2 pi (ring_frequency r + ring_rate t))) / 2`, r the
    distance from the middle.

    Args:
        sigma: standard deviation of the envelope, pixels.
        flicker: cycles a second of the brightness.
        ring_frequency, ring_rate: rings a pixel, and rings a second that shrink into the middle.
        screen: see `Screen`.
    """
    check_number("sigma", sigma, above=0, unit="pixels")

    def light(x: Tensor, y: Tensor, t: Tensor) -> Tensor:
        r, turn = torch.hypot(x, y), 2 * math.pi
        brightness = (1 + (turn * flicker * t).sin()) / 4
        return (
            brightness * torch.exp(-(r**2) / (2 * sigma**2)) * (1 + (turn * (ring_frequency * r + ring_rate * t)).cos())
        )

    return Pattern("rings", light, **screen)


def pink_noise(size: tuple[int, int], seed: int) -> Tensor:
    """Noise `[H, W]` in 0..1 with an amplitude spectrum of 1/f, seamless at its edges."""
    check_seed(seed)
    white = torch.randn(size, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    frequency = torch.hypot(torch.fft.fftfreq(size[0]).double()[:, None], torch.fft.rfftfreq(size[1]).double())
    frequency[0, 0] = math.inf
    noise = torch.fft.irfft2(torch.fft.rfft2(white) / frequency, s=size)
    scaled: Tensor = (noise - noise.min()) / (noise.max() - noise.min()).clamp_min(1e-12)
    return scaled


def read_picture(picture: str | Path | Tensor | npt.NDArray[Any]) -> Tensor:
    """A picture as float64 in 0..1."""
    if isinstance(picture, str | Path):
        import cv2

        pixels = cv2.imread(str(picture), cv2.IMREAD_COLOR)
        if pixels is None:
            raise InputError(f"picture {picture} cannot be read")
        picture = pixels[..., ::-1].transpose(2, 0, 1).copy()
    image = torch.as_tensor(picture)
    return image.double() / 255 if image.dtype == torch.uint8 else image.double()
