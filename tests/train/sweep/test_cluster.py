"""Sweeps on a cluster."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from ndtorch.cli.commands import main


def write_sweep(path: Path, gammas: list[float]) -> Path:
    path.write_text(f"[vary]\ngamma = {gammas}\nphase = [60, 90]\n")
    return path


def test_without_ray_it_says_how_to_get_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    file = write_sweep(tmp_path / "s.toml", [0.5])
    assert main(["sweep", str(file), "--out", str(tmp_path / "out"), "--cluster"]) == 2
    err = capsys.readouterr().err
    assert "pip install 'ray" in err
    assert "of ndtorch-train[cluster]" in err
