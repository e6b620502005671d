"""Bags of others, written by `rosbags`, and messages read by `mcap-ros2-support`: the navigator sees what they show."""

import json
import math

import cv2
import numpy as np
import pytest
import torch
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from ndtorch.cli.commands import main
from ndtorch.errors import InputError
from ndtorch.navigation import Body, Pose, SearchParams, StereoRig, cut_strips
from ndtorch_robot import ros_messages as ros
from ndtorch_robot.bags import Moves, StereoBag, find_topics, why_few_ranges
from ndtorch_robot.ports import DriveCommand, StereoFrames
from ndtorch_robot.recording import make_runner, open_recording
from tests.robot.support.cars import moving_world
from tests.robot.support.recorded import camera_infos, same

SMALL_RIG = StereoRig(width=160, height=120, focal=107.0, baseline=0.12)
DRIVEN, RATE, START = DriveCommand(0.4, 0.5), 20.0, 1.7e9
ROS1 = get_typestore(Stores.ROS1_NOETIC)


def images(frames, n, kind, later=0.002):
    for side, eye in zip(("left", "right"), frames[:2], strict=True):
        time, topic = START + n / RATE + (later if side == "right" else 0.0), f"/stereo/{side}/image_rect_color"
        message = ros.image(eye, side, time)
        if kind == "raw":
            message.encoding, message.data = "bgr8", message.data.reshape(-1, 3)[:, ::-1].reshape(-1)
            yield topic, message
        else:
            data = cv2.imencode(".png", cv2.cvtColor(eye[0].permute(1, 2, 0).numpy(), cv2.COLOR_RGB2BGR))[1].ravel()
            yield f"{topic}/compressed", ros.new("sensor_msgs/msg/CompressedImage", message.header, "bgr8; png", data)


def to_ros1(message):
    """The same message of ROS 1: headers are counted, and matrices of a camera have capital letters."""
    if isinstance(message, list):
        return [to_ros1(part) for part in message]
    if not hasattr(message, "__msgtype__"):
        return message
    kind = ROS1.types[message.__msgtype__]
    names = [name for name in kind.__dataclass_fields__ if name != "__msgtype__"]
    return kind(**{name: to_ros1(getattr(message, name, getattr(message, name.lower(), 0))) for name in names})


def write_bag(folder, plugin, kind="raw", count=30, odometry=True, skip=(), infos=None, later=0.002):
    """A bag of ROS 2, or of ROS 1 without a plugin."""
    if plugin is None:
        folder = folder.with_suffix(".bag")
        writer, types = Ros1Writer(folder), ROS1
    else:
        writer, types = Writer(folder, version=9, storage_plugin=plugin), ros.typestore()
    with writer as bag:
        made = {}

        def add(topic, message, n):
            name = message.__msgtype__
            if topic not in made:
                made[topic] = bag.add_connection(topic, name, typestore=types)
            data = ROS1.serialize_ros1(to_ros1(message), name) if plugin is None else ros.to_cdr(message)
            bag.write(made[topic], round((START + n / RATE) * 1e9), data)

        for n, frames in enumerate(moving_world(count, SMALL_RIG)):
            if odometry:
                k, s = DRIVEN.curvature, DRIVEN.speed * n / RATE
                circle = Pose(math.sin(k * s) / k, (1 - math.cos(k * s)) / k, k * s)
                add("/odom", ros.odometry(circle, DRIVEN, START + n / RATE - 0.001), n)
            for topic, message in images(frames, n, kind, later):
                if (n, "left" in topic) not in skip:
                    add(topic, message, n)
            for side, info in zip(("left", "right"), infos or camera_infos(SMALL_RIG), strict=True):
                add(f"/stereo/{side}/camera_info", info, n)
    return folder


