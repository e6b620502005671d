"""The models that can be run, until each is one that `ndtorch.load` gives."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn

from ndtorch.binding import (
    BoundObject,
    FieldInputs,
    InhibitoryNetwork,
    ObjectFile,
    ObjectFiles,
    ObjectTable,
    ScaleFreeRule,
    VisualBinding,
    block_diagonal,
    train_first_stage,
)
from ndtorch.binding.models.whole_field import WholeField
from ndtorch.errors import InputError
from ndtorch.loading import load
from ndtorch.vision.camera.front_end import FrontEnd, OrdinaryVideo

PARTS = ("exposure", "background", "noise-floor", "color-inhibition", "scale", "compression", "fields", "network")
NAMES = ("published", "scale-free", "video")
MODEL_RADIUS = 0.9


def kind_of(model: str) -> str:
    if model not in NAMES:
        raise InputError(f"model must be one of {', '.join(NAMES)} or a folder with a config.toml; got {model!r}")
    return model


def make_model(about: dict[str, Any], size: tuple[int, int], fps: float, border: str) -> Any:
    if about["model"] == "video":
        return Video(size, fps, about["without"])
    options = dict(about["options"])
    if about["model"] == "scale-free":
        options = {f"scale_free_{key}": value for key, value in options.items()} | {"rule": "scale-free"}
    model = load("binding", size=size, fps=fps, border=border, **options)
    radius = about["first_stage_radius"]
    if radius is not None and radius != MODEL_RADIUS:
        first_stage = block_diagonal(train_first_stage(radius=radius))
        model = VisualBinding(first_stage, model.config, size, fps, border)  # type: ignore[arg-type]
    return Table(about["model"], model)


class Table(nn.Module):
    tracks = False

    def __init__(self, name: str, model: VisualBinding) -> None:
        super().__init__()
        self.name, self.model, self.fps, self.dt = name, model, model.fps, model.dt
        self.config, self.settle, self.features = model.config, model.settle, model.features

    def forward(self, frames: Tensor, state: Any = None) -> Any:
        return self.model(frames, state)

    def objects(self, state: Any) -> list[BoundObject]:
        return self.model.objects(state)

    def verdict(self, state: Any) -> Any:
        return self.model.verdict(state)

    def table(self, state: Any) -> ObjectTable:
        return self.model.table(state)

    def weights(self, state: Any) -> Tensor:
        return state.second.weights  # type: ignore[no-any-return]


class Signals:
    def __init__(self, outputs: Tensor, time: Tensor) -> None:
        self.outputs, self.time = outputs, time


class Video(nn.Module):
    tracks, name, settle = True, "video", 0.0

    def __init__(self, size: tuple[int, int], fps: float, without: Any = ()) -> None:
        super().__init__()
        self.size, self.fps = size, fps
        self.vision = OrdinaryVideo(size, fps, front_end(without))
        self.dt = self.vision.dt
        self.normalise = FieldInputs(self.dt)
        rule = None if "network" in without else ScaleFreeRule()
        self.network = InhibitoryNetwork.of_fields(10, self.dt, rule)
        self.whole = "fields" in without

    def forward(self, frames: Tensor, state: Any = None) -> Any:
        files = ObjectFiles(self.dt, self.size[1] / self.size[0])
        seen, level, learned, files, sums = (None, None, None, files, []) if state is None else state
        fields, seen = self.vision(frames, seen)
        r, c = fields.signals.shape[1:3]
        outputs = fields.signals
        if len(fields.time):
            inputs, level = self.normalise(fields.signals.flatten(1, 2), level)
            outputs, learned = self.network(inputs, learned)
            if self.whole:
                sums.append((inputs[:, 0], fields.time))
            else:
                files.add(fields, inputs, outputs)
        return Signals(outputs.reshape(-1, r, c, 10), fields.time), (seen, level, learned, files, sums)

    def objects(self, state: Any) -> list[BoundObject]:
        *_, files, sums = state
        if self.whole and sums:
            signals, times = (torch.cat(part) for part in zip(*sums, strict=True))
            return [self.bound(n, thing) for n, thing in enumerate(WholeField(self.dt)(signals, times))]
        return [self.bound(n, thing) for n, thing in enumerate(files.objects())]

    def bound(self, number: int, thing: ObjectFile) -> BoundObject:
        h, w = self.size
        path = tuple((t, column * w, row * h) for t, row, column, _ in thing.path)
        return BoundObject(
            thing.neuron,
            int(thing.winners.argmax()),
            thing.features,
            path[-1][1:],
            (thing.velocity[1] * w, thing.velocity[0] * h),
            thing.appeared,
            thing.disappeared,
            number,
            (float(thing.heading[0]), float(thing.heading[1])),
            len(thing.fields),
            path,
        )

    def verdict(self, state: Any) -> str:
        return "stable" if self.objects(state) else "static"

    def weights(self, state: Any) -> Tensor:
        return torch.zeros(10, 10) if state[2] is None else state[2].weights


def front_end(without: Any = ()) -> FrontEnd:
    for name in without:
        if name not in PARTS:
            raise InputError(f"without must name parts among {', '.join(PARTS)}; got {name!r}")
    return FrontEnd(
        exposure="exposure" not in without,
        background="background" not in without,
        noise_floor="noise-floor" not in without,
        color_inhibition="color-inhibition" not in without,
        scale=0 if "scale" in without else None,
        compression="compression" not in without,
        grid=(1, 1) if "fields" in without else FrontEnd.grid,
    )
