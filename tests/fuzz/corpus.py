"""A few small files for every reader, made once a process."""

from __future__ import annotations

import atexit
import functools
import json
import shutil
import tempfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch

SIZE = (12, 16)

ARENA = """name = "lab"
rooms = [[0, 0, 6, 4], [6, 1, 9, 3]]
doors = [[5.9, 1.5, 6.1, 2.5]]
pillars = [{x = 4, y = 3, width = 0.4, round = true}]
boxes = [{at = [1.0, 1.0, 1.5, 1.4], height = 0.3}]
lamps = [{x = 3.0, y = 2.0, radius = 1.0, gain = 0.5}]
floor = "carpet"
start = [2.0, 2.0, 0.0]
"""

BARN = {
    "start": [0.0, 0.0, 90.0],
    "goal": [0.0, 3.0],
    "radius_m": 0.075,
    "height_m": 1.0,
    "goal_radius_m": 1.0,
    "time_limit_s": 15.0,
    "worlds": [
        {"world": 5, "path_m": 12.0, "cylinders": [[0.3, 4.0], [-0.9, 5.0]]},
        {"world": 6, "path_m": 10.0, "cylinders": [[2.0, 4.0]]},
    ],
}

DRIVE = """arena = "hallway"
seed = 3
seconds = 20.0
controller = "ranging"
walls = "textured"
"""

TRUTH = "1,1,2,3,5,4,1,-1,-1,-1\n2,1,3,3,5,4,1,-1,-1,-1\n2,2,8,6,3,3,0,-1,-1,-1\n"


def picture(n: int, size: tuple[int, int] = SIZE) -> Any:
    return np.random.default_rng(n).integers(0, 256, (*size, 3), np.uint8)


@functools.cache
def small_model() -> Any:
    from ndtorch.binding.models.published import PublishedConfig, PublishedModel

    return PublishedModel(PublishedConfig(size=(16, 20), fps=100.0))


def state(folder: Path) -> None:
    from ndtorch.binding.saving import save_state

    chance = torch.Generator().manual_seed(1)
    for name, shape in (("one", (4, 3, 16, 20)), ("two", (2, 4, 3, 16, 20))):
        save_state(
            small_model()(torch.rand(shape, generator=chance))[1], folder / f"{name}.safetensors", {"made": "here"}
        )


def run(folder: Path) -> None:
    from ndtorch.binding.saving import save_state
    from ndtorch.run.opening import STATE

    about = {"model": "published", "source": "two-bars", "frames": 5, "fps": 100.0, "options": {}, "scene": {}}
    (folder / "bars").mkdir()
    state = small_model()(torch.zeros(4, 3, 16, 20))[1]
    save_state(state, folder / "bars" / STATE, {"run": json.dumps(about)})


def maps(folder: Path) -> None:
    from ndtorch.navigation import Grid
    from ndtorch.navigation.mapping.map_files import save_map

    grid = Grid(-0.5, 0.5, -0.3, 0.3, 0.05)
    with tempfile.TemporaryDirectory() as place:
        for name, walls in (("plain", None), ("walls", torch.rand(3, 8, generator=torch.Generator().manual_seed(2)))):
            save_map(Path(place), torch.eye(grid.rows, grid.columns), grid, np.zeros((2, 2)), walls)
            shutil.copy(Path(place) / "map.npz", folder / f"{name}.npz")


def cars(folder: Path) -> None:
    for name in ("sim", "maxstone8"):
        shutil.copy(Path(__file__).parents[2] / "robot" / "configs" / f"{name}.toml", folder / f"{name}.toml")


def sweeps(folder: Path) -> None:
    for file in (Path(__file__).parents[2] / "train" / "sweeps").glob("*.toml"):
        shutil.copy(file, folder / file.name)


def calibration(folder: Path) -> None:
    projection = "640.0 0.0 319.5 {} 0.0 640.0 239.5 0.0 0.0 0.0 1.0 0.0"
    (folder / "kitti.txt").write_text(f"P0: {projection.format(0)}\nP1: {projection.format(-76.8)}\n")
    lens = "[640.0, 0.0, 319.5, 0.0, 640.0, 239.5, 0.0, 0.0, 1.0]"
    lenses = "".join(f"M{n}: {lens}\nD{n}: [0.1, 0.0, 0.0, 0.0]\n" for n in (1, 2))
    motion = "R: [1, 0, 0, 0, 1, 0, 0, 0, 1]\nT: [-0.1, 0, 0]\n"
    (folder / "pair.yaml").write_text(f"image_width: 640\nimage_height: 480\n{lenses}{motion}")


def recordings(folder: Path) -> None:
    from ndtorch.navigation import Strips
    from ndtorch_robot.ports import DriveCommand, Step, StereoFrames
    from ndtorch_robot.recording import Recorder

    def eye(n: int, strips: bool) -> Any:
        whole = torch.from_numpy(picture(n)).permute(2, 0, 1)[None].contiguous()
        return Strips(whole[..., :5, :7].contiguous(), whole[..., 6:7, :].contiguous()) if strips else whole

    wanted, told = DriveCommand(0.5, 0.1), {"telemetry": {"battery_v": 7.4}, "placed": (0.0, 1.0, 0.5)}
    for name, strips in (("whole", False), ("strips", True)):
        with Recorder(folder / f"{name}.mcap", reserve=0) as recorder:
            for n in range(4):
                frames = StereoFrames(eye(2 * n, strips), eye(2 * n + 1, strips), n / 30)
                recorder(Step(n, n / 30, frames, wanted, wanted, wanted, **told))


