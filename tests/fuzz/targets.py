"""Everything that reads a file, by name: what it is given, and how it is asked to read all of it."""

from __future__ import annotations

import json
import random
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from tests.fuzz import mutate
from tests.fuzz.corpus import corpus, small_model

MODELS = Path(__file__).resolve().parents[2] / "models"
TEXT = (".toml", ".json", ".jsonl", ".txt", ".md")


@dataclass(frozen=True)
class Target:
    """A reader.

    Args:
        name: the folder of its corpus: every file or folder in it is one that can be read. Models are those that are
            shipped.
        read: all that there is to read of a file, or of a folder.
        craft: damages values and writes them with a checksum that fits; None where nothing has one.
        share: of the inputs that are crafted.
    """

    name: str
    read: Callable[[Path], Any]
    craft: Callable[[random.Random, Path], None] | None = None
    share: float = 0.5

    def seeds(self) -> list[Path]:
        """What is damaged."""
        if self.name == "model":
            return sorted(path.parent for path in MODELS.glob("*/config.toml"))
        return sorted(path for path in corpus(self.name).iterdir())

    def make(self, chance: random.Random, folder: Path) -> Path:
        """A damaged copy of a seed, in an empty folder."""
        seed = chance.choice(self.seeds())
        copy = folder / seed.name
        (shutil.copytree if seed.is_dir() else shutil.copy)(seed, copy)
        if self.craft is not None and chance.random() < self.share:
            self.craft(chance, copy)
            return copy
        files = sorted(path for path in ([copy] if copy.is_file() else copy.rglob("*")) if path.is_file())
        file = chance.choice(files)
        if len(files) > 1 and chance.random() < 0.05:
            file.unlink()
            return copy
        others = [
            path.read_bytes() for path in islice(chance.sample(self.seeds(), len(self.seeds())), 2) if path.is_file()
        ]
        damage = mutate.damaged_text if file.suffix in TEXT else mutate.damaged_bytes
        file.write_bytes(damage(chance, file.read_bytes(), others))
        return copy


def named(place: str) -> Callable[[Path], Any]:
    """A reader by its place, imported when it is first called."""
    return lambda path: resolve_name(place)(path)


def read_state(path: Path) -> Any:
    from ndtorch.binding.saving import load_state

    return load_state(path, small_model())


def craft_tensors(chance: random.Random, path: Path) -> None:
    import torch

    from ndtorch.utils.files import read_tensors, save_tensors

    file = path / "weights.safetensors" if path.is_dir() else path
    if not file.exists():  # a model without a first stage gets one
        save_tensors({"motion": torch.zeros(4, 4)}, file)
    flat, about = read_tensors(file, "a file")
    arrays = mutate.damaged_arrays(chance, {name: part.numpy() for name, part in flat.items()})
    if chance.random() < 0.2:
        found = mutate.damaged_values(chance, {"a": "b"} | about)
        about = {str(key): str(value) for key, value in found.items()} if isinstance(found, dict) else {}
    save_tensors({name: torch.from_numpy(part.copy()) for name, part in arrays.items()}, file, about)


def craft_run(chance: random.Random, path: Path) -> None:
    from ndtorch.utils.files import read_tensors, save_tensors

    file = next(path.glob("*.safetensors"))
    flat, about = read_tensors(file, "a state")
    about["run"] = json.dumps(mutate.damaged_values(chance, json.loads(about["run"])))
    save_tensors(flat, file, about)


def craft_arrays(chance: random.Random, path: Path) -> None:
    from ndtorch.utils.files import load_arrays, save_arrays

    save_arrays(path, mutate.damaged_arrays(chance, load_arrays(path)))


def read_car(path: Path) -> Any:
    from ndtorch.utils.toml import read_toml
    from ndtorch_robot.run_config import RunConfig

    config = read_toml(path, RunConfig)
    return config, config.stereo_rig()


def read_drive(path: Path) -> Any:
    from ndtorch.utils.toml import read_toml
    from ndtorch_robot.config import DriveConfig

    return read_toml(path, DriveConfig)


def read_recording(path: Path) -> Any:
    from ndtorch_robot.recording.reading import open_recording

    recording = open_recording(path)
    return list(recording.steps()), recording.complete