@pytest.mark.parametrize(
    ("plugin", "kind", "single"),
    [
        (StoragePlugin.SQLITE3, "raw", False),
        (StoragePlugin.MCAP, "compressed", False),
        (StoragePlugin.MCAP, "raw", True),
        (None, "raw", False),
    ],
)
def test_a_bag_becomes_a_recording_that_replays(tmp_path, capsys, plugin, kind, single):
    bag = write_bag(tmp_path / "bag", plugin, kind, skip={(4, True), (9, False)})
    path = next(bag.glob("*.mcap")) if single else bag
    (bag / "metadata.yaml").unlink(missing_ok=True) if plugin is not None and kind == "raw" else None
    out = tmp_path / "out.mcap"
    assert main(["import", str(path), "--out", str(out), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result["steps"], result["odometry"]) == (28, "/odom")
    assert result["rate_hz"] == pytest.approx(RATE, rel=1e-3)
    assert result["ranges"] > 50
    steps, world = list(open_recording(out).steps()), list(moving_world(30, SMALL_RIG))
    seen = [n for n in range(30) if n not in (4, 9)]
    assert [round((step.time - START) * RATE) for step in steps] == seen
    field = StereoBag(path).rig.subfields()[0]
    for step, n in list(zip(steps, seen, strict=True))[::9]:
        assert same(step.frames.left, cut_strips(world[n].left, field, SMALL_RIG))
    assert [step.driven.speed for step in steps[1:]] == pytest.approx([0.4] * 27, rel=1e-3)
    assert [step.driven.curvature for step in steps[1:]] == pytest.approx([0.5] * 27, rel=1e-3)
    assert main(["replay", str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["same"] == 28


ROBOT = """
board_name = "x"
[link]
kind = "simulated-world"
[simulation]
[body]
length_m = 0.25
width_m = 0.18
min_turn_radius_m = 0.2
[rig]
camera_height_m = 0.1
camera_pitch_deg = 2.0
camera_forward_m = 0.07
[navigation]
controller = "ranging"
"""


def test_the_navigator_of_a_bag_has_the_body_of_its_robot(tmp_path):
    """Body, cameras and options are the file's unless the command has others; calibration and rate are the bag's."""
    file, bag = tmp_path / "my.toml", write_bag(tmp_path / "bag", None, count=3)
    file.write_text(ROBOT)
    for name, more in (("ranging", []), ("published", ["--controller", "published"])):
        out = tmp_path / f"{name}.mcap"
        assert main(["import", str(bag), "--robot", str(file), "--out", str(out), *more]) == 0
        runner = make_runner(open_recording(out).configuration)
        assert (runner.body, runner.options.controller) == (Body(0.25, 0.18, 0.2), name)
        assert (runner.rig.camera_height, runner.rig.forward) == (0.1, 0.07)
        assert math.degrees(runner.rig.pitch) == pytest.approx(2.0)
        assert (runner.rig.focal, runner.rig.baseline) == (pytest.approx(107.0), pytest.approx(0.12))


def test_raw_images_are_rectified(tmp_path):
    """Points of the rectified image are where the calibration has them."""
    infos = camera_infos(SMALL_RIG, (-0.2, 0.05, 0.0, 0.0, 0.0))
    bag = StereoBag(write_bag(tmp_path / "bag", StoragePlugin.SQLITE3, count=2, infos=infos))
    bag.is_rectified = False  # what the names of these topics say is wrong
    raw, ray, k = np.zeros((120, 160, 3), np.uint8), np.array([[0.5, 0.3, 1.0]]), infos[0].k.reshape(3, 3)
    bent = cv2.projectPoints(ray, np.zeros(3), np.zeros(3), k, infos[0].d)[0].reshape(2)
    straight = cv2.projectPoints(ray, np.zeros(3), np.zeros(3), k, np.zeros(5))[0].reshape(2)
    assert np.hypot(*(bent - straight)) > 3
    cv2.circle(raw, tuple(int(v) for v in bent.round()), 2, (255, 255, 255), -1)
    message = ros.image(torch.from_numpy(raw).permute(2, 0, 1)[None], "left", 0.0)
    row, column = np.argwhere(bag.frames(message, message, 0.0).left[0, 0].numpy() > 100).mean(0)
    assert np.hypot(column - straight[0], row - straight[1]) < 1.0


def test_topics_by_name():
    kinds = {f"/{name}/{side}/image_raw": "sensor_msgs/msg/Image" for name in "ab" for side in ("left", "right")}
    kinds["/o"] = "nav_msgs/msg/Odometry"
    with pytest.raises(InputError, match="name the left and the right topic"):
        find_topics(kinds, None, None, None)
    with pytest.raises(InputError, match="no topic /o of this kind"):
        find_topics(kinds, "/o", None, None)
    assert find_topics(kinds, "/a/left/image_raw", None, None)[:2] == ("/a/left/image_raw", "/a/right/image_raw")
    rectified = kinds | {f"/b/{side}/image_rect": "sensor_msgs/msg/Image" for side in ("left", "right")}
    assert find_topics(rectified, None, None, None) == ("/b/left/image_rect", "/b/right/image_rect", "/o")


@pytest.mark.parametrize("kind", ["pose", "speed", "optical", "/tf"])
def test_motion_by_odometry(kind):
    """A circle, by poses, by speeds alone, in the axes of a camera, and in transforms."""
    moves, (speed, curvature) = Moves(), DRIVEN
    for n in range(5):
        angle, time = speed * curvature * n / RATE, n / RATE
        pose = Pose(math.sin(angle) / curvature, (1 - math.cos(angle)) / curvature, angle)
        if kind == "/tf":
            others = [
                ros.transform("map", "odom", Pose(9.0, n, n), time),
                ros.transform("base_link", "arm", pose, time),
            ]
            parts = [*others, ros.transform("odom", "base_footprint", pose, time)]
            message = ros.new("tf2_msgs/msg/TFMessage", parts)
        else:
            message = ros.odometry(Pose(0.0, 0.0, 0.0) if kind == "speed" else pose, DRIVEN, time)
        if kind == "optical":  # x right, y down, z ahead; the world's axes as well
            message.child_frame_id, at, q = (
                "left_optical_frame",
                message.pose.pose.position,
                message.pose.pose.orientation,
            )
            (at.x, at.y, at.z), (q.y, q.z) = (-at.y, 0.0, at.x), (-q.z, 0.0)
        moves.add(message, time)
    assert moves.mean() == pytest.approx(DRIVEN, rel=1e-3)
    assert moves.path_m == pytest.approx(speed * 4 / RATE, rel=1e-3)
    assert moves.up_m == pytest.approx(0.0, abs=1e-9)


def test_a_turn_on_the_spot_turns():
    """Its command has a curvature that is finite; the heading is that of odometry."""
    moves = Moves()
    for n in (0, 1):
        moves.add(ros.odometry(Pose(0.0, 0.0, 0.1 * n), DriveCommand(0.0, 0.0), n / RATE), n / RATE)
    speed, curvature = moves.mean()
    assert speed * curvature / RATE == pytest.approx(0.1)
    assert abs(speed) < 0.01


@pytest.mark.parametrize(("binning", "offset"), [(2, (0, 0)), (1, (40, 30)), (2, (40, 30))])
def test_parts_of_images_have_their_own_calibration(tmp_path, binning, offset):
    """REP 104: camera_info is of the whole sensor, of which images are a region whose pixels are joined."""
    (cx, cy), (x, y) = SMALL_RIG.center, offset
    sensor = StereoRig(0.12, 107.0 * binning, 400, 300, cx=cx * binning + x, cy=cy * binning + y)
    infos = camera_infos(sensor)
    for info in infos:
        info.binning_x = info.binning_y = binning
        info.roi.x_offset, info.roi.y_offset, info.roi.width, info.roi.height = x, y, 160 * binning, 120 * binning
    rig = StereoBag(write_bag(tmp_path / "bag", StoragePlugin.SQLITE3, count=2, infos=infos)).rig
    values = (rig.baseline, rig.focal, rig.width, rig.height, *rig.center)
    assert values == pytest.approx((0.12, 107.0, 160, 120, cx, cy))


def test_stamps_of_zero_other_calibrations_and_times_apart(tmp_path, capsys, monkeypatch):
    """The times are those of recording; pairs are as near as asked for, and the reason is given where there is none."""
    monkeypatch.setattr(ros, "stamp_seconds", lambda message: 0.0)
    bag, rows = write_bag(tmp_path / "bag", StoragePlugin.MCAP, count=4), []
    for n in (0, 1):
        p = [214.0, 0, 79.5, -214 * 0.12 * n, 0, 214, 59.5, 0, 0, 0, 1, 0]
        rows.append(f"P{n}: {' '.join(map(str, p))}\n")
    (tmp_path / "calib.txt").write_text("".join(rows))
    found = StereoBag(bag, calibration=(tmp_path / "calib.txt",))
    times = [frames.time for frames, _ in found.pairs()]
    assert (found.rig.focal, found.by_log) == (214.0, True)
    assert times == pytest.approx([START + n / RATE for n in range(4)])
    monkeypatch.undo()
    arguments = ["import", str(bag), "--out", str(tmp_path / "o.mcap"), "--apart-ms", "1"]
    assert main(arguments) == 1
    assert "nearest are 2 ms apart, more than 1 ms" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("later", "shift", "unpaired", "words"),
    [
        (0.002, 0, [0, 0], ""),
        (0.04, 0, [1, 1], "right images are -10.0 ms later than left ones (-10.0 to -10.0; 50.0 between frames)"),
        (0.04, 0, [1, 1], "--shift-ms -10, or by 40"),
        (0.04, 40, [0, 0], ""),
        (-0.01, 30, [1, 1], "--shift-ms 40, or by -10"),
    ],
)
def test_cameras_whose_clocks_differ(tmp_path, capsys, later, shift, unpaired, words):
    """A line says how far the stamps of a pair are apart, and the shift with which each image has its own partner."""
    bag = write_bag(tmp_path / "bag", StoragePlugin.MCAP, count=10, later=later)
    assert main(["import", str(bag), "--out", str(tmp_path / "o.mcap"), "--shift-ms", str(shift), "--json"]) == 0
    out, err = capsys.readouterr()
    assert json.loads(out)["unpaired"] == unpaired
    assert words in err
    assert ("later" in err) == bool(words)


def test_a_camera_of_half_the_rate(tmp_path):
    """The rate is that of the pairs."""
    skip = {(n, False) for n in range(1, 12, 2)}
    found = StereoBag(write_bag(tmp_path / "bag", StoragePlugin.MCAP, count=12, skip=skip))
    assert len(list(found.pairs())) == 6
    assert (found.rate, found.alone) == (pytest.approx(RATE / 2, rel=1e-3), [6, 0])


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda image: image, ""),
        (lambda image: image.roll(2, -2), "right image is 2 rows lower"),
        (lambda image: image * 0, "right image is black, white or plain"),
        (lambda image: image // 8, "right image is blurred or dark"),
        (lambda image: image.roll(12, -1), "farther than 0.75 m"),
        (lambda image: image.roll(-19, -1), "nearer than 0.29 m"),
    ],
)
def test_the_reason_for_few_ranges(change, reason):
    """A wall .5 m ahead, 24 pixels of disparity, in images of noise."""
    left = torch.randint(0, 256, (1, 1, 120, 200), generator=torch.Generator().manual_seed(1), dtype=torch.uint8)
    rig, right = StereoRig(0.12, 100.0, 160, 120), left[..., 24:184]
    params = SearchParams(min_disparity_px=16, max_disparity_px=42)
    given = StereoFrames(left[..., :160].clone(), change(right), 0.0)
    words = why_few_ranges(rig, given, params)
    assert reason in words
    assert bool(words) == bool(reason)


