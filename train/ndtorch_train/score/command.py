"""`ndtorch score`: run the benchmark and write the leaderboard."""

from __future__ import annotations

import platform
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from ndtorch.errors import InputError
from ndtorch.files import write_text
from ndtorch_train.score.choices import LABELLED, LONGEST, METHODS, PEERS, RATES, SETTLE, Split


@dataclass(frozen=True)
class ScoreOptions:
    """Score binding rules on seeded random scenes, stress sets and the papers' bars; write a leaderboard.

    Tune on the split `tune`, report the split `test`: their seeds have none in common.
    """

    what: Annotated[tuple[str, ...], tyro.conf.Positional] = ()
    """`ranges PAIRS`: score ranges on a folder of stereo pairs with truth instead (ranges.csv)."""
    rules: tuple[str, ...] = METHODS
    """Methods to compare; picard, sobi, mm-ica and easi can be named too."""
    scenes: int = 300
    """Random scenes: 1, 2 and 3 bars in turn; 0 leaves them out."""
    seconds: tuple[float, ...] = (15.0, 60.0)
    """When to score: seconds after the 4 s that filters get to settle."""
    split: Split = "tune"
    """Which seeds."""
    stress: int = 0
    """Scenes of each stress set; 0 leaves them out."""
    hard: int = 0
    """Scenes of each hard set; 0 leaves them out."""
    bars: bool = False
    """Also the papers' two bars at 18 phases and three bars at 90 combinations."""
    rendered: int = 0
    """Random scenes that are also rendered as frames, from the first on (about 10 s each)."""
    retinotopic: int = 0
    """Scenes of each set for object files over retinotopic signals, hard sets too if those are wanted; 0: none."""
    out: Path = Path("out/score")
    """Folder for leaderboard.md, leaderboard.csv, leaderboard.png and report.html."""
    video: bool = False
    """Measure `ndtorch bind` on generated video instead (scores.md, scores.csv)."""
    clips: int = 8
    """Video: clips of every number of objects and frame rate."""
    counts: tuple[int, ...] = (0, 1, 2)
    """Video: numbers of objects."""
    rates: tuple[float, ...] = RATES
    """Video: frames a second."""
    ablate: tuple[str, ...] = ()
    """Video: parts of the front end to switch off, one after the other, or all."""
    file: Path | None = None
    """Video: a file to run on too; its timeline is drawn."""
    keep: Path | None = None
    """Video: folder in which generated clips are kept, and looked for."""
    open: bool = False
    """Show report.html in the browser when it is written."""
    labelled: Path | None = None
    """Folder of clips with others' truth (clip.mp4 with gt.txt or masks.mkv): score on them instead (labelled.csv)."""
    methods: tuple[str, ...] = LABELLED
    """Labelled: what to compare, or folders of models."""
    disparities: tuple[int, int] = (8, 128)
    """Ranges: least and largest disparity that count, pixels."""
    rows: int = 0
    """Labelled: height of the frames that all methods get; 0 for their own."""

    def run(self) -> int:
        """Do it; returns the exit code."""
        import torch

        if self.what:
            if len(self.what) != 2 or self.what[0] != "ranges":
                raise InputError(f"expected nothing, or ranges PAIRS, got {' '.join(self.what)!r}")
            from ndtorch_train.score.ranges.command import run as score_ranges

            return score_ranges(Path(self.what[1]), self.disparities, self.out)
        from ndtorch.memory import tune_allocator

        if self.labelled is not None:
            from ndtorch_train.score.labelled.command import run

            if self.rows != 0 and self.rows < 32:
                raise InputError(f"rows must be 0 or at least 32, got {self.rows}")
            return run(self.labelled, self.methods, self.rows, self.out)
        from ndtorch.report.page import NAME, Shown, open_in_browser
        from ndtorch_train.score.benchmark import bar_rows, hard_rows, random_rows, rendered_rows, stress_rows
        from ndtorch_train.score.figure import draw
        from ndtorch_train.score.leaderboard import Row, markdown, write_csv
        from ndtorch_train.score.report import write_score_page
        from ndtorch_train.score.retinotopic import rendered_row, retinotopic_rows
        from ndtorch_train.score.retinotopic_hard import hard_retinotopic_rows
        from ndtorch_train.score.video_command import VideoScore

        if self.video:
            options = VideoScore(self.clips, self.counts, self.rates, self.split, self.ablate)
            code = options.run(self.file, self.keep, self.out)
            if self.open:
                open_in_browser(self.out / NAME)
            return code
        torch.set_num_threads(1)
        tune_allocator()
        check(self)
        rows: list[Row] = []
        began = time.perf_counter()
        for name in self.rules if self.scenes else ():
            start = time.perf_counter()
            rows += random_rows(name, self.split, self.scenes, sorted(self.seconds))
            print(f"{name}: {self.scenes} scenes in {time.perf_counter() - start:.0f} s", flush=True)
        if self.stress:
            rows += stress_rows(self.rules, self.split, self.stress)
        if self.hard:
            rows += hard_rows(self.rules, self.split, self.hard)
        if self.bars:
            rows += bar_rows(self.rules)
        if self.rendered:
            rows += rendered_rows(self.rules, self.split, self.rendered, min(self.seconds))
        if self.retinotopic:
            rows += retinotopic_rows(self.split, self.retinotopic, sorted(self.seconds), self.out)
            if self.hard:
                rows += hard_retinotopic_rows(self.split, min(self.hard, self.retinotopic), self.out)
            if self.rendered:
                rows.append(rendered_row(self.split, self.rendered, min(self.seconds)))
        text = heading(self, time.perf_counter() - began) + markdown(rows)
        try:
            self.out.mkdir(parents=True, exist_ok=True)
            write_text(self.out / "leaderboard.md", text)
            write_csv(rows, self.out / "leaderboard.csv")
            picture = draw(rows, self.out / "leaderboard.png", f"split {self.split}, {self.scenes} random scenes")
            shown = [Shown(picture, "The same as a picture", "Bars: two standard errors.")]
            page = write_score_page("Binding rules on random scenes", text, shown, self.out)
        except OSError as error:
            raise InputError(f"--out {self.out} cannot be written: {error.strerror}") from None
        print(text)
        print(f"written  {self.out}: leaderboard.md, leaderboard.csv, leaderboard.png, report.html")
        if self.open:
            open_in_browser(page)
        return 0


