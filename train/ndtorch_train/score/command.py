"""`ndtorch score`: run the benchmark and write the leaderboard."""

from __future__ import annotations

import json
import platform
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

import tyro

from ndtorch.command_run import INTERRUPTED
from ndtorch.errors import InputError
from ndtorch.files import write_text
from ndtorch.nearest import meant
from ndtorch_train.score.choices import LABELLED, LONGEST, METHODS, PEERS, SETTLE, Split

Table = tuple[list[dict[str, Any]], str]
"""Rows for JSON, and the words that are printed."""

Scoring = Callable[[Path], Table]
"""Measures and writes into a folder."""


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
    retinotopic_rendered: int = 0
    """Rendered scenes of each set for the same: textured ground, steady, fast and large bars; 0: none."""
    out: Path = Path("out/score")
    """Folder for leaderboard.md, leaderboard.csv, leaderboard.png and report.html; where it is taken score-2."""
    force: bool = False
    """Write into this folder whatever is in it; files of the same names are replaced."""
    json: bool = False
    """Print the rows of the table as JSON and nothing else."""
    open: bool = False
    """Show report.html in the browser when it is written."""
    labelled: Path | None = None
    """Folder of clips with others' truth (clip.mp4 with gt.txt or masks.mkv): score on them instead (labelled.csv)."""
    empty: Path | None = None
    """A picture, or a video, whose median is taken: score on weather, light and shake over it, where nothing is."""
    empty_seconds: float = 60.0
    """Empty: length of each of these clips."""
    methods: tuple[str, ...] = LABELLED
    """Labelled, empty and common fate: what to compare; the first two: folders of models too."""
    common_fate: int = 0
    """Scenes of random dots of every condition: score who finds what moves together instead (common-fate.csv)."""
    conditions: tuple[str, ...] = ()
    """Common fate: which of coherence, density, lifetime, ground and patches are varied; none for all."""
    disparities: tuple[int, int] = (8, 128)
    """Ranges: least and largest disparity that count, pixels."""
    rows: int = 0
    """Labelled and empty: height of the frames that all methods get; 0 for their own."""

    gone: ClassVar[dict[str, str]] = dict.fromkeys(
        ("--video", "--clips", "--counts", "--fps", "--ablate", "--file", "--keep"),
        "the model `video` is gone; `figures` is scored with --labelled and --empty",
    )

    def run(self) -> int:
        """Do it; returns the exit code."""
        from ndtorch.report.page import NAME, open_in_browser
        from ndtorch.run.folder import RunFolder

        score = self.scoring()
        folder = RunFolder(self.out, self.force)
        interrupted = False
        try:
            try:
                rows, text = score(folder.work)
            except KeyboardInterrupt:
                if not any(folder.work.iterdir()):
                    raise
                # What is compared on clips leaves a table after every method.
                interrupted, rows, text = True, [], ""
            except OSError as error:
                where = error.filename or f"--out {self.out}"
                raise InputError(f"{where} cannot be written: {error.strerror}") from None
        except BaseException:
            folder.discard()
            raise
        files = folder.publish(whole=not interrupted)
        if self.json:
            print(json.dumps(rows))
        else:
            print(text)
            print(f"written  {folder.final}: {', '.join(file.name for file in files)}")
        if self.open:
            open_in_browser(folder.final / NAME)
        return INTERRUPTED if interrupted else 0

    def scoring(self) -> Scoring:
        """What is to be measured, its options checked; it writes into a folder, and gives the table."""
        import torch

        from ndtorch.memory import tune_allocator

        torch.set_num_threads(1)
        tune_allocator()
        told = self.told
        if self.what:
            if len(self.what) != 2 or self.what[0] != "ranges":
                raise InputError(f"expected nothing, or ranges PAIRS, got {' '.join(self.what)!r}")
            from ndtorch_train.score.ranges.command import RangeScore

            return RangeScore(Path(self.what[1]), self.disparities, told)
        if self.labelled is not None:
            from ndtorch_train.score.labelled.command import Comparison, check_methods, labelled_clips

            check_methods(self.methods, self.rows)
            return Comparison(labelled_clips(self.labelled), self.methods, self.rows, told)
        if self.empty is not None:
            from ndtorch_train.score.labelled.command import Comparison, check_methods
            from ndtorch_train.score.labelled.empty import empty_clips

            check_methods(self.methods, self.rows)
            clips = empty_clips(self.empty, self.empty_seconds, self.split)
            return Comparison(clips, self.methods, self.rows, told)
        if self.common_fate:
            if self.common_fate < 0:
                raise InputError(f"common-fate must be a number of scenes >= 0, got {self.common_fate}")
            from ndtorch_train.score.fate.command import FateComparison
            from ndtorch_train.score.fate.scoring import wanted_conditions

            named = () if self.methods == LABELLED else self.methods
            return FateComparison(named, self.split, self.common_fate, told, wanted_conditions(self.conditions))
        check(self)
        return self.leaderboard

    def told(self, words: str) -> None:
        """How far it is."""
        if not self.json:
            print(words, flush=True)

    def leaderboard(self, out: Path) -> Table:
        """Binding rules on random scenes."""
        from ndtorch.report.page import Shown
        from ndtorch_train.score.benchmark import bar_rows, hard_rows, random_rows, rendered_rows, stress_rows
        from ndtorch_train.score.figure import draw
        from ndtorch_train.score.leaderboard import Row, markdown, write_csv
        from ndtorch_train.score.report import read_rows, write_score_page
        from ndtorch_train.score.retinotopic import rendered_row, retinotopic_rows
        from ndtorch_train.score.retinotopic_hard import hard_retinotopic_rows
        from ndtorch_train.score.retinotopic_rendered import rendered_local_rows

        rows: list[Row] = []
        began = time.perf_counter()
        for name in self.rules if self.scenes else ():
            start = time.perf_counter()
            rows += random_rows(name, self.split, self.scenes, sorted(self.seconds))
            self.told(f"{name}: {self.scenes} scenes in {time.perf_counter() - start:.0f} s")
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
        if self.retinotopic_rendered:
            rows += rendered_local_rows(self.split, self.retinotopic_rendered)
        text = heading(self, time.perf_counter() - began) + markdown(rows)
        write_text(out / "leaderboard.md", text)
        write_csv(rows, out / "leaderboard.csv")
        picture = draw(rows, out / "leaderboard.png", f"split {self.split}, {self.scenes} random scenes")
        shown = [
            Shown(
                picture,
                "The same as a picture",
                "Lines span two standard errors on either side.",
            )
        ]
        write_score_page("Binding rules on random scenes", text, shown, out)
        return read_rows(out / "leaderboard.csv"), text


def check(options: ScoreOptions) -> None:
    """Whatever is wrong with the options, before the work begins."""
    from ndtorch_train.score.scenes import seeds

    known = (*METHODS, *PEERS)
    for name in options.rules:
        if name not in known:
            raise InputError(f"rules must be among {', '.join(known)}, got {name!r}{meant(name, known)}")
    if not options.rules:
        raise InputError(f"rules must name at least one of {', '.join(known)}")
    if not options.seconds or not all(0 < s <= LONGEST - SETTLE for s in options.seconds):
        raise InputError(f"seconds must lie between 0 and {LONGEST - SETTLE:g}, got {options.seconds}")
    seeds(options.split, max(1, options.scenes))
    for name in ("scenes", "stress", "hard", "rendered", "retinotopic", "retinotopic_rendered"):
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
        f"Shares ± their standard errors over scenes. Count: the right number of objects; F1: how well the features of "
        f"the objects agree with the truth, 1 is best; ok: number and features right. Seconds count after {SETTLE:g} s "
        f"of settling, those of 'right from' from the first frame. {wall:.0f} s on one core ({platform.machine()}, "
        f"torch {torch.__version__}).\n\n"
    )
