"""Reports: everything is in the one file, text is escaped, and a browser shows and plays it all."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import torch

from ndtorch.report.page import Page, Shown, Table
from ndtorch.scenes.video_writer import VideoWriter


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A report with a picture and a film, alone in a folder."""
    import cv2

    folder = tmp_path_factory.mktemp("files")
    cv2.imwrite(str(folder / "a.png"), np.full((300, 900, 3), 200, dtype=np.uint8))
    with VideoWriter(folder / "b.mp4", 12.5, (64, 96)) as film:
        for n in range(10):
            film.write(torch.full((3, 64, 96), 0.1 * n))
    shown = [
        Shown(folder / "a.png", "A picture", "grey"),
        Shown(folder / "b.mp4", "A film", "brighter"),
        Shown(folder / "none.png", "Nothing", "not there"),
    ]
    table = Table("A table", [f"column {n}" for n in range(20)], [["a wide cell"] * 20])
    out = tmp_path_factory.mktemp("page")
    return Page("<b> & co", ["2 objects"], "ndtorch bind x", {"model": "published"}, [table], shown).write(out)


def test_one_file_holds_everything_and_nothing_is_fetched(written: Path) -> None:
    text = written.read_text(encoding="utf-8")
    assert [path.name for path in written.parent.iterdir()] == ["report.html"]
    assert "&lt;b&gt; &amp; co" in text
    assert "Nothing" not in text
    assert "ndtorch bind x" in text
    addresses = re.findall(r'(?:src|href)="([^"]*)"', text)
    assert len(addresses) == 3
    assert all(address.startswith("data:") for address in addresses)
