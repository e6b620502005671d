"""Opening cameras: what they are set to, what they say of it, and why they cannot be opened."""

import os
import sys
import types

import cv2
import numpy as np
import pytest

from ndtorch.errors import InputError
from ndtorch_robot.cameras.pair import StereoCameras
from ndtorch_robot.cameras.source import CameraSettings, find_source, list_devices, open_capture, set_up
from tests.robot.support.fake_captures import Properties

SETTINGS = CameraSettings(left="0", right="1")
DEVICE = find_source("0")


def test_what_a_name_means(tmp_path):
    assert find_source("2") == ("device", "2", "/dev/video2")
    assert find_source("/dev/v4l/by-path/pci-usb-video-index0").kind == "device"
    assert find_source("http://host/stream").kind == "stream"
    os.mkfifo(tmp_path / "pipe")
    assert find_source(str(tmp_path / "pipe")).kind == "stream"


def test_settings_are_set_in_order_and_read_back():
    camera = Properties()
    set_up(camera, DEVICE, SETTINGS)
    assert camera.values == {
        cv2.CAP_PROP_FOURCC: cv2.VideoWriter.fourcc(*"MJPG"),
        cv2.CAP_PROP_FRAME_WIDTH: 640,
        cv2.CAP_PROP_FRAME_HEIGHT: 480,
        cv2.CAP_PROP_FPS: 30.0,
        cv2.CAP_PROP_BUFFERSIZE: 2,
        cv2.CAP_PROP_AUTO_EXPOSURE: 1,
        cv2.CAP_PROP_EXPOSURE: 100,
    }
    order = [cv2.CAP_PROP_FOURCC, cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT, cv2.CAP_PROP_FPS]
    assert camera.order[:4] == order
    set_up(Properties({cv2.CAP_PROP_FPS: 29.97}), DEVICE, SETTINGS)
    camera = Properties()
    set_up(camera, DEVICE, SETTINGS.model_copy(update={"exposure_ms": None}))
    assert camera.values[cv2.CAP_PROP_AUTO_EXPOSURE] == 3
    assert cv2.CAP_PROP_EXPOSURE not in camera.values


@pytest.mark.parametrize(
    ("stubborn", "message"),
    [
        ({cv2.CAP_PROP_FOURCC: cv2.VideoWriter.fourcc(*"YUYV")}, "fourcc 'MJPG' became 'YUYV'"),
        ({cv2.CAP_PROP_FRAME_HEIGHT: 360}, "height 480 became 360"),
        ({cv2.CAP_PROP_FPS: 15.0}, "frames a second 30 became 15"),
        ({cv2.CAP_PROP_AUTO_EXPOSURE: 3}, "auto_exposure 1 became 3"),
        ({cv2.CAP_PROP_EXPOSURE: 312}, "exposure 100 became 312"),
    ],
)
def test_settings_that_are_not_taken(stubborn, message):
    with pytest.raises(InputError, match=r"camera 0 does not do what was asked: .*v4l2-ctl -d /dev/video0") as error:
        set_up(Properties(stubborn), DEVICE, SETTINGS)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_a_device_that_is_no_camera():
    with pytest.raises(InputError, match="no camera that gives images"):
        open_capture(find_source("/dev/full"), SETTINGS)


def test_what_is_no_camera(tmp_path):
    with pytest.raises(InputError, match="neither device nor address"):
        StereoCameras(CameraSettings(left=str(tmp_path), right="0"))


def kernel(tmp_path):
    """Two USB cameras with a metadata node each, and a camera that is on no bus."""
    classes, links = tmp_path / "class", tmp_path / "dev" / "v4l" / "by-path"
    links.mkdir(parents=True)
    eyes = ((0, "Left eye", "1-2"), (2, "Right eye", "1-3"))
    nodes = [(first + index, index, name, port) for first, name, port in eyes for index in (0, 1)]
    for number, index, name, port in [*nodes, (10, 0, "Built in", "")]:
        entry, node = classes / f"video{number}", tmp_path / "dev" / f"video{number}"
        entry.mkdir(parents=True)
        (entry / "name").write_text(name + "\n")
        (entry / "index").write_text(f"{index}\n")
        node.write_text("")
        if port:
            (links / f"pci-usb-0:{port}:1.0-video-index{index}").symlink_to(node)
    return classes, tmp_path / "dev"


