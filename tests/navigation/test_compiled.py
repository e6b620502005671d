"""The compiled step beside the plain one: same commands, same states, same maps."""

import fcntl
import os
import shutil
import subprocess
import sys

import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import (
    Command,
    CompiledNavigator,
    FeatureParams,
    Grid,
    GridMap,
    Navigator,
    ObservationList,
    RangingParams,
    StereoRig,
    cut_strips,
)
from ndtorch.navigation.compiled import dense, tensors_of
from tests.films import shared_folder

DT = 1 / 30
RIG = StereoRig()
STEPS = 60
MAP_DISTANCE = 0.01
"""Largest share of a map's mass by which a compiled step may differ from the plain one; .0003 was seen."""


def navigator(controller="ranging", **options):
    grid = GridMap(RIG, Grid(-1.0, 5.0, -2.0, 2.0, cell=0.02))
    features = FeatureParams(2, edge_reach=4, shared=True)
    return Navigator(RIG, DT, features=features, controller=controller, grid_map=grid, **options)


def world(steps=STEPS):
    """A texture that slides past, 100 pixels further left in the right image, and goes blank half way."""
    generator = torch.Generator().manual_seed(5)
    wide = torch.randint(0, 256, (1, 3, 480, 740 + 3 * steps), generator=generator, dtype=torch.uint8)
    for t in range(steps):
        left, right = (wide[..., 3 * t + k : 3 * t + k + 640] for k in (0, 100))
        yield (left, right) if t % 40 < 30 else (left // 8, right // 8)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """One for all processes of a run: what one has compiled the others load."""
    folder = shared_folder(tmp_path_factory.getbasetemp()) / "compiled"
    folder.mkdir(exist_ok=True)
    return folder


@pytest.fixture(scope="module")
def compiled(folder):
    """One that has compiled its step; that takes a while."""
    if shutil.which(os.environ.get("CXX", "g++")) is None:
        pytest.skip("needs a C++ compiler")
    said = []
    with (folder.parent / "compiled.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        before = len(list(folder.iterdir()))
        made = CompiledNavigator(navigator(), folder, said.append)
        with torch.inference_mode():
            made.warm_up(*next(iter(world())))
    assert len(said) == 1 - before
    assert before or "compiling" in said[0]
    assert len(list(folder.iterdir())) == 1
    return made


@pytest.mark.compiled
def test_same_commands_states_and_map(compiled):
    plain, a, b = navigator(), None, None
    modes, found = set(), 0
    with torch.inference_mode():
        for left, right in world():
            one, a = plain(left, right, a)
            other, b = compiled(left, right, b)
            torch.testing.assert_close(one, other)
            torch.testing.assert_close(
                tensors_of(a._replace(map=None)), tensors_of(b._replace(map=None)), rtol=1e-4, atol=1e-5
            )
            modes.add(int(compiled.mode(b)))
            found += int(b.ranges.valid.sum())
    assert len(modes) >= 2, modes  # or else little was compared
    assert found > 20
    # A beam is drawn from whole cells: a corner that two roundings put on either side of a cell's border changes that
    # cell by a thousandth or so. So maps are compared by how much of their mass lies elsewhere.
    mass = float(a.map.cells.sum())
    assert mass > 0
    assert float((a.map.cells - b.map.cells).abs().sum()) < MAP_DISTANCE * mass


@pytest.mark.compiled
def test_what_was_driven_counts(compiled):
    still = Command(torch.zeros(1), torch.zeros(1))
    with torch.inference_mode():
        frames = list(world(3))
        _, state = compiled(*frames[0])
        command, _ = compiled(*frames[1], state)
        _, after = compiled(*frames[1], state, Command(torch.tensor([0.5]), torch.tensor([1.0])))
        _, stood = compiled(*frames[1], state, still)
    assert float(after.pose.heading) == pytest.approx(0.5 * DT, rel=1e-5)
    assert float(stood.pose.x) == 0.0
    assert command.speed.shape == (1,)


@pytest.mark.compiled
def test_strips_and_frames_share_a_library(compiled, folder):
    """Also frames that are a part of larger ones."""
    before = sorted(folder.iterdir())
    again = CompiledNavigator(navigator(), folder, pytest.fail)  # says something only when it compiles
    for steps in (1, 2):
        left, right = next(iter(world(steps)))
        cut = [cut_strips(eye, field, RIG) for eye, field in zip((left, right), again.controller.fields, strict=True)]
        with torch.inference_mode():
            again.warm_up(left, right)
            again.warm_up(*cut)
    assert sorted(folder.iterdir()) == before


@pytest.mark.parametrize("layout", [(0, 2, 3, 1), (0, 1, 2, 3)])
def test_two_layouts_of_memory(layout):
    """Pictures of OpenCV have their colours side by side, others one after the other."""
    pixels = torch.rand(1, 3, 8, 10).permute(layout).contiguous().permute(*[layout.index(k) for k in range(4)])
    for part in (pixels, pixels[..., 2:7, 1:4], pixels[..., :1, :]):
        torch.testing.assert_close(dense(part), part, rtol=0, atol=0)
        assert dense(part).permute(layout).is_contiguous()


@pytest.mark.compiled
def test_unusable_frames_are_refused(compiled):
    left, right = next(iter(world()))
    with pytest.raises(InputError, match="one frame of uint8"):
        compiled(left / 255, right / 255)
    with pytest.raises(InputError, match="one frame of uint8"):
        compiled(torch.stack((left, left), -4)[0], torch.stack((right, right), -4)[0])
    with pytest.raises(InputError, match="480, 640"):
        compiled(left[..., :100], right[..., :100])


def test_one_library_for_one_kind_of_navigator():
    """Maps do not matter, parameters do; another process finds the same name."""
    name = CompiledNavigator(navigator()).same
    assert CompiledNavigator(navigator("published")).same != name
    assert CompiledNavigator(navigator(observations=ObservationList(DT))).same == name
    assert CompiledNavigator(navigator(params=RangingParams(turn_at=1.2))).same != name
    script = "from tests.navigation.test_compiled import *\nprint(CompiledNavigator(navigator()).same)"
    environment = os.environ | {"PYTHONHASHSEED": "77"}
    out = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, env=environment, check=True)
    assert out.stdout.strip() == name


def test_without_a_compiler(tmp_path, monkeypatch):
    monkeypatch.setenv("CXX", "no-such-compiler")
    with pytest.raises(InputError, match=r"C\+\+ compiler.*no-such-compiler"):
        CompiledNavigator(navigator(), tmp_path, [].append).warm_up(*next(iter(world())))
    assert not any(tmp_path.glob("*.pt2"))


def test_where_nothing_can_be_kept_it_steps_uncompiled(tmp_path, monkeypatch):
    """One line, and the same commands."""
    blocked, said = tmp_path / "file", []
    blocked.write_text("")
    made, plain = CompiledNavigator(navigator(), blocked / "folder", said.append), navigator()
    (left, right), (next_left, next_right) = world(2)
    with torch.inference_mode():
        made.warm_up(left, right)
        _, a = plain(left, right)
        _, b = made(left, right)
        assert torch.equal(plain(next_left, next_right, a)[0].speed, made(next_left, next_right, b)[0].speed)
    assert len(said) == 1
    assert "uncompiled" in said[0]
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr("pathlib.Path.home", homeless)
    with pytest.warns(UserWarning, match="no home folder.*uncompiled"):
        CompiledNavigator(navigator())


def homeless():
    raise RuntimeError("Could not determine home directory.")


def test_a_damaged_library_is_compiled_again(tmp_path, monkeypatch):
    """With a compiler that only writes a file."""
    monkeypatch.setattr("ndtorch.navigation.compiled.load_step", lambda file: file.read_text)
    monkeypatch.setattr("ndtorch.navigation.compiled.compile_step", pretend)
    for damage, line in (
        (lambda file: file.write_text("evil"), "is damaged; compiling"),
        (lambda file: file.chmod(0o666), "can be written by other users; compiling"),
        (lambda file: None, ""),
    ):
        said = []
        made = CompiledNavigator(navigator(), tmp_path, said.append)
        assert made.library(made.kept, (), (), [])() == "code"
        (file,) = tmp_path.glob("*.pt2")
        damage(file)
        said.clear()
        assert made.library(made.kept, (), (), [])() == "code"
        assert [line in words for words in said] == [True] * bool(line)


def pretend(navigator, given, tensors, kept, name):
    draft = kept.folder / "draft"
    draft.write_text("code")
    return kept.keep(name, draft)


def test_a_library_that_does_not_load_is_compiled_again(tmp_path, monkeypatch):
    loads = iter([True, False])

    def load(file):
        if next(loads, True):
            return file.read_text
        raise RuntimeError("not an archive\nmore")

    monkeypatch.setattr("ndtorch.navigation.compiled.load_step", load)
    monkeypatch.setattr("ndtorch.navigation.compiled.compile_step", pretend)
    said = []
    made = CompiledNavigator(navigator(), tmp_path, said.append)
    made.library(made.kept, (), (), [])
    assert made.library(made.kept, (), (), [])() == "code"
    assert "cannot be loaded (not an archive); compiling" in said[1]


def test_the_folder_is_private(tmp_path):
    folder = tmp_path / "kept"
    folder.mkdir(mode=0o777)
    CompiledNavigator(navigator(), folder)
    assert folder.stat().st_mode & 0o777 == 0o700
