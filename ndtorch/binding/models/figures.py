"""The model figures: what stands out from the ground becomes a receptive field of its own, followed as one object."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ndtorch.arguments import check_dense, check_state
from ndtorch.binding.models.contract import BindingModel, Nested, Verdict, states_of
from ndtorch.binding.models.figures_memory import Memory
from ndtorch.binding.models.figures_state import FiguresConfig, FiguresSignals, FiguresState
from ndtorch.binding.network import InhibitoryNetwork
from ndtorch.binding.normalise import FieldInputs
from ndtorch.binding.objects import BoundObject
from ndtorch.binding.readout.owners import features_by_group
from ndtorch.binding.tracking.far_away import tiny, without_pieces
from ndtorch.binding.tracking.figures import Figure, figures_of, table_of
from ndtorch.binding.tracking.following import follow
from ndtorch.binding.tracking.many import comings
from ndtorch.binding.tracking.regions import Bytes, Floats, holes, parted, regions_of, still_of
from ndtorch.binding.tracking.restless import come_and_gone
from ndtorch.binding.tracking.shades import Light, shade_of
from ndtorch.binding.tracking.silhouettes import marked, told
from ndtorch.errors import InputError
from ndtorch.vision.camera.figure_signals import FigureSignals, Sensed
from ndtorch.vision.camera.figures import ground_start, ground_step, learn, square
from ndtorch.vision.camera.shrunk import shrunk
from ndtorch.vision.features import FEATURES, GROUPS
from ndtorch.vision.frames import check_frames


class FiguresModel(BindingModel):
    """Objects over time, with places, boxes and silhouettes, in video of a camera that does not move.

    A batch of films goes through one after the other; its state is a tuple of their states.

    Args:
        config: constants.

    Shapes:
        frames `[..., T, C, H, W]` -> `FiguresSignals`, `FiguresState`.
    """

    name = "figures"
    exportable = False  # regions are found outside torch
    config_type = FiguresConfig
    tracks = True
    trained = False
    config: FiguresConfig

    def __init__(self, config: FiguresConfig | None = None) -> None:
        super().__init__()
        c = self.config = config or FiguresConfig()
        n = c.network
        self.group = max(1, math.ceil(c.fps / c.fastest))
        self.dt, self.settle = self.group / c.fps, 0.0
        # Shrinking by a whole number is quick.
        shrink = math.ceil(c.size[0] / c.ground.height)
        self.small = (max(16, c.size[0] // shrink // 4 * 4), max(16, c.size[1] // shrink // 4 * 4))
        self.fields = FigureSignals(self.small, self.dt, c.fields)
        self.normalise = FieldInputs(self.dt, c.normalise.memory, c.normalise.floor)
        self.network = InhibitoryNetwork(
            10,
            self.dt,
            n.learning_rule() if n.learn else None,
            "settled",
            shared=True,
            tau_in=math.inf,
            tau_out=n.tau_out,
            tau_power=n.tau_power,
            settle=self.settle,
            faint=n.quiet,
        )

    @classmethod
    def build(cls, config: FiguresConfig, first_stage: Tensor | None) -> FiguresModel:
        return cls(config)

    def forward(self, frames: Tensor, state: Any = None) -> tuple[FiguresSignals, Any]:
        check_dense("frames", frames)
        if frames.ndim > 4:
            return self._each(frames, state)
        if frames.ndim != 4:
            raise InputError(f"frames must have shape [T, C, H, W], got {tuple(frames.shape)}")
        frames = check_frames(frames, self.size)
        if frames.requires_grad and torch.is_grad_enabled():
            raise InputError("figures has no gradients: detach the frames")
        check_state(state, FiguresState)
        state = self._start() if state is None else state
        seen = None if state.seen is None else Memory.of(state.seen)
        waiting, counted = state.waiting, int(state.frames)
        began, time = int(state.began), float(state.time)
        open_, closing = figures_of(state.open), list[Figure]()
        rows, shapes, masks, times, who, cuts = [], [], [], [], [], list[bool]()
        for k, frame in enumerate(frames):
            picture = shrunk(frame, self.small)
            if self.group > 1:
                waiting = waiting + torch.from_numpy(picture)
                if (counted + k + 1) % self.group:
                    continue
                picture, waiting = (waiting / self.group).numpy(), torch.zeros_like(waiting)
            time = (counted + k) / self.fps
            if seen is None:
                seen = Memory.blank(ground_start(picture, self.config.ground))
            sensed, mask, open_, late, began, cut = self._step(picture, seen, open_, time, began)
            closing += [one for one in late if one.known]
            rows.append(sensed)
            shapes.append(seen.silhouettes)
            masks.append(mask)
            times.append(time)
            cuts.append(cut)
            who.append([one for one in open_ if one.last_seen == time])
        inputs = outputs = torch.zeros(0, self.config.fields.most, 10)
        level, network = state.level, state.network
        if rows:
            signals = self.fields.signals(rows, shapes)
            inputs, level = self.normalise(signals, level)
            outputs, network = self.network(inputs, network)
            own, through = inputs.double().numpy(), outputs.double().numpy()
            for k, ones in enumerate(who):
                for one in ones:
                    slot = one.number % self.config.fields.most
                    one.inputs, one.outputs = one.inputs + own[k, slot], one.outputs + through[k, slot]
        closed = table_of([*figures_of(state.closed), *closing]) if closing else state.closed
        after = FiguresState(
            None if seen is None else seen.state(),
            waiting,
            state.frames + len(frames),
            torch.tensor(began, dtype=torch.int64),
            level,
            network,
            table_of(open_),
            closed,
            torch.tensor(time, dtype=torch.float64),
        )
        none = np.zeros((0, *self.small), np.int32)
        pictures = torch.from_numpy(np.stack(shapes) if shapes else none)
        where = torch.from_numpy(np.stack(masks)) if masks else pictures.to(torch.uint8)
        at = torch.tensor(times, dtype=torch.float64)
        return FiguresSignals(inputs, outputs, pictures, where, at, torch.tensor(cuts, dtype=torch.bool)), after

    def _start(self) -> FiguresState:
        """The state before the first frame."""
        zero, none = torch.zeros((), dtype=torch.int64), table_of([])
        waiting = torch.zeros(3, *self.small)
        return FiguresState(
            None, waiting, zero, zero.clone(), torch.zeros(3), None, none, none, torch.zeros((), dtype=torch.float64)
        )

    def _step(
        self, picture: Floats, seen: Memory, open_: list[Figure], time: float, began: int
    ) -> tuple[Sensed | None, Bytes, list[Figure], list[Figure], int, bool]:
        """What is sensed, where known objects are `[h, w]`, tracks, tracks that are gone, tracks begun, and whether a
        new scene begins, after one picture `[3, h, w]`. The memory is changed."""
        import cv2

        g, t, ground = self.config.ground, self.config.tracking, seen.ground
        standing = ground_step(picture, ground, self.dt, g)
        if standing.cut:
            # What was followed is gone; a new scene starts as a film does.
            blank = Memory.blank(ground_start(picture, g))
            vars(seen).update(vars(blank))
            return None, np.zeros(picture.shape[1:], np.uint8), [], open_, began, True
        # Plain parts of what moves are still too, and no holes.
        moving = np.zeros(began + 2, np.uint8)
        for one in open_:
            if one.known and time - one.moved < t.rests:
                moving[one.number + 1] = 1
        figure, smallest = standing.figure, t.smallest * standing.grey.size
        shapes, hole, wide = seen.silhouettes, None, None
        # Mostly next to nothing is there, and regions are dear. So few pixels enclose no more.
        few = still_of(figure, ground.quiet, g.still, shapes, moving)
        if few * (few / 4 + 1) >= smallest:
            free = figure & (told(shapes, moving) == 0)
            hole = holes(free, ground.quiet >= g.still, standing.grey, standing.ground, smallest)
        if hole is not None:
            wide = np.asarray(cv2.dilate(hole.astype(np.uint8), square(3))) > 0
            figure = figure & ~hole
        every = regions_of(figure, min(t.tiny, t.smallest) * standing.grey.size, t.gap)
        regions = without_pieces(parted(every, t.notch, smallest), open_, time, t)
        light = Light(standing.picture, standing.ground, self.config.shades)
        open_, late, silhouettes = follow(
            open_, time, ground.frames * self.dt, regions, standing, light, seen.gone, seen.come, began, self.dt, t
        )
        seen.come = comings(seen.come, open_, late, time, t)
        seen.gone = come_and_gone(seen.gone, late, open_, self.dt, t)
        began = max([began, *(one.number + 1 for one in open_)])
        keeping = []
        for one in open_:
            since, patience = (one.moved, t.stays) if one.known else (one.first_seen, t.doubtful)
            # Under what is tiny and perhaps nothing, leaves and water are learned to be restless.
            if time - since < patience and (one.known or not tiny(one, silhouettes.shape[1] / silhouettes.shape[0], t)):
                keeping.append(one.number)
        sensed, seen.filters = self.fields.sense(standing.picture, standing.ground, silhouettes, seen.filters)
        learn(standing, ground, seen.kept, self.dt, g)
        if wide is not None:
            np.copyto(ground.mean, standing.picture, where=wide)
        seen.silhouettes, known = silhouettes, [one.number for one in open_ if one.known]
        mask = marked(silhouettes, known, keeping, began, seen.kept)
        return sensed, mask, open_, late, began, False

    def _each(self, frames: Tensor, state: Any) -> tuple[FiguresSignals, Any]:
        """One film after the other."""
        states = states_of(state, len(frames))
        parts = [self(film, own) for film, own in zip(frames, states, strict=True)]
        columns = zip(*(signals for signals, _ in parts), strict=True)
        stacked = FiguresSignals(*(torch.stack(column) for column in columns))
        return stacked._replace(time=stacked.time[0]), tuple(own for _, own in parts)

    def objects(self, state: Any) -> Nested:
        """The objects so far, in the order in which they appeared."""
        if not isinstance(state, FiguresState):
            return [self.objects(own) for own in state]
        every = [*figures_of(state.closed), *figures_of(state.open)]
        return [self._bound(one) for one in sorted(every, key=lambda one: one.number) if one.known]

    def in_sight(self, state: Any) -> Nested:
        """The objects seen at the latest time step."""
        if not isinstance(state, FiguresState):
            return [self.in_sight(own) for own in state]
        now = float(state.time)
        return [self._bound(one) for one in figures_of(state.open) if one.known and one.last_seen == now]

    def verdict(self, state: Any) -> Nested:
        """`static` before anything stood out, `learning` while the network learns fast, `stable` then."""
        if not isinstance(state, FiguresState):
            return [self.verdict(own) for own in state]
        word: Verdict = "stable"
        if state.network is None or int(state.began) == 0:
            word = "static"
        elif self.config.network.learn and float(state.network.clock) * self.dt < self.config.network.tau_boost:
            word = "learning"
        return word

    def weights(self, state: Any) -> Tensor:
        if not isinstance(state, FiguresState):
            return torch.stack([self.weights(own) for own in state])
        return torch.zeros(10, 10) if state.network is None else state.network.weights

    def _bound(self, one: Figure) -> BoundObject:
        """A track as an object, in pixels of the frames."""
        height = self.size[0]
        across = self.size[1] / (height * self.small[1] / self.small[0])
        path, boxes = [], []
        for time, row, column, top, left, bottom, right, *_ in one.path.tolist():
            path.append((time, column * height * across, row * height))
            boxes.append((left * height * across, top * height, right * height * across, bottom * height))
        _, x, y = path[-1]
        index = int(one.outputs.argmax())
        row, shade = features_by_group(torch.from_numpy(one.inputs)).tolist(), shade_of(one.shades)
        hues = () if shade is None else FEATURES[GROUPS["color"]]
        return BoundObject(
            FEATURES[index],
            index,
            {name: value for name, value in zip(FEATURES, row, strict=True) if value > 0 and name not in hues},
            place=(x, y),
            velocity=(float(one.velocity[1]) * height * across, float(one.velocity[0]) * height),
            first_seen=one.first_seen,
            last_seen=one.last_seen,
            track=one.number,
            heading=(x - path[0][1], y - path[0][2]),
            path=tuple(path),
            shade=shade,
            boxes=tuple(boxes),
        )
