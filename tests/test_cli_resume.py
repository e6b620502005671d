"""Runs that go on where another ended, and the states that they go on from."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch

from ndtorch.binding.saving import save_tensors
from ndtorch.cli.commands import main
from tests.command_line import refused, same_state


@pytest.mark.usefixtures("undrawn")
def test_resumed_run_equals_an_uninterrupted_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    short = ["bind", "two-bars", "--settle", "0.3", "--pictures", "5"]
    assert main([*short, "--seconds", "1.1", "--out", str(tmp_path / "whole")]) == 0
    assert main([*short, "--seconds", "0.4", "--out", str(tmp_path / "part")]) == 0
    capsys.readouterr()
    part = str(tmp_path / "part" / "two-bars")
    assert main(["bind", "--resume", part, "--seconds", "0.7", "--pictures", "5", "--out", str(tmp_path / "rest")]) == 0
    assert capsys.readouterr().out.startswith("model  scale-free (that of the run that goes on)\n")
    state = same_state(tmp_path / "whole" / "two-bars", tmp_path / "rest" / "two-bars")
    assert float(state["second.network.weights"].max()) > 0


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("model", "options", "rows"),
    [
        # One step a frame where the settled network needs no shorter one, and 100 a second where it does.
        ("published", ["--settle", "0.2"], 97),
        ("scale-free", ["--gamma", "0.3", "--settle", "0.1"], 25),
        ("foreground", [], 25),
    ],
)
def test_resumed_video_goes_on_bit_for_bit_with_its_model(
    model: str, options: list[str], rows: int, clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ["bind", str(clip), "--model", model, *options, "--pictures", "0"]
    part = str(tmp_path / "part" / "bars")
    assert main([*asked, "--out", str(tmp_path / "whole")]) == 0
    assert main([*asked, "--seconds", "0.4", "--out", str(tmp_path / "part")]) == 0
    resumed = ["bind", "--resume", part, "--pictures", "0", "--out", str(tmp_path / "rest")]
    capsys.readouterr()
    refused(resumed, capsys, "name it again to open it", str(clip))
    assert main([*resumed, str(clip)]) == 0
    state = same_state(tmp_path / "whole" / "bars", tmp_path / "rest" / "bars")
    assert rows in [int(value) for name, value in state.items() if name.endswith((".steps", ".frames"))]
    found = [json.loads((tmp_path / name / "bars" / "objects.json").read_text()) for name in ("whole", "rest")]
    assert found[0]["objects"] == found[1]["objects"]
    assert found[0]["weights"] == found[1]["weights"]
    capsys.readouterr()
    other = "published" if model != "published" else "foreground"
    resumed = ["bind", str(clip), "--resume", part, "--out", str(tmp_path)]
    refused([*resumed, "--model", other], capsys, model, other)
    if model != "published":
        refused([*resumed, "--rule", "hebbian"], capsys, "--rule is an option of published", model)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"source": "http://127.0.0.1:9/x"}, ["name it again"]),
        *(({"source": source}, ["name it again"]) for source in ("camera:0", "0", "file:///etc/passwd", "/dev/zero")),
        ({"source": "tcp://127.0.0.1:9"}, ["name it again"]),
        ({"source": "../../x.avi"}, ["name it again"]),
        ({"model": "/etc"}, ["model /etc", "name it again"]),
        *(({key: value}, [key]) for key, value in (("frames", "x"), ("frames", -1), ("fps", None), ("fit", 3))),
        *(({"options": value}, ["options"]) for value in ({"gamma": []}, {"size": 3}, {"backend": "x"}, [1], None)),
        *(({"scene": value}, ["scene"]) for value in ({"seed": -1}, {"phase": "x"}, {"seconds": 3}, {"fps": 1e300})),
        ({"first_stage_radius": "x"}, ["first_stage_radius"]),
        ({"unheard": 1}, ["unheard"]),
    ],
)
def test_a_folder_from_others_opens_nothing_and_its_options_have_types(
    changed: dict[str, object], words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    about = {"model": "foreground", "source": "two-bars", "frames": 10, "fps": 100.0, "options": {}, "scene": {}}
    (tmp_path / "from" / "others").mkdir(parents=True)
    save_tensors(
        {"a": torch.zeros(1)}, tmp_path / "from/others/state.safetensors", {"run": json.dumps(about | changed)}
    )
    refused(["bind", "--resume", str(tmp_path / "from/others"), "--out", str(tmp_path / "out")], capsys, *words)


@pytest.mark.usefixtures("undrawn")
def test_a_film_beside_the_folder_is_opened(clip: Path, tmp_path: Path) -> None:
    film = tmp_path / "here" / clip.name
    film.parent.mkdir()
    film.write_bytes(clip.read_bytes())
    quick = ["--pictures", "0", "--out", str(film.parent)]
    assert main(["bind", str(film), "--model", "scale-free", "--settle", "0", "--seconds", "0.2", *quick]) == 0
    assert main(["bind", "--resume", str(film.parent / film.stem), "--seconds", "0.2", *quick]) == 0