def check(options: ScoreOptions) -> None:
    """Whatever is wrong with the options, before the work begins."""
    from ndtorch_train.score.scenes import seeds

    known = (*METHODS, *PEERS)
    for name in options.rules:
        if name not in known:
            raise InputError(f"rules must be among {', '.join(known)}, got {name!r}")
    if not options.rules:
        raise InputError(f"rules must name at least one of {', '.join(known)}")
    if not options.seconds or not all(0 < s <= LONGEST - SETTLE for s in options.seconds):
        raise InputError(f"seconds must lie between 0 and {LONGEST - SETTLE:g}, got {options.seconds}")
    seeds(options.split, max(1, options.scenes))
    for name in ("scenes", "stress", "hard", "rendered", "retinotopic"):
        if getattr(options, name) < 0:
            raise InputError(f"{name} must be a number of scenes >= 0, got {getattr(options, name)}")


def heading(options: ScoreOptions, wall: float) -> str:
    """What was run, on which seeds, and how long it took."""
    import torch

    from ndtorch_train.score.scenes import seeds

    first = seeds(options.split, 1).start
    return (
        f"Split {options.split}: seeds from {first} on, {options.scenes} random scenes"
        f"{f', {options.stress} of each stress set' if options.stress else ''}"
        f"{f', {options.hard} of each hard set' if options.hard else ''}. "
        f"Shares ± their standard errors over scenes; seconds count after {SETTLE:g} s of settling, "
        f"`right from` from the first frame. {wall:.0f} s on one core ({platform.machine()}, "
        f"torch {torch.__version__}).\n\n"
    )
