"""Bags of others, written by `rosbags`: the navigator sees what the bag shows, and drives as it would without it."""

import json
import math

import cv2
import numpy as np
import pytest
import torch
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from ndtorch.cli.commands import main
from ndtorch.errors import InputError
from ndtorch.navigation import Body, StereoRig, cut_strips
from ndtorch_robot import ros_messages as ros
from ndtorch_robot.ports import DriveCommand
from ndtorch_robot.recording import Recorder, open_recording
from ndtorch_robot.recording.bags import Motion, StereoBag, find_topics
from ndtorch_robot.recording.replay import make_runner
from tests.robot.support.cars import FilmCar, bare_loop, moving_world

SMALL_RIG = StereoRig(width=160, height=120, focal=107.0, baseline=0.12)
DRIVEN, RATE, START = DriveCommand(0.4, 0.5), 20.0, 1.7e9


def place(n):
    """Where a robot is that drives a circle."""
    k, s = DRIVEN.curvature, DRIVEN.speed * n / RATE
    return ros.Pose(math.sin(k * s) / k, (1 - math.cos(k * s)) / k, k * s)


def images(frames, n, kind):
    for side, eye in zip(("left", "right"), frames[:2], strict=True):
        time, frame = START + n / RATE + (0.002 if side == "right" else 0.0), f"{side}_optical"
        if kind == "raw":
            message = ros.image(eye, frame, time)
            message.encoding, message.data = "bgr8", message.data.reshape(-1, 3)[:, ::-1].reshape(-1)
            yield f"/stereo/{side}/image_rect_color", message
        else:
            array = cv2.cvtColor(eye[0].permute(1, 2, 0).numpy(), cv2.COLOR_RGB2BGR)
            data = cv2.imencode(".png", array)[1].tobytes()
            yield f"/stereo/{side}/image_rect_color/compressed", ros.compressed_image(data, "bgr8; png", frame, time)


ROS1 = get_typestore(Stores.ROS1_NOETIC)


def to_ros1(message):
    """The same message of ROS 1: headers are counted, and matrices of a camera have capital letters."""
    if isinstance(message, list):
        return [to_ros1(part) for part in message]
    if not hasattr(message, "__msgtype__"):
        return message
    kind = ROS1.types[message.__msgtype__]
    names = [name for name in kind.__dataclass_fields__ if name != "__msgtype__"]
    values = {name: to_ros1(getattr(message, name, getattr(message, name.lower(), 0))) for name in names}
    return kind(**values)


def write_bag(folder, plugin, kind, count=30, odometry=True, skip=()):
    """A bag of ROS 2, or of ROS 1 without a plugin."""
    if plugin is None:
        folder, types = folder.with_suffix(".bag"), ROS1
        writer = Ros1Writer(folder)
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
                add("/odom", ros.odometry(place(n), DRIVEN, START + n / RATE - 0.001), n)
            for topic, message in images(frames, n, kind):
                if (n, "left" in topic) not in skip:
                    add(topic, message, n)
            if n == 0:
                for side, info in zip(("left", "right"), ros.camera_infos(SMALL_RIG), strict=True):
                    add(f"/stereo/{side}/camera_info", info, n)
    return folder


