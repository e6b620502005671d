"""A run as a recording for the rerun viewer, written to a file while the run goes on.

Look at a recording with `rerun run.rrd`. Nothing here opens a network port.
"""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any

from torch import Tensor

from ndtorch.errors import InputError
from ndtorch.report.films import marked, resized, rgb
from ndtorch.run.result import Picture, Pixels, Watcher, over_fields
from ndtorch.utils.packages import need
from ndtorch.vision.features import FEATURES

TIMELINE = "time"
LARGEST_SIDE = 640
"""Larger frames are shrunk to this many pixels; as JPEG, 15 s at 25 pictures a second take 1 to 40 MB."""
JPEG_QUALITY = 80
END, TAIL = b"RRF2FOOT", 64
"""What a file that was written to its end has in so many last bytes."""


def why_not_whole(path: Path) -> str | None:
    """What is wrong with a recording that was closed, in one line; None where it was written to its end.

    The writer of the SDK only logs what goes wrong: on a full disk it leaves half a file that no viewer opens.
    """
    try:
        with path.open("rb") as file:
            file.seek(max(0, path.stat().st_size - TAIL))
            whole = END in file.read()
    except OSError as error:
        return f"the recording {path} cannot be read: {error.strerror}"
    return None if whole else f"the recording {path} is not whole: the disk was full, or failed"


def end_stream(stream: Any, patience: float = 15.0) -> None:
    """Write what is waiting and close a stream; `why_not_whole` tells what could not be written.

    On a full disk the writer of the SDK ends by itself. Whatever waits for it then waits forever: a flush, closing the
    stream, and the end of the program. Such a stream is left as it is.
    """
    try:
        stream.flush(timeout_sec=patience)
    except RuntimeError:
        import_rerun().unregister_shutdown()
        for kept in (stream, stream.inner):
            ctypes.pythonapi.Py_IncRef(ctypes.py_object(kept))  # never closed
        return
    stream.disconnect()


class Recording(Watcher):
    """A .rrd file with the frames, outputs, weights and objects of one binding run, and how to lay them out.

    Times are seconds since the first frame. Entities: `input` and `enhanced` (JPEG), `winner` (text), `outputs` (ten
    series), `weights`, `objects`.

    Args:
        path: the file; its folder is made if missing, an older file is replaced.

    Raises:
        InputError: rerun is not installed, or the file cannot be written.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._rr = rr = import_rerun()
        self._stream: Any = rr.RecordingStream("ndtorch bind")
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._stream.save(self.path, default_blueprint=layout())
        except (OSError, RuntimeError) as error:
            raise InputError(f"cannot write the recording {self.path}: {error}") from None
        lines = rr.SeriesLines(colors=[rgb(feature) for feature in FEATURES], names=FEATURES)
        self._stream.log("outputs", lines, static=True)

    def picture(self, picture: Picture) -> None:
        self._stream.set_time(TIMELINE, duration=picture.time)
        shown = marked(picture.frame, picture.objects) if picture.enhanced is None else picture.enhanced
        if picture.enhanced is None:
            text = ", ".join(thing.color for thing in picture.objects) or "nothing in sight"
        else:
            text = f"{FEATURES[picture.winner]} wins" if picture.winner >= 0 else "no winner yet"
        self._stream.log("input", self._jpeg(picture.frame))
        self._stream.log("enhanced", self._jpeg(shown))
        self._stream.log("winner", self._rr.TextDocument(text))

    def signals(self, signals: Any, weights: Tensor, state: Any) -> None:
        if not len(signals.time):
            return
        times = signals.time.tolist()
        columns = self._rr.Scalars.columns(scalars=over_fields(signals.outputs).cpu().float().numpy())
        index = self._rr.TimeColumn(TIMELINE, duration=times)
        self._stream.send_columns("outputs", indexes=[index], columns=columns)
        self._stream.set_time(TIMELINE, duration=times[-1])
        self._stream.log("weights", self._rr.Tensor(weights.cpu().float().numpy(), dim_names=("to", "from")))

    def finish(self, text: str) -> None:
        """Add the objects in words and close the file."""
        self._stream.log("objects", self._rr.TextDocument(text))
        end_stream(self._stream)

    def _jpeg(self, pixels: Pixels) -> Any:
        import cv2

        small = resized(pixels, LARGEST_SIDE)[..., ::-1]
        _, jpeg = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
        return self._rr.EncodedImage(contents=jpeg.tobytes(), media_type="image/jpeg")


def import_rerun() -> Any:
    """The rerun package, which takes half a second to import."""
    return need("rerun", "a recording")


def layout() -> Any:
    """Images on top, outputs below them, weights and objects at the right; it opens at the end of the run."""
    import rerun.blueprint as rrb

    images = [rrb.Spatial2DView(origin=name, name=name) for name in ("input", "enhanced")]
    plain = rrb.archetypes.TextDocumentFormat(monospace=True, word_wrap=True)
    texts = [rrb.TextDocumentView(origin=name, name=name, format_options=plain) for name in ("winner", "objects")]
    outputs = rrb.TimeSeriesView(origin="outputs", name="outputs of the network")
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(rrb.Horizontal(*images), outputs, row_shares=[3, 2]),
            rrb.Vertical(rrb.TensorView(origin="weights", name="weights"), *texts, row_shares=[6, 1, 3]),
            column_shares=[5, 2],
        ),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following"),
        collapse_panels=True,
        auto_views=False,
    )
