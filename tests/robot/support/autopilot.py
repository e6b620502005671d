"""A scripted autopilot on UDP, in place of a rover: what it hears, and what it does at a fault."""

import os
import socket
import threading
import time

os.environ.setdefault("MAVLINK20", "1")

GUIDED = 15


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as found:
        found.bind(("127.0.0.1", 0))
        return found.getsockname()[1]


class Autopilot:
    """ArduPilot Rover, as far as a companion computer sees it; it does at once what its set-points say.

    Attributes:
        armed, mode, beats, system: what it does from now on; change them from outside.
        heard: all messages so far.
        set_points: speed and yaw rate of those that it was in the mode for.
    """

    def __init__(self, port, system=1, mode=GUIDED, armed=True):
        from pymavlink import mavutil

        self.line = mavutil.mavlink_connection(
            f"udpout:127.0.0.1:{port}", source_system=system, source_component=1, dialect="common"
        )
        self.system, self.mode, self.armed = system, mode, armed
        self.beats = True
        self.heard, self.set_points, self.motion = [], [], (0.0, 0.0)
        self.ended = threading.Event()
        self.thread = threading.Thread(target=self.work, daemon=True)
        self.thread.start()

    def work(self):
        while not self.ended.wait(0.01):
            if self.beats:
                self.tell()
            while (message := self.line.recv_msg()) is not None:
                self.take(message)

    def tell(self):
        mav, flags = self.line.mav, 1 | (128 if self.armed else 0)
        mav.heartbeat_send(10, 3, flags, self.mode, 4)
        speed, turn = self.motion
        mav.attitude_send(0, 0.0, 0.0, 0.5, 0.0, 0.0, turn)  # its nose at 0.5 rad to the east of north
        mav.local_position_ned_send(0, 1.0, 2.0, 0.0, speed * 0.8775825619, speed * 0.4794255386, 0.0)
        mav.sys_status_send(0, 0, 0, 0, 12600, 0, 0, 0, 0, 0, 0, 0, 0)

    def take(self, message):
        self.heard.append(message)
        if message.get_type() == "SET_POSITION_TARGET_LOCAL_NED" and self.armed and self.mode == GUIDED:
            self.motion = (message.vx, message.yaw_rate)
            self.set_points.append(self.motion)

    def of_type(self, name):
        return [message for message in self.heard if message.get_type() == name]

    def close(self):
        self.ended.set()
        self.thread.join(5)
        self.line.close()


def wait_for(true, seconds=20.0):
    """Until something is so; the result of the last look."""
    end = time.monotonic() + seconds
    while not (found := true()) and time.monotonic() < end:
        time.sleep(0.005)
    return found