@pytest.mark.parametrize(
    ("plugin", "kind", "single"),
    [
        (StoragePlugin.SQLITE3, "raw", False),
        (StoragePlugin.MCAP, "compressed", False),
        (StoragePlugin.MCAP, "raw", True),
        (None, "raw", False),
        (None, "compressed", False),
    ],
)
def test_a_bag_becomes_a_recording_that_replays(tmp_path, capsys, plugin, kind, single):
    bag = write_bag(tmp_path / "bag", plugin, kind, skip={(4, True), (9, False)})
    path = next(bag.glob("*.mcap")) if single else bag
    out = tmp_path / "out.mcap"
    assert main(["import", str(path), "--out", str(out), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["steps"], told["odometry"], told["rate_hz"]) == (28, "/odom", pytest.approx(RATE, rel=1e-3))
    assert told["ranges"] > 50
    recording = open_recording(out)
    steps, world = list(recording.steps()), list(moving_world(30, SMALL_RIG))
    seen = [n for n in range(30) if n not in (4, 9)]
    assert [round((step.time - START) * RATE) for step in steps] == seen
    fields = StereoBag(path).rig.subfields()
    for step, n in list(zip(steps, seen, strict=True))[::9]:
        assert torch.equal(step.frames.left.field, cut_strips(world[n].left, fields[0], SMALL_RIG).field)
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
camera_height_m = 0.1
camera_pitch_deg = 2.0
camera_forward_m = 0.07
[navigation]
controller = "ranging"
"""


def test_the_navigator_of_a_bag_has_the_body_of_its_robot(tmp_path):
    """Body, cameras and options are the file's unless the command has others; calibration and rate are the bag's."""
    file, bag, told = tmp_path / "my.toml", write_bag(tmp_path / "bag", None, "raw", 3), []
    file.write_text(ROBOT)
    for n, more in enumerate(((), ("--controller", "published", "--camera-height", "0.12"))):
        out = tmp_path / f"{n}.mcap"
        assert main(["import", str(bag), "--robot", str(file), "--out", str(out), *more]) == 0
        told.append(make_runner(open_recording(out).configuration))
    for runner, name, height in zip(told, ("ranging", "published"), (0.1, 0.12), strict=True):
        assert (runner.body, runner.options.controller) == (Body(0.25, 0.18, 0.2), name)
        assert (runner.rig.camera_height, runner.rig.forward, runner.options.stereo) == (height, 0.07, "search")
        assert math.degrees(runner.rig.pitch) == pytest.approx(2.0)
        assert (runner.rig.focal, runner.rig.baseline) == (pytest.approx(107.0), pytest.approx(0.12))
        assert runner.rate == pytest.approx(RATE, rel=1e-3)


def test_raw_images_are_rectified(tmp_path, monkeypatch):
    """A lens that bends: points of the rectified image are where the calibration has them."""
    infos = ros.camera_infos(SMALL_RIG)
    for info in infos:
        info.d = np.array([-0.2, 0.05, 0.0, 0.0, 0.0])
    monkeypatch.setattr(ros, "camera_infos", lambda rig: infos)
    bag = StereoBag(write_bag(tmp_path / "bag", StoragePlugin.SQLITE3, "raw", 2))
    bag.is_rectified = False  # what the names of these topics say is wrong
    raw = np.zeros((120, 160, 3), np.uint8)
    ray = np.array([[0.5, 0.3, 1.0]])
    k = infos[0].k.reshape(3, 3)
    bent = cv2.projectPoints(ray, np.zeros(3), np.zeros(3), k, infos[0].d)[0].reshape(2)
    straight = cv2.projectPoints(ray, np.zeros(3), np.zeros(3), k, np.zeros(5))[0].reshape(2)
    assert np.hypot(*(bent - straight)) > 3
    cv2.circle(raw, tuple(int(v) for v in bent.round()), 2, (255, 255, 255), -1)
    message = ros.image(torch.from_numpy(raw).permute(2, 0, 1)[None], "left", 0.0)
    row, column = np.argwhere(bag.frames(message, message, 0.0).left[0, 0].numpy() > 100).mean(0)
    assert np.hypot(column - straight[0], row - straight[1]) < 1.0


def test_a_bag_without_odometry_says_so(tmp_path, capsys):
    bag = write_bag(tmp_path / "bag", StoragePlugin.SQLITE3, "raw", 3, odometry=False)
    assert main(["import", str(bag), "--out", str(tmp_path / "o.mcap")]) == 0
    assert "no odometry" in "".join(capsys.readouterr())


KINDS = {
    "/a/left/image_raw": "sensor_msgs/msg/Image",
    "/a/right/image_raw": "sensor_msgs/msg/Image",
    "/b/left/image_raw": "sensor_msgs/msg/Image",
    "/b/right/image_raw": "sensor_msgs/msg/Image",
    "/o": "nav_msgs/msg/Odometry",
}


def test_topics_by_name():
    with pytest.raises(InputError, match="name the left and the right topic"):
        find_topics(KINDS, None, None, None)
    with pytest.raises(InputError, match="no topic /o of this kind"):
        find_topics(KINDS, "/o", None, None)
    assert find_topics(KINDS, "/a/left/image_raw", None, None)[:2] == ("/a/left/image_raw", "/a/right/image_raw")
    rectified = KINDS | {f"/b/{side}/image_rect": "sensor_msgs/msg/Image" for side in ("left", "right")}
    assert find_topics(rectified, None, None, None) == ("/b/left/image_rect", "/b/right/image_rect", "/o")


def test_a_turn_on_the_spot_turns():
    """Its command has a curvature that is finite; the heading is that of odometry."""
    motion = Motion()
    for n in range(2):
        motion.add(ros.odometry(ros.Pose(0.0, 0.0, 0.1 * n), DriveCommand(0.0, 0.0), n / RATE))
    speed, curvature = motion.take()
    assert speed * curvature / RATE == pytest.approx(0.1)
    assert abs(speed) < 0.01


@pytest.mark.parametrize("content", [b"", b"SQLite format 3\0", b"\x89MCAP0\r\n" + bytes(40)])
@pytest.mark.parametrize("suffix", [".mcap", ".bag", ".db3"])
def test_what_is_no_bag_is_one_line(tmp_path, capsys, content, suffix):
    path = tmp_path / f"bag{suffix}"
    path.write_bytes(content)
    assert main(["import", str(path), "--out", str(tmp_path / "o.mcap")]) == 2
    err = capsys.readouterr().err
    assert err.startswith("error:")
    assert err.count("\n") == 1
    assert not (tmp_path / "o.mcap").exists()


RIG, COUNT = StereoRig(width=160, height=120, focal=107.0, baseline=0.12), 60


@pytest.fixture(scope="module")
def driven(tmp_path_factory):
    """A recording of two seconds, and the steps as they were."""
    path, steps = tmp_path_factory.mktemp("mcap") / "r.mcap", []
    loop = bare_loop(
        FilmCar(moving_world(COUNT, RIG)), RIG, controller="published", stereo="search", map_half_size_m=5.0
    )
    with Recorder(path, loop.runner, when_full="wait") as recorder:
        loop.observers += [recorder, steps.append]
        loop.observers.append(lambda step: loop.safe.emergency("a key") if step.number == 40 else None)
        loop.run((COUNT - 1.5) / 30)
    return path, steps, loop.runner


def decoded(path, topic):
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return [(message.log_time, told) for _, _, message, told in reader.iter_decoded_messages(topics=[topic])]


def test_the_index_says_what_is_in_it(driven):
    path, steps, _ = driven
    with path.open("rb") as file:
        summary = make_reader(file, validate_crcs=True).get_summary()
    counts = {channel.topic: summary.statistics.channel_message_counts[n] for n, channel in summary.channels.items()}
    every = {f"/camera/{side}/{part}": COUNT for side in ("left", "right") for part in ("field", "row")}
    assert every.items() <= counts.items()
    assert counts["/cmd_vel"] == counts["/ndtorch/step"] == len(steps) == COUNT
    assert counts["/scan"] == counts["/odom"] == counts["/tf"] == sum(step.state is not None for step in steps)
    assert counts["/map"] == 2  # at the beginning and at the end
    assert counts["/camera/left/picture/compressed"] == 10
    assert {channel.message_encoding for channel in summary.channels.values()} == {"cdr"}
    assert len(summary.chunk_indexes) >= 6  # .3 s each
    spans = [(index.message_end_time - index.message_start_time) / 1e9 for index in summary.chunk_indexes]
    assert max(spans) <= 0.3 + 1e-6


def test_motion_and_ranges(driven):
    path, steps, _ = driven
    moved = [step for step in steps if step.state is not None]
    for (when, told), step in zip(decoded(path, "/odom"), moved, strict=True):
        assert when == round(step.time * 1e9)
        pose = step.state.pose
        place = told.pose.pose.position
        assert (place.x, place.y) == (float(pose.x), float(pose.y))
        assert told.twist.twist.linear.x == step.driven.speed
    for (_, told), step in zip(decoded(path, "/cmd_vel"), steps, strict=True):
        assert (told.twist.linear.x, told.twist.angular.z) == (step.sent.speed, step.sent.speed * step.sent.curvature)
    seen = 0
    for (_, told), step in zip(decoded(path, "/scan"), moved, strict=True):
        ranges = step.state.ranges
        valid = np.asarray(ranges.valid)
        true = np.hypot(np.asarray(ranges.x), np.asarray(ranges.y))[valid]
        found = np.array([r for r in told.ranges if math.isfinite(r)])
        assert found.size <= true.size
        assert all(np.isclose(true, r, rtol=1e-6).any() for r in found)
        seen += found.size
    assert seen > 20


def test_what_the_navigator_read(driven):
    path, steps, runner = driven
    for k, side in enumerate(("left", "right")):
        messages = decoded(path, f"/camera/{side}/field")
        for (_, told), step in list(zip(messages, steps, strict=True))[::10]:
            strip = cut_strips(step.frames[k], runner.fields[k], RIG).field
            pixels = np.frombuffer(bytes(told.data), np.uint8).reshape(told.height, told.width, 3)
            assert told.encoding == "rgb8"
            assert np.array_equal(pixels, strip[0].permute(1, 2, 0))


def test_why_the_car_stood_and_the_rig(driven):
    path = driven[0]
    told = [message.status[0] for _, message in decoded(path, "/diagnostics")]
    assert told[0].level == 0
    assert (told[-1].level, told[-1].message) == (2, "emergency stop: a key")
    left, right = (decoded(path, f"/camera/{side}/camera_info")[0][1] for side in ("left", "right"))
    rig = StereoRig.from_projections(left.p, right.p, left.width, left.height)
    assert (rig.focal, rig.baseline) == (RIG.focal, pytest.approx(RIG.baseline))


def test_rosbags_reads_it_with_definitions_of_its_own(driven):
    path, steps, _ = driven
    store, found = get_typestore(Stores.ROS2_JAZZY), {"/ndtorch/step": [], "/map": []}
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages(topics=list(found)):
            found[channel.topic].append(store.deserialize_cdr(message.data, schema.name))
    lines = [json.loads(message.data) for message in found["/ndtorch/step"]]
    assert [tuple(line["wanted"]) for line in lines] == [tuple(step.wanted) for step in steps]
    grid = found["/map"][0]
    assert (grid.info.width, grid.info.resolution) == (200, pytest.approx(0.05))
    assert grid.info.origin.position.x == -5.0
