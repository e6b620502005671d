"""Opening cameras: what they are set to, what they say of it, and why they cannot be opened."""

import os

import cv2
import pytest

from ndtorch.errors import InputError
from ndtorch_robot.cameras import CameraSettings, StereoCameras, find_source, list_devices, open_capture
from ndtorch_robot.cameras.source import set_up
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
