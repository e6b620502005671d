"""A run as a recording for the rerun viewer, written to a file while the run goes on.

The only file that knows rerun. Look at a recording with `rerun run.rrd`. Nothing here opens a network port. A
recording is for looking, not an archive of the numbers.
"""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any, Self

import numpy as np
from torch import Tensor

from ndtorch.errors import InputError
from ndtorch.report.plots.layout import rgb
from ndtorch.run.watchers import Pixels
from ndtorch.utils.packages import need
from ndtorch.vision.features import FEATURES, GROUPS

TIMELINE = "time"
BATCH = 256
"""Output samples written at once: one message each would cost more than the network step itself."""
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
            if END in file.read():
                return None
    except OSError as error:
        return f"the recording {path} cannot be read: {error.strerror}"
    return f"the recording {path} is not whole: the disk was full, or failed"


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


class Recording:
    """A .rrd file with the frames, outputs, weights and objects of one binding run, and how to lay them out.

    Use it as a context manager, or call `close`. Times are seconds since the first frame. Entities:
    `input` and `enhanced` (JPEG), `winner` (text), `outputs` (ten series), `weights/matrix`, `objects`.

    Args:
        path: the file; its folder is made if missing, an older file is replaced.
        name: what the viewer calls the recording.

    Raises:
        InputError: rerun is not installed, or the file cannot be written.
    """

    def __init__(self, path: str | Path, name: str = "ndtorch bind") -> None:
        self.path = Path(path)
        self._rr = rr = import_rerun()
        self._stream: Any = rr.RecordingStream(name)
        self._latest = 0.0
        self._times: list[float] = []
        self._outputs: list[np.ndarray[Any, Any]] = []
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._stream.save(self.path, default_blueprint=layout())
        except (OSError, RuntimeError) as error:
            raise InputError(f"cannot write the recording {self.path}: {error}") from None
        colors = [rgb(feature) for feature in FEATURES]
        widths = [2.0 if feature in FEATURES[GROUPS["color"]] else 1.2 for feature in FEATURES]
        self._stream.log("outputs", rr.SeriesLines(colors=colors, names=FEATURES, widths=widths), static=True)
        # Names beside the matrix: senders above their columns, receivers left of their rows.
        places = [(k + 0.5, -0.7) for k in range(10)] + [(-1.2, n + 0.5) for n in range(10)]
        names = rr.Points2D(places, labels=FEATURES * 2, colors=colors * 2, radii=0.02, show_labels=True)
        self._stream.log("weights/names", names, static=True)

    def frame(self, time_s: float, frame: Pixels, shown: Pixels, words: str) -> None:
        """Input and what the model makes of it (enhanced, or with its objects marked), `[H, W, 3]` uint8, and words."""
        self._at(time_s)
        self._stream.log("input", self._picture("frame", frame))
        self._stream.log("enhanced", self._picture("shown", shown))
        self._stream.log("winner", self._rr.TextDocument(words))

    def outputs(self, time_s: float, outputs: Tensor) -> None:
        """Outputs of the network in one step, `[10]`."""
        self._outputs.append(array(outputs, (10,)))
        self._times.append(time_s)
        self._latest = time_s
        if len(self._times) >= BATCH:
            self._write_outputs()

    def weights(self, time_s: float, weights: Tensor) -> None:
        """Weights of the network, `[10, 10]`: column = sender, row = receiver."""
        self._at(time_s)
        values = array(weights, (10, 10))
        image = self._rr.DepthImage(values, meter=1.0, colormap="viridis", depth_range=(0.0, 1.0))
        self._stream.log("weights/matrix", image)

    def objects(self, text: str) -> None:
        """The object table in words, at the latest time given so far."""
        self._at(self._latest)
        self._stream.log("objects", self._rr.TextDocument(text))

    def close(self) -> None:
        """Write what is waiting and close the file. Calling it again does nothing."""
        if self._stream is None:
            return
        self._write_outputs()
        end_stream(self._stream)
        self._stream = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _at(self, time_s: float) -> None:
        self._latest = time_s
        self._stream.set_time(TIMELINE, duration=time_s)

    def _write_outputs(self) -> None:
        if self._times:
            index = self._rr.TimeColumn(TIMELINE, duration=self._times)
            columns = self._rr.Scalars.columns(scalars=np.stack(self._outputs))
            self._stream.send_columns("outputs", indexes=[index], columns=columns)
            self._times, self._outputs = [], []

    def _picture(self, argument: str, pixels: Pixels) -> Any:
        """The frame as a JPEG, shrunk if it is large."""
        import cv2

        if pixels.ndim != 3 or pixels.shape[2] != 3 or pixels.dtype != np.uint8:
            raise InputError(f"{argument} must be [H, W, 3] uint8, got {pixels.shape} {pixels.dtype}")
        height, width = pixels.shape[:2]
        scale = LARGEST_SIDE / max(height, width)
        if scale < 1:
            size = (max(1, round(width * scale)), max(1, round(height * scale)))
            pixels = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)  # type: ignore[assignment]
        _, jpeg = cv2.imencode(".jpg", pixels[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
        return self._rr.EncodedImage(contents=jpeg.tobytes(), media_type="image/jpeg")


def array(values: Tensor, shape: tuple[int, ...]) -> np.ndarray[Any, Any]:
    """The values as a float32 array of that shape, or an error that names both."""
    if values.shape != shape:
        raise InputError(f"values must be {list(shape)}, got {list(values.shape)}")
    return values.detach().cpu().float().numpy().copy()


def import_rerun() -> Any:
    """The rerun package, which takes half a second to import."""
    return need("rerun", "a recording")


def layout() -> Any:
    """Images on top, outputs below them, weights and objects at the right; it opens at the end of the run."""
    import rerun.blueprint as rrb

    images = rrb.Horizontal(
        rrb.Spatial2DView(origin="input", name="input"),
        rrb.Spatial2DView(origin="enhanced", name="enhanced: what the winner stands for, or the objects in sight"),
    )
    outputs = rrb.TimeSeriesView(
        origin="outputs", name="outputs of the network", plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop)
    )
    matrix = rrb.Spatial2DView(
        origin="weights",
        name="weights: column = from, row = to",
        visual_bounds=rrb.VisualBounds2D(x_range=(-2.2, 10.2), y_range=(-1.4, 10.2)),
    )
    plain = rrb.archetypes.TextDocumentFormat(monospace=True, word_wrap=True)
    words = [rrb.TextDocumentView(origin=name, name=name, format_options=plain) for name in ("winner", "objects")]
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(images, outputs, row_shares=[3, 2]),
            rrb.Vertical(matrix, *words, row_shares=[6, 1, 3]),
            column_shares=[5, 2],
        ),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following"),
        auto_views=False,
    )
