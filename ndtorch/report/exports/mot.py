"""mot.txt: the text format of MOTChallenge, which motmetrics and TrackEval read."""

from __future__ import annotations

from pathlib import Path

from ndtorch.report.exports.source_tracks import SourceTracks

FILE = "mot.txt"


def write(tracks: SourceTracks, path: Path) -> None:
    """A line a box: frame and object from 1, left, top, width and height in pixels, confidence, and -1 three times."""
    lines = [
        f"{frame},{track},{left:.2f},{top:.2f},{right - left:.2f},{bottom - top:.2f},{sure:.3f},-1,-1,-1\n"
        for frame, track, (left, top, right, bottom), sure in zip(
            tracks.frame.tolist(), tracks.track.tolist(), tracks.box.tolist(), tracks.confidence.tolist(), strict=True
        )
    ]
    path.write_text("".join(lines), encoding="utf-8")
