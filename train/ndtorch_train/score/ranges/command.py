"""`ndtorch score ranges PAIRS`: the ranging of rows on pictures of real stereo cameras, beside OpenCV's."""

from __future__ import annotations

import platform
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import torch

from ndtorch.errors import InputError
from ndtorch.files import write_text
from ndtorch.report.page import Shown
from ndtorch_train.score.ranges.methods import (
    EVERY,
    Found,
    SemiGlobal,
    by_rows,
    least_columns,
    ranging,
    semi_global,
)
from ndtorch_train.score.ranges.pairs import CONDITIONS, Pair, pair_folders, read_pair
from ndtorch_train.score.ranges.picture import draw
from ndtorch_train.score.ranges.table import Row, judge, markdown, means, write_csv
from ndtorch_train.score.report import read_rows, write_score_page

PUBLISHED, SEARCH, SGBM = "features", "search", "SGBM"

NOTE = (
    "Every {every}. row of a picture is taken for the horizon row; disparities {low} to {high}. `features` is the "
    "published matching, `search` is `--ranging search`, both as the navigator runs them; SGBM is `cv2.StereoSGBM` on "
    "the whole picture, read at the pixels of `search` where it says anything. Shares are of the ranges whose truth is "
    "known. Time: processor time of one row (median), of SGBM of one picture, one thread; {machine}, torch {torch}."
)


class RangeScore:
    """Score on every pair of a folder; call it with a folder for ranges.csv, ranges.md, pictures and report.html.

    Args:
        folder: of folders with left.png, right.png and disp*, or one of them.
        disparities: the least and the largest that count, pixels.
        told: how far it is.

    Raises:
        InputError: a folder without pairs, pairs that cannot be read, or disparities that cannot be.
    """

    def __init__(self, folder: Path, disparities: tuple[int, int], told: Callable[[str], None]) -> None:
        low, high = disparities
        if not 1 <= low < high - 1 or high > 1024:
            raise InputError(f"disparities must be two numbers 1 <= LEAST < LARGEST - 1 < 1024, got {low} {high}")
        self.pairs = [read_pair(place, number) for number, place in enumerate(pair_folders(folder))]
        for pair in self.pairs:
            if pair.left.shape[1] < least_columns(high):
                raise InputError(f"{pair.name}: {pair.left.shape[1]} columns are too few for disparities up to {high}")
        self.disparities, self.told = disparities, told

    def __call__(self, out: Path) -> tuple[list[dict[str, Any]], str]:
        """The rows of ranges.csv, and the table."""
        cv2.setNumThreads(1)
        rows: list[Row] = []
        shown: list[Shown] = []
        for pair in self.pairs:
            new, plain = score_pair(pair, self.disparities)
            rows += new
            picture = draw(pair, plain, out / f"pair-{pair.number:03d}.png")
            words = "Ranges of the search: blue right to 10 %, orange not, grey unknown."
            shown.append(Shown(picture, pair.name, words))
            self.told(f"{pair.name}: done")
        low, high = self.disparities
        note = NOTE.format(every=EVERY, low=low, high=high, machine=platform.machine(), torch=torch.__version__)
        text = f"{note}\n\n{markdown([*rows, *means(rows)])}"
        write_csv(rows, out / "ranges.csv")
        write_text(out / "ranges.md", text)
        write_score_page("Ranges on real stereo pictures", text, shown, out)
        return read_rows(out / "ranges.csv"), text


def score_pair(pair: Pair, disparities: tuple[int, int]) -> tuple[list[Row], Found]:
    """All methods under all conditions, and what the search found in the pair as it is."""
    height, width = pair.left.shape
    modules = {name: ranging(width, height, disparities, name == SEARCH) for name in (PUBLISHED, SEARCH)}
    for module in modules.values():
        by_rows(module, [(pair.left[:12], pair.right[:12])] * 2)  # compiles what has to be, before the time is taken
    rows: list[Row] = []
    plain: Found | None = None
    for condition in CONDITIONS:
        views = condition.views(pair, 2, seed=0)
        wide = semi_global(*views[1], disparities[1])
        found = {name: by_rows(module, views) for name, module in modules.items()}
        plain = plain or found[SEARCH]
        found[SGBM] = wide.at(found[SEARCH])
        rows += [row_of(pair, condition.name, name, these, wide) for name, these in found.items()]
    assert plain is not None
    return rows, plain


def row_of(pair: Pair, condition: str, method: str, found: Found, wide: SemiGlobal) -> Row:
    """One line of the table."""
    share = found.seconds / max(wide.seconds, 1e-9)
    return Row(
        pair.name, pair.number, condition, method, *judge(found, pair.truth), ms=1e3 * found.seconds, of_sgbm=share
    )
