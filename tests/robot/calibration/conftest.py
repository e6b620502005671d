"""OpenCV computes in one thread here."""

import cv2
import pytest


@pytest.fixture(autouse=True)
def one_thread():
    cv2.setNumThreads(1)
