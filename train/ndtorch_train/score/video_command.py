"""`ndtorch score --video`: measure `ndtorch bind` on generated video, and on a clip of one's own."""

from __future__ import annotations

import csv
import platform
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch

from ndtorch.binding.models.video import SWITCHES as PARTS
from ndtorch.errors import InputError
from ndtorch.files import write_text
from ndtorch.nearest import meant
from ndtorch.report.page import Shown
from ndtorch.report.timeline import draw_timeline
from ndtorch.report.words import in_words
from ndtorch_train.score.choices import RATES, Split
from ndtorch_train.score.report import read_rows, write_score_page
from ndtorch_train.score.video_clips import SECONDS, SPLIT_SEEDS
from ndtorch_train.score.video_score import ClipScore, run_video, score_clips, table


@dataclass(frozen=True)
class VideoScore:
    """Measure `ndtorch bind` on generated video with known truth: objects counted right, each moving the right way.

    Attributes:
        clips: of every number of objects and frame rate.
        counts: numbers of objects.
        fps: frames a second.
        split: which seeds.
        ablate: parts to switch off, one after the other, or "all".
        file: a video to run on too; timeline.png is drawn.
        keep: folder in which generated clips are kept, and looked for.
    """

    clips: int = 8
    counts: tuple[int, ...] = (0, 1, 2)
    fps: tuple[float, ...] = RATES
    split: Split = "tune"
    ablate: tuple[str, ...] = ()
    file: Path | None = None
    keep: Path | None = None

    def __post_init__(self) -> None:
        """Check the options, before the work begins."""
        check(self, self.file)

    def __call__(self, out: Path) -> tuple[list[dict[str, Any]], str]:
        """Write scores.md, scores.csv and report.html into `out`; returns the rows, and the words to print."""
        file, keep = self.file, self.keep
        scores, codecs = score_clips(self.split, self.counts, self.fps, self.clips, (), keep)
        first = SPLIT_SEEDS[self.split]
        text = (
            f"Split {self.split}: seeds {first} to {first + self.clips - 1}, {len(scores)} clips of {SECONDS:g} s, "
            f"{', '.join(sorted(codecs)) or 'no'} encoded. Share of clips right ± standard error (number of clips); "
            f"one core, {platform.machine()}, torch {torch.__version__}.\n\n{table(scores)}"
        )
        rows = [("", score) for score in scores]
        for part in PARTS if "all" in self.ablate else self.ablate:
            less, _ = score_clips(self.split, self.counts, self.fps, self.clips, (part,), keep)
            rows += [(part, score) for score in less]
            text += f"\nWithout {part}:\n\n{table(less)}"
        if file is not None:
            result = run_video(file)
            draw_timeline(result, out / "timeline.png")
            text += f"\n```\n{in_words(result)}\n```\n"
        write_text(out / "scores.md", text)
        write_csv(rows, out / "scores.csv")
        shown = [Shown(out / "timeline.png", "The file", "Objects over time.")] if file is not None else []
        write_score_page("Objects in generated video", text, shown, out)
        return read_rows(out / "scores.csv"), text


def check(options: VideoScore, file: Path | None) -> None:
    """Whatever is wrong with the options, before the work begins."""
    if not 0 <= options.clips <= 100_000:
        raise InputError(f"clips must be between 0 and 100000, got {options.clips}")
    if any(not 0 <= count <= 4 for count in options.counts):
        raise InputError(f"counts must lie between 0 and 4, got {options.counts}")
    if any(not 1 <= fps <= 240 for fps in options.fps):
        raise InputError(f"fps must lie between 1 and 240 frames a second, got {options.fps}")
    for part in options.ablate:
        if part not in (*PARTS, "all"):
            raise InputError(
                f"ablate must name parts among {', '.join(PARTS)} or all, got {part!r}{meant(part, PARTS)}"
            )
    if file is not None and not file.is_file():
        raise InputError(f"file {file} does not exist")


def write_csv(rows: list[tuple[str, ClipScore]], path: Path) -> None:
    """One line a clip."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        names = list(ClipScore.__dataclass_fields__)
        writer.writerow(["without", *names])
        for part, score in rows:
            writer.writerow([part, *asdict(score).values()])