def replays(folder: Path) -> None:
    from ndtorch.navigation import NavigatorOptions, StereoRig
    from ndtorch_robot.navigator_runner import NavigatorRunner
    from ndtorch_robot.ports import STAND, Step, StereoFrames
    from ndtorch_robot.recording import Recorder

    rig = StereoRig(width=64, height=48, focal=43.0)
    runner = NavigatorRunner(NavigatorOptions("published"), rig, 30.0)
    with Recorder(folder / "drive.mcap", runner, reserve=0, when_full="wait") as recorder:
        for n in range(3):
            eyes = (torch.from_numpy(picture(k, (48, 64))).permute(2, 0, 1)[None] for k in (n, n + 1))
            frames = StereoFrames(*eyes, n / 30)
            wanted = runner.step(frames, STAND)
            recorder(Step(n, n / 30, frames, STAND, wanted, wanted, runner.state))


def bags(folder: Path) -> None:
    from rosbags.rosbag2 import StoragePlugin, Writer

    from ndtorch.navigation import StereoRig
    from ndtorch_robot import ros_messages as ros
    from ndtorch_robot.ports import STAND

    rig = StereoRig(width=16, height=12, focal=10.0)
    with Writer(folder / "folder", version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        for n in range(3):
            told = [("/odom", ros.odometry(ros.Pose(0.1 * n, 0.0, 0.0), STAND, n / 30))]
            for k, (side, info) in enumerate(zip(("left", "right"), ros.camera_infos(rig), strict=True)):
                image = torch.from_numpy(picture(n + k)).permute(2, 0, 1)[None]
                told += [(f"/{side}/image_rect", ros.image(image, side, n / 30)), (f"/{side}/camera_info", info)]
            for topic, message in told:
                known = {connection.topic: connection for connection in bag.connections}
                kind = message.__msgtype__
                where = known.get(topic) or bag.add_connection(topic, kind, typestore=ros.typestore())
                bag.write(where, round(n / 30 * 1e9), ros.to_cdr(message))
    shutil.copy(next((folder / "folder").glob("*.mcap")), folder / "file.mcap")


def lines(folder: Path) -> None:
    from ndtorch_robot.link.messages import COMMAND_BODY, TELEMETRY_BODY, WELCOME_BODY, Frame, Type, encode_frame

    bodies = {
        Type.HELLO: b"",
        Type.HEARTBEAT: b"",
        Type.COMMAND: COMMAND_BODY.pack(500, -1200),
        Type.STOP: b"",
        Type.ARM: b"",
        Type.WELCOME: WELCOME_BODY.pack(7, b"maxstone"),
        Type.TELEMETRY: TELEMETRY_BODY.pack(9, 1, 16, 480, -1200, 7400, 1560, 1500, 1480, 3, 77),
    }
    frames = b"".join(encode_frame(Frame(1, kind, 7 * kind, body)) for kind, body in bodies.items())
    (folder / "talk.bin").write_bytes(frames)


def videos(folder: Path) -> None:
    for name, code in (("mjpg.avi", "MJPG"), ("mp4v.mp4", "mp4v"), ("ffv1.mkv", "FFV1")):
        film = cv2.VideoWriter(str(folder / name), cv2.VideoWriter.fourcc(*code), 10.0, (32, 24))
        for n in range(4):
            film.write(cv2.GaussianBlur(picture(n, (24, 32)), (0, 0), 3))
        film.release()
    raw = b"".join(b"FRAME\n" + picture(n, (24, 32))[..., 0].tobytes() + bytes([128]) * 384 for n in range(4))
    (folder / "raw.y4m").write_bytes(b"YUV4MPEG2 W32 H24 F10:1 Ip A1:1 C420jpeg\n" + raw)
    encoded = (cv2.imencode(".jpg", picture(n, (24, 32)))[1].tobytes() for n in range(3))
    (folder / "film.mjpeg").write_bytes(b"".join(encoded))


def pictures(folder: Path) -> None:
    for ending in ("png", "jpg", "bmp", "tif", "webp", "pgm", "ppm"):
        (folder / ending).mkdir()
        for n in range(2):
            image = picture(n)
            cv2.imwrite(str(folder / ending / f"{n}.{ending}"), image[..., 0] if ending == "pgm" else image)


def truths(folder: Path) -> None:
    (folder / "clip").mkdir()
    film = cv2.VideoWriter(str(folder / "clip" / "clip.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 10.0, (32, 24))
    for n in range(3):
        film.write(picture(n, (24, 32)))
    film.release()
    (folder / "clip" / "gt.txt").write_text(TRUTH)


def ranges(folder: Path) -> None:
    (folder / "pair").mkdir()
    for name in ("left", "right"):
        cv2.imwrite(str(folder / "pair" / f"{name}.png"), picture(3))
    cv2.imwrite(str(folder / "pair" / "disp.tif"), picture(5)[..., 0].astype(np.float32))


def texts(name: str, text: str) -> Any:
    return lambda folder: (folder / name).write_text(text)


MAKERS = {
    "state": state,
    "run": run,
    "map": maps,
    "sweep": sweeps,
    "car": cars,
    "drive": texts("drive.toml", DRIVE),
    "arena": texts("lab.toml", ARENA),
    "calibration": calibration,
    "recording": recordings,
    "replay": replays,
    "bag": bags,
    "line": lines,
    "video": videos,
    "pictures": pictures,
    "truth": truths,
    "barn": texts("worlds.json", json.dumps(BARN, indent=1)),
    "ranges": ranges,
}


@functools.cache
def corpus(name: str) -> Path:
    """The folder of a reader's files."""
    folder = Path(tempfile.mkdtemp(prefix="corpus-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    MAKERS[name](folder)
    return folder