@pytest.mark.parametrize("content", [b"", b"SQLite format 3\0", b"\x89MCAP0\r\n" + bytes(40)])
@pytest.mark.parametrize("suffix", [".mcap", ".bag", ".db3"])
def test_what_is_no_bag_is_one_line(tmp_path, capsys, content, suffix):
    path = tmp_path / f"bag{suffix}"
    path.write_bytes(content)
    assert main(["import", str(path), "--out", str(tmp_path / "o.mcap")]) == 2
    err = capsys.readouterr().err
    assert err.startswith("error:")
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("encoding", "channels", "pixel", "expected"),
    [
        ("rgb8", 3, (1, 2, 3), (1, 2, 3)),
        ("bgra8", 4, (1, 2, 3, 9), (3, 2, 1)),
        ("mono8", 1, (7,), (7,)),
        ("mono16", 2, (1, 200), (200,)),
        ("rgb16", 6, (9, 1, 9, 2, 9, 3), (1, 2, 3)),
        ("yuv422", 2, (128, 90), (86, 86, 86)),
    ],
)
def test_encodings_of_images(encoding, channels, pixel, expected):
    data = np.tile(np.array(pixel, np.uint8), (6 * 8, 1)).reshape(-1)
    layout = 6, 8, encoding, 0, 8 * channels, data
    message = ros.new("sensor_msgs/msg/Image", ros.header(0.0, "x"), *layout)
    image = ros.image_pixels(message)
    assert image.shape == (1, len(expected), 6, 8)
    assert image[0, :, 2, 4].tolist() == pytest.approx(list(expected), abs=2)
    for changed in ({"height": 0}, {"width": 2**31}, {"encoding": "?"}, {"data": data[:9]}):
        for name, value in changed.items():
            message = ros.new("sensor_msgs/msg/Image", ros.header(0.0, "x"), *layout)
            setattr(message, name, value)
            with pytest.raises(InputError):
                ros.image_pixels(message)


def read_again(message):
    """A message, decoded from its definition by `mcap-ros2-support`."""
    name = message.__msgtype__
    text = get_typestore(Stores.ROS2_JAZZY).generate_msgdef(name, ros_version=2)[0]
    return DecoderFactory().decoder_for("cdr", Schema(1, text.encode(), "ros2msg", name))(ros.to_cdr(message))


def test_transforms_lead_to_the_place_in_the_map():
    """`map` -> `odom` -> `base_link`, one after the other, is where the localiser has the car."""
    place = Pose(3.0, 4.0, 0.7)
    outer, inner = read_again(ros.transforms(Pose(1.0, -2.0, -0.4), place, 0.0)).transforms
    assert (outer.header.frame_id, outer.child_frame_id) == ("map", inner.header.frame_id)
    turn, other = (2 * math.atan2(q.z, q.w) for q in (outer.transform.rotation, inner.transform.rotation))
    at, by = outer.transform.translation, inner.transform.translation
    x = at.x + math.cos(turn) * by.x - math.sin(turn) * by.y
    y = at.y + math.sin(turn) * by.x + math.cos(turn) * by.y
    assert (x, y, turn + other) == pytest.approx(tuple(place))
