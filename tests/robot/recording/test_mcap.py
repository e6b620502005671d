"""A recording is what others read: `mcap` by its index, `mcap-ros2-support` and `rosbags` agree on what is in it."""

import json
import math

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.typesys import Stores, get_typestore

from ndtorch.navigation import StereoRig, cut_strips
from ndtorch_robot.recording import Recorder
from tests.robot.support.bare_car import FilmCar, bare_loop
from tests.robot.support.moving_world import moving_world

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
