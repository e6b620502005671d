"""`ndtorch first-stage`: a model that is there is not replaced by accident."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from ndtorch.cli.commands import main
from ndtorch.loading import model_folders


def test_a_model_is_written_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["first-stage", "--radius", "0.1", "--out", str(tmp_path / "mine"), "--json"]
    assert main(command) == 0
    assert json.loads(capsys.readouterr().out)["folder"] == str(tmp_path / "mine")
    before = (tmp_path / "mine" / "weights.safetensors").stat().st_mtime_ns
    assert main(command) == 2
    assert "config.toml exists; --force replaces it" in capsys.readouterr().err
    assert (tmp_path / "mine" / "weights.safetensors").stat().st_mtime_ns == before
    assert main([*command, "--force"]) == 0
    assert (tmp_path / "mine" / "weights.safetensors").stat().st_mtime_ns > before


def test_the_models_of_the_package_stay(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["first-stage", "--out", str(model_folders()["published"])]) == 2
    assert "--force" in capsys.readouterr().err
