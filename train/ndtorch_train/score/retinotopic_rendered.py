"""What the retinotopic model sees of rendered bars that superposed scenes cannot show."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from ndtorch.binding import ObjectFiles
from ndtorch.binding.feedback import settled
from ndtorch.binding.object_files import ObjectFileParams
from ndtorch.scenes import Bar, BarScene, FrameSource
from ndtorch.scenes.rendered import RenderedScene
from ndtorch.vision import LocalFeatures, VisualFeatures
from ndtorch_train.score.choices import Split
from ndtorch_train.score.leaderboard import Row
from ndtorch_train.score.local_bars import FIELDS
from ndtorch_train.score.methods import first_stage
from ndtorch_train.score.metrics import score_scene
from ndtorch_train.score.retinotopic import NAME, features
from ndtorch_train.score.scenes import FPS, SIZE, Restriction, Scene, draw_scene, gains, seeds
from ndtorch_train.score.single_bars import LENGTH, SPEED, WIDTH, direction_degrees, orientation_degrees
from ndtorch_train.score.truth import by_group, present, true_features

SECONDS, RATE = 8.0, 50.0
"""Of a scene, and its frames a second."""

FIRST_SEED = 20_000_000
"""Of these sets: no other set has seeds from here on."""


@dataclass(frozen=True)
class LocalScenes:
    """A set of scenes.

    Attributes:
        name: for tables.
        texture: the ground is textured, else black.
        steady: the bars' brightness stays .6.
        speed: pixels a second.
        length, width: of the bars, pixels.
        cross: a grey cross stands before them, with arms of so many pixels; 0: none.
        stands: seconds for which the bars stand still after every 1.5 s of motion.
    """

    name: str
    texture: bool = False
    steady: bool = False
    speed: float = SPEED
    length: float = LENGTH
    width: float = WIDTH
    cross: int = 0
    stands: float = 0.0


SETS = (
    LocalScenes("textured ground", texture=True),
    LocalScenes("steady brightness", steady=True),
    LocalScenes("200 px/s", speed=200.0),
    LocalScenes("bars of 90 x 25", length=90.0, width=25.0),
    LocalScenes("behind an occluder", cross=60),
    LocalScenes("stop-and-go", stands=0.5),
)
GOES = 1.5
"""Seconds of motion between stops."""


def ground(seed: int, size: tuple[int, int] = SIZE) -> Tensor:
    """Smooth noise of .1 to .5, mostly grey, `[3, H, W]`; it goes on around the torus."""
    generator = torch.Generator().manual_seed(seed)
    grey, color = (torch.rand(1, n, *size, generator=generator) for n in (1, 3))
    around = torch.nn.functional.pad(0.7 * grey + 0.3 * color, (4, 4, 4, 4), mode="circular")
    smooth = torch.nn.functional.avg_pool2d(around, 9, 1)[0]
    return 0.1 + 0.4 * (smooth - smooth.amin()) / (smooth.amax() - smooth.amin())


class OnGround(RenderedScene):
    """The bars of a random scene over a ground, later ones over earlier ones."""

    def __init__(self, scene: Scene, kind: LocalScenes, seconds: float = SECONDS) -> None:
        super().__init__(f"{kind.name}-{scene.seed}", seconds, RATE, SIZE)
        self.scene, self.kind = scene, kind
        self.ground = ground(scene.seed) if kind.texture else torch.zeros(3, *SIZE)
        white = (1.0, 1.0, 1.0)
        self.covers = []
        for b in scene.bars:
            ways = direction_degrees(b.direction), b.start, orientation_degrees(b.orientation)
            bar = Bar(white, *ways, kind.speed, kind.length, kind.width)
            self.covers.append(BarScene([bar], seconds, fps=RATE, size=SIZE))

    def frames(self, start: int, stop: int) -> Tensor:
        """Frames `start` to `stop - 1`, `[T, 3, H, W]` float32 in 0..1."""
        canvas, every = self.ground.expand(stop - start, 3, *self.size), round(FPS / RATE)
        for bar, cover in zip(self.scene.bars, self.covers, strict=True):
            light = torch.from_numpy(bar.light[start * every : stop * every : every].copy())[:, None, None, None]
            light = torch.full_like(light, 0.6) if self.kind.steady else light
            when = moved(torch.arange(start, stop), self.kind.stands)
            shape = cover.frames(int(when[0]), int(when[-1]) + 1)[when - when[0]]
            canvas = torch.lerp(canvas, torch.tensor(bar.color)[:, None, None] * light, shape)
        if self.kind.cross:
            canvas = canvas.clone()
            for side in (-1, -2):
                middle = self.size[side] // 2
                canvas.narrow(side, middle - self.kind.cross // 2, self.kind.cross).fill_(0.3)
        return canvas


def moved(frames: Tensor, stands: float) -> Tensor:
    """For how many frames what goes `GOES` and stands `stands` seconds in turn has moved, at each frame `[T]`."""
    goes, both = round(GOES * RATE), round((GOES + stands) * RATE)
    return frames // both * goes + (frames % both).clamp_max(goes)


def truth_of(scene: Scene, kind: LocalScenes) -> Tensor:
    """Features of the bars, `[bars, 10]` bool: of what fluctuates, or of what is there where nothing does."""
    if not kind.steady:
        return true_features([scene], first_stage())[0]
    own = by_group(torch.stack([gains(bar) for bar in scene.bars]))
    return present(own @ settled(first_stage()).T)


def seen_in(source: FrameSource, params: ObjectFileParams | None = None) -> Tensor:
    """Features of the objects at the end, `[objects, 10]` bool."""
    eyes = LocalFeatures(VisualFeatures(source.size, 1 / source.fps), FIELDS)
    windows = ObjectFiles(eyes.grid, eyes.spacing, 1 / source.fps, params=params)
    seen = state = None
    with torch.inference_mode():
        for frames in source.chunks(10):
            signals, seen = eyes(frames, seen)
            _, state = windows(signals.unsqueeze(0), state)
    assert state is not None
    return features(windows, state)[0]


def rendered_local_rows(split: Split, scenes: int, sets: tuple[LocalScenes, ...] = SETS) -> Iterator[Row]:
    """All sets, a row each: one to three bars in turn."""
    for kind in sets:
        scores = []
        for seed in (FIRST_SEED + n for n in seeds(split, scenes)):
            scene = draw_scene(seed, Restriction(seed % 3 + 1))
            scores.append(score_scene(seen_in(OnGround(scene, kind)), truth_of(scene, kind)))
        yield Row(kind.name, NAME, True, SECONDS, scores)