def craft_recording(chance: random.Random, path: Path) -> None:
    from ndtorch_robot.recording.streams import STEP, crc_of
    from tests.robot.support.recorded import edited, rewrite

    header, at = {}, chance.randrange(4)
    if chance.random() < 0.3:
        configuration = read_recording_header(path)
        text = json.dumps(mutate.damaged_values(chance, configuration))
        header, at = {"configuration": text, "crc": crc_of(text)}, -1

    def change(topic: str, number: int, data: bytes) -> bytes:
        if number != at:
            return data
        if topic == STEP:
            return edited(data, lambda values: mutate.damaged_values(chance, values))
        return mutate.damaged_bytes(chance, data, [data]) if chance.random() < 0.3 else data

    rewrite(path, change, header)


def read_recording_header(path: Path) -> Any:
    from ndtorch_robot.recording.reading import open_recording

    return open_recording(path).configuration


def read_bag(path: Path) -> Any:
    from ndtorch_robot.recording.bags import StereoBag

    return list(StereoBag(path).pairs())


def replay_recording(path: Path) -> Any:
    """A recording driven again."""
    from ndtorch_robot.recording.reading import open_recording
    from ndtorch_robot.recording.replay import make_runner, replay

    recording = open_recording(path)
    return replay(recording, make_runner(recording.configuration))


def read_line(path: Path) -> Any:
    """Bytes of the drive link, in chunks, and what the frames say."""
    from ndtorch_robot.link.messages import Parser, Type, read_command, read_telemetry, read_welcome

    data, parser = path.read_bytes(), Parser()
    read = {Type.COMMAND: read_command, Type.TELEMETRY: read_telemetry, Type.WELCOME: read_welcome}
    found = []
    for at in range(0, len(data), 7):
        for frame in parser.feed(data[at : at + 7]):
            told = read[Type(frame.type)](frame.body) if frame.type in read else None
            if hasattr(told, "values"):
                told.values()
            found.append((frame, told))
    assert found == [(frame, told) for frame, told in found]
    assert [frame for frame, _ in found] == Parser().feed(data), "chunks make a difference"
    return found


def craft_line(chance: random.Random, path: Path) -> None:
    from ndtorch_robot.link.messages import Frame, encode_frame

    whole = path.read_bytes()
    frames = [part + b"\0" for part in whole.split(b"\0") if part]
    body = bytes(chance.randrange(256) for _ in range(chance.choice((0, 2, 4, 10, 20, 22))))
    frames.append(encode_frame(Frame(chance.randrange(3), chance.randrange(256), chance.randrange(65536), body)))
    path.write_bytes(mutate.frame_bytes(chance, frames))


def read_video(path: Path) -> Any:
    from ndtorch.scenes.video import open_video

    with open_video(path, (24, 32)) as source:
        return sum(len(frames) for frames in islice(source.chunks(4), 6))


def read_pictures(path: Path) -> Any:
    from ndtorch_robot.cameras.sources.files import FolderCapture

    count = read_video(path)
    capture = FolderCapture(path, 30.0)
    while capture.grab():
        capture.retrieve()
    return count


def read_truth(path: Path) -> Any:
    from ndtorch_train.benchmark.mot import read_clip

    clip = read_clip(path)
    return list(islice(clip.clip.frames, 8)), list(islice(clip.truth(), 8))


def read_barn(path: Path) -> Any:
    from ndtorch_robot.barn import read_worlds

    return [world.plan() for world in read_worlds(path)]


TARGETS = {
    target.name: target
    for target in (
        Target("state", read_state, craft_tensors),
        Target("model", named("ndtorch:load"), craft_tensors, 0.3),
        Target("run", named("ndtorch.run.opening:described"), craft_run),
        Target("map", named("ndtorch.navigation.mapping.map_files:load_map"), craft_arrays),
        Target("sweep", named("ndtorch_train.sweep.config:read_sweep")),
        Target("car", read_car),
        Target("drive", read_drive),
        Target("arena", named("ndtorch_robot.sim.arena_file:read_arena")),
        Target("calibration", named("ndtorch.navigation.stereo.calibration_files:load_calibration")),
        Target("recording", read_recording, craft_recording, 0.7),
        Target("replay", replay_recording, craft_recording, 0.8),
        Target("bag", read_bag),
        Target("line", read_line, craft_line),
        Target("video", read_video),
        Target("pictures", read_pictures),
        Target("truth", read_truth),
        Target("barn", read_barn),
        Target("ranges", named("ndtorch_train.benchmark.ranges:read_pair")),
    )
}