def test_what_the_kernel_knows(tmp_path):
    classes, dev = kernel(tmp_path)
    found = list_devices(classes, dev)
    assert [device.node for device in found] == [f"{dev}/video0", f"{dev}/video2", f"{dev}/video10"]
    assert found[1].name == "Right eye"
    assert found[1].by_path.endswith("by-path/pci-usb-0:1-3:1.0-video-index0")
    assert found[2].by_path is None
    assert list_devices(tmp_path / "nowhere", dev) == []


class Picamera2:
    """As picamera2 0.3.36: the names and signatures that are used of it."""

    camera_controls = dict.fromkeys(["FrameDurationLimits", "ExposureTime", "AnalogueGain", "AeEnable"], (0, 1, None))

    def __init__(self, camera_num=0, verbose_console=None, tuning=None, allocator=None):
        self.number, self.controls, self.released, self.n = camera_num, {}, 0, 0
        if camera_num > 1:
            raise IndexError("list index out of range")

    def create_video_configuration(self, main=None, lores=None, raw=None, buffer_count=6, controls=None, queue=True):
        return {"main": main, "controls": controls}

    def configure(self, camera_config="preview"):
        self.main, self.controls = camera_config["main"], dict(camera_config["controls"])

    def start(self, config=None, show_preview=False):
        self.n = 1

    def capture_metadata(self, wait=None):
        self.n += 1
        return {"ExposureTime": 9998, "AnalogueGain": 1.0 + 1 / self.n, "ColourGains": (1.5, 2.0), "Lux": 80.0}

    def set_controls(self, controls):
        if not controls.keys() <= self.camera_controls.keys():
            raise RuntimeError("Control is not advertised by libcamera")
        self.controls |= controls

    def capture_request(self, wait=None, flush=None):
        self.n += 1
        return self

    def make_array(self, name):
        return np.full((*self.main["size"][::-1], 3), self.n, np.uint8)

    def get_metadata(self):
        return {"SensorTimestamp": int(4e9) + 33_333_000 * self.n}

    def release(self):
        self.released += 1

    def close(self):
        self.n = 0


@pytest.mark.parametrize("color", [True, False])
def test_a_module_of_a_raspberry_pi_keeps_its_exposure_and_has_the_time_of_its_sensor(monkeypatch, color):
    if color:
        more = {"ColourGains": (0.0, 32.0, None), "AwbEnable": (False, True, None)}
        monkeypatch.setattr(Picamera2, "camera_controls", Picamera2.camera_controls | more)
    monkeypatch.setitem(sys.modules, "picamera2", types.SimpleNamespace(Picamera2=Picamera2))
    settings = CameraSettings(left="picamera2:0", right="picamera2:1", width_px=64, height_px=48)
    capture = open_capture(find_source("picamera2:1"), settings)
    device = capture.device
    assert device.number == 1
    assert device.controls == {
        "FrameDurationLimits": (33333, 33333),
        "ExposureTime": 9998,
        "AnalogueGain": 1.0 + 1 / 31,
        "AeEnable": False,
        **({"ColourGains": (1.5, 2.0), "AwbEnable": False} if color else {}),
    }
    assert capture.grab()
    good, image = capture.retrieve()
    assert (good, image.shape, device.released) == (True, (48, 64, 3), 1)
    assert capture.get(cv2.CAP_PROP_POS_MSEC) == pytest.approx(4000 + 33.333 * 32)
    with pytest.raises(InputError, match="camera picamera2:7: cannot be opened"):
        open_capture(find_source("picamera2:7"), settings)
