"""OpenCV without its own messages."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def quiet_opencv() -> Iterator[None]:
    """Keep OpenCV's own messages off stderr: what went wrong is said once, in an `InputError`.

    OpenCV's log level is put back afterwards. FFmpeg inside OpenCV takes its level from the environment once,
    as the first video is opened; it stays quiet for the process unless `OPENCV_FFMPEG_LOGLEVEL` was set.
    """
    import cv2

    variable = "OPENCV_FFMPEG_LOGLEVEL"
    level = cv2.utils.logging.getLogLevel()
    ours = variable not in os.environ
    if ours:
        os.environ[variable] = "-8"
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        cv2.utils.logging.setLogLevel(level)
        if ours:
            os.environ.pop(variable, None)
