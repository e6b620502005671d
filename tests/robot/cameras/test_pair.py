"""Two cameras as one: pairing, waiting, faults and coming back."""

import re
import time

import cv2
import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from ndtorch.errors import InputError
from ndtorch_robot.cameras import pair as pair_module
from ndtorch_robot.cameras.pair import CameraFrame, CamerasSilent, Pairing, StereoCameras
from ndtorch_robot.cameras.source import CameraSettings
from tests.robot.support.fake_captures import LiveCapture, picture

SMALL = {"width_px": 64, "height_px": 48}


def live(*captures, **settings):
    """Cameras 0 and 1 from a list of captures each, opened one after the other."""
    left, right = (list(c) if isinstance(c, list) else [c] for c in captures)

    def opener(source, settings):
        queue = left if source.target == "/dev/video0" else right
        if not queue:
            raise InputError(f"camera {source.name}: no such device")
        return queue.pop(0)

    values = SMALL | {"rate_hz": 100.0, "tolerance_ms": 4.5} | settings
    return StereoCameras(CameraSettings(left="0", right="1", **values), opener=opener)


@given(st.lists(st.tuples(st.integers(0, 1), st.integers(0, 20)), max_size=60), st.integers(0, 30))
def test_pairing_uses_no_frame_twice(steps, tolerance):
    pairing, clocks, pairs = Pairing(tolerance / 1000), [0, 0], []
    for side, gap in steps:
        clocks[side] += 1 + gap
        made = pairing.add(side, CameraFrame(None, clocks[side] / 1000))
        pairs += [made] if made else []
    for side in (0, 1):
        times = [pair[side].time for pair in pairs]
        assert sorted(set(times)) == times  # each once, in order
    assert len(pairing.skews) == len(pairs)
    assert all(abs(pair.right.time - pair.left.time) <= tolerance / 1000 for pair in pairs)
    for side in (0, 1):
        given = sum(number == side for number, _ in steps)
        assert given == len(pairs) + pairing.unpaired[side] + pairing.free[side]


def test_frames_are_red_green_blue():
    with live(LiveCapture(), LiveCapture(phase=0.001), max_age_ms=5000) as cameras:
        frames = cameras.read()
    assert frames.left.dtype == torch.uint8
    assert np.array_equal(frames.left[0].permute(1, 2, 0).numpy()[..., ::-1], picture(1))
    assert np.array_equal(frames.right[0, 0].numpy(), picture(1)[..., 2])


@pytest.mark.realtime
def test_newest_pair_only_and_each_once():
    with live(LiveCapture(), LiveCapture(phase=0.002)) as cameras:
        cameras.read()
        time.sleep(0.1)
        first, second = cameras.read(), cameras.read()
        assert second.time > first.time
    assert np.median(cameras.pairing.skews) == pytest.approx(0.002, abs=0.001)


def test_driver_time_is_used_only_if_it_makes_sense():
    capture = LiveCapture()
    capture.stamp = 100.0
    assert pair_module.driver_time(capture, 100.02) == 100.0
    assert pair_module.driver_time(capture, 99.0) == 99.0  # from the future
    assert pair_module.driver_time(capture, 5000.0) == 5000.0  # of another clock
    assert pair_module.driver_time(LiveCapture(stamped=False), 7.0) == 7.0


@pytest.mark.realtime
@pytest.mark.parametrize("fault", [{"stops_at": 20}, {"hangs_at": 20}])
def test_a_camera_that_falls_silent_is_named_in_time(fault):
    with live(LiveCapture(), LiveCapture(**fault), max_age_ms=300) as cameras:
        last = time.monotonic()
        message = ""
        while not message:
            try:
                cameras.read()
                last = time.monotonic()
            except CamerasSilent as error:
                message = str(error)
        assert time.monotonic() - last < 1.5
        assert re.match(r"the right camera \(1\) gave its last frame \d+ ms ago", message)
        assert "left" not in message
        with pytest.raises(CamerasSilent):
            cameras.read()


@pytest.mark.realtime
def test_an_unplugged_camera_comes_back(monkeypatch):
    monkeypatch.setattr(pair_module, "BACK_OFF_S", (0.05,))
    with live(LiveCapture(), [LiveCapture(stops_at=10), LiveCapture()], max_age_ms=40) as cameras:
        silent = None
        until = time.monotonic() + 5
        while time.monotonic() < until:
            try:
                frames = cameras.read()
                if silent is not None:
                    break
            except CamerasSilent as error:
                silent = str(error)
        assert silent is not None
        assert frames.time > 0


@pytest.mark.realtime
def test_times_that_do_not_fit():
    cameras = live(LiveCapture(rate=20), LiveCapture(rate=20, phase=0.025), max_age_ms=800)
    with pytest.raises(CamerasSilent, match=r"more than 4\.5 ms apart"):
        cameras.read()
    cameras.close()


def test_a_camera_without_frames():
    with pytest.raises(InputError, match=r"right camera \(1\) opens but gives no frame .*USB"):
        live(LiveCapture(), LiveCapture(stops_at=0))


def test_another_size():
    with pytest.raises(InputError, match=r"left camera .* gives 32x48 frames, 64x48 are wanted"):
        live(LiveCapture(size=(32, 48)), LiveCapture())


def test_one_camera_whose_images_lie_side_by_side(tmp_path):
    """A film of joined frames, played again and again; a camera named twice by mistake gives too small ones."""
    path, pictures = str(tmp_path / "joined.avi"), (picture(1), picture(2))
    film = cv2.VideoWriter(path, cv2.VideoWriter.fourcc(*"FFV1"), 30.0, (128, 48))
    for _ in range(300):
        film.write(np.hstack(pictures))
    film.release()
    settings, widths = CameraSettings(left="/dev/video0", right="0", max_age_ms=5000, **SMALL), []

    def opener(source, settings):
        widths.append(settings.width_px)
        return cv2.VideoCapture(path)

    with StereoCameras(settings, opener=opener) as cameras:
        pair = cameras.read_pair()
    assert pair.left.time == pair.right.time
    assert widths[0] == 128
    for frame, drawn in zip(pair, pictures, strict=True):
        assert np.abs(frame.image.astype(int) - drawn).max() <= 2
    with pytest.raises(InputError, match=r"one camera, of images side by side: .* gives 32x48"):
        StereoCameras(settings, opener=lambda source, settings: LiveCapture())


@pytest.mark.realtime
def test_close_does_not_wait_for_a_driver_that_hangs():
    cameras = live(LiveCapture(), LiveCapture(hangs_at=5))
    time.sleep(0.15)
    cameras.readers[1].capture.released.clear()
    began = time.monotonic()
    cameras.close()
    assert time.monotonic() - began < 1.8
