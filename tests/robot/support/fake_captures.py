"""Captures for tests: live ones whose faults are chosen, and an endless film."""

import threading
import time

import cv2
import numpy as np


def picture(n, width=64, height=48):
    return np.random.default_rng(n).integers(0, 255, (height, width, 3), dtype=np.uint8)


class LiveCapture:
    """Frames at a rate, stamped as V4L2 does; `script` says what is wrong from which frame on."""

    def __init__(self, rate=100.0, phase=0.0, size=(64, 48), stops_at=None, hangs_at=None, stamped=True):
        self.period, self.size, self.stops_at, self.hangs_at, self.stamped = 1 / rate, size, stops_at, hangs_at, stamped
        self.start, self.n, self.stamp, self.released = time.monotonic() + phase, -1, 0.0, threading.Event()
        self.picture = picture(1, *size)

    def grab(self):
        self.n += 1
        if self.hangs_at is not None and self.n >= self.hangs_at:
            self.released.wait(2.0)
            return False
        if self.stops_at is not None and self.n >= self.stops_at:
            return False
        due = self.start + self.n * self.period
        time.sleep(max(0.0, due - time.monotonic()))
        self.stamp = due
        return True

    def retrieve(self):
        return True, self.picture

    def get(self, propId):
        return self.stamp * 1e3 if propId == cv2.CAP_PROP_POS_MSEC and self.stamped else 0.0

    def set(self, propId, value):
        return False

    def release(self):
        self.released.set()


class Properties:
    """A camera whose properties can be set, except that `stubborn` ones stay as they are."""

    def __init__(self, stubborn=()):
        self.values, self.stubborn, self.order = dict(stubborn), dict(stubborn), []

    def set(self, propId, value):
        self.order.append(propId)
        if propId not in self.stubborn:
            self.values[propId] = value
        return True

    def get(self, propId):
        return self.values.get(propId, 0.0)
