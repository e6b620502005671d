"""The step of a navigator as one C++ function, written and compiled by PyTorch's inductor."""

from __future__ import annotations

import logging
import os
import shutil
import tempfile
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn
from torch.utils._pytree import tree_leaves, tree_map

from ndtorch.errors import InputError
from ndtorch.navigation.controllers.contract import Command
from ndtorch.navigation.fingerprint import code_fingerprint, fingerprint, machine_fingerprint
from ndtorch.navigation.kept_code import KeptCode, UnusableFolder, cache_folder
from ndtorch.navigation.mapping import GridMap
from ndtorch.navigation.model import Navigator, NavigatorState
from ndtorch.navigation.strips import Strips, cut_strips

Function = Callable[..., list[Tensor]]


class CompiledNavigator(nn.Module):
    """A `Navigator` that sees and steers in one compiled function; maps and lists are filled as before.

    A step of a navigator is some four hundred small operations, and calling them takes longer than what they
    do. Compiled from the very same code they are a few loops. The first frame is not compiled. The second one
    is: that takes a minute or so and a C++ compiler, once for every kind of navigator and shape of frames and for
    either layout of colours in memory, because the library is kept in `folder`.

    Sums may be rounded in another order than in the `Navigator`, by about 1e-7: commands of the same frames are
    the same nearly always, and two closed-loop drives part ways in the end. A drive repeated is the same.

    Shapes:
        As `Navigator`, one frame at a time (T = 1), and of uint8.

    Args:
        navigator: what to compile, on the CPU.
        folder: for the compiled libraries; by default `ndtorch` in `$XDG_CACHE_HOME` or `~/.cache`. Only its owner
            can enter it, and a library is loaded only when its owner and the hash of its content are right.
        report: told before something is compiled, which is the time to tell the user to wait, and where nothing can be
            kept: then the navigator steps uncompiled. By default both are warnings.

    Raises:
        InputError: no C++ compiler, frames that are not uint8 or several at once.
    """

    grid_map: GridMap | None

    def __init__(
        self, navigator: Navigator, folder: Path | None = None, report: Callable[[str], None] | None = None
    ) -> None:
        super().__init__()
        self.navigator = navigator
        self.report = report or warn
        self.kept: KeptCode | None = None
        try:
            self.kept = KeptCode(folder or cache_folder())
        except UnusableFolder as trouble:
            self.report(f"the navigation step cannot be kept compiled: {trouble}; it runs uncompiled")
        self.controller, self.ranging = navigator.controller, navigator.ranging
        self.grid_map = navigator.grid_map
        self.same = fingerprint(
            (core_parts(navigator), code_fingerprint(type(navigator.controller)), machine_fingerprint())
        )
        self.functions: dict[Any, Function] = {}

    def forward(
        self,
        left: Tensor | Strips,
        right: Tensor | Strips,
        state: NavigatorState | None = None,
        driven: Command | None = None,
    ) -> tuple[Command, NavigatorState]:
        eyes = [self.strips(eye, side) for side, eye in enumerate((left, right))]
        if state is None or self.kept is None:
            return self.navigator(*eyes, state, driven)  # type: ignore[no-any-return]
        if driven is None:
            driven = Command(*(part.unsqueeze(-1) for part in state.command))
        memory = (state.map, state.observations, state.tracks)
        bare = state._replace(map=None, observations=None, tracks=None)
        given = (*eyes, bare, driven)
        frames = [part for eye in eyes for part in eye]
        tensors = frames + [part.contiguous() for part in tensors_of(given[2:])]
        kind = tuple((part.shape, part.dtype) for part in tensors) + tuple(part.stride() for part in frames)
        function = self.functions.get(kind)
        if function is None:
            function = self.functions[kind] = self.library(self.kept, kind, given, tensors)
        found = iter(function(tensors))
        command = rebuild(driven, found)
        state = rebuild(bare, found)
        ranges, poses = (rebuild(like, found) for like in (state.ranges, state.pose))
        state = state._replace(map=memory[0], observations=memory[1], tracks=memory[2])
        return command, self.navigator.remember(state, ranges, poses)

    def warm_up(self, left: Tensor | Strips, right: Tensor | Strips) -> None:
        """Load or compile what frames like these need, before a car depends on it."""
        _, state = self.navigator(left, right)
        self(left, right, state._replace(map=None, observations=None, tracks=None))

    def mode(self, state: NavigatorState) -> Tensor:
        """As `Navigator.mode`."""
        return self.navigator.mode(state)

    def strips(self, eye: Tensor | Strips, side: int) -> Strips:
        """The pixels to read of one frame."""
        if isinstance(eye, Tensor):
            if eye.ndim < 4 or tuple(eye.shape[-2:]) != (self.ranging.rig.height, self.ranging.rig.width):
                raise InputError(
                    f"expected frames [..., 1, C, {self.ranging.rig.height}, {self.ranging.rig.width}], "
                    f"got {tuple(eye.shape)}"
                )
            eye = cut_strips(eye, self.controller.fields[side], self.ranging.rig)
        for part in eye:
            if part.dtype != torch.uint8 or part.ndim < 4 or part.shape[-4] != 1:
                raise InputError(
                    f"compiled steps take one frame of uint8 at a time, [..., 1, C, H, W], "
                    f"got {part.dtype} {tuple(part.shape)}"
                )
        return Strips(*map(dense, eye))

    def library(self, kept: KeptCode, kind: tuple[Any, ...], given: tuple[Any, ...], tensors: list[Tensor]) -> Function:
        """Load the function for such inputs, compiling it unless that was done before."""
        name = f"step-{fingerprint((self.same, kind))[:24]}"
        file, wrong = kept.find(name)
        if file is not None:
            try:
                return load_step(file)
            except RuntimeError as error:
                wrong = f"{file} cannot be loaded ({str(error).splitlines()[0]})"
                kept.remove(file)
        self.report(
            (f"{wrong}; " if wrong else "")
            + f"compiling the navigation step, once, into {kept.folder}; this takes a minute or so"
        )
        return load_step(compile_step(self.navigator, given, tensors, kept, name))


def load_step(file: Path) -> Function:
    """The function in a library."""
    import torch._inductor

    return torch._inductor.aoti_load_package(str(file)).loader.run


def warn(line: str) -> None:
    """Tell whoever did not say how to be told."""
    warnings.warn(line, stacklevel=3)


class Core(nn.Module):
    """`Navigator.see_and_steer` as a function of tensors: whatever is not one is as in `like`."""

    def __init__(self, navigator: Navigator, like: tuple[Any, ...]) -> None:
        super().__init__()
        self.navigator, self.like = navigator, like

    def forward(self, *tensors: Tensor) -> list[Tensor]:
        given = rebuild(self.like, iter(tensors))
        # Outputs become inputs of the next step, whose strides are compiled in.
        return [part.contiguous() for part in tensors_of(self.navigator.see_and_steer(*given))]


def compile_step(
    navigator: Navigator, given: tuple[Any, ...], tensors: list[Tensor], kept: KeptCode, name: str
) -> Path:
    """Write the library for steps that get tensors like those of `given`, and keep it under a name."""
    compiler = os.environ.get("CXX", "g++")
    if shutil.which(compiler) is None:
        raise InputError(f"compiling the navigation step needs a C++ compiler, and there is no {compiler}")
    # Only their kind matters. Those of an inference mode could not be used.
    with torch.inference_mode(False):
        examples = tuple(torch.empty_strided(t.shape, t.stride(), dtype=t.dtype).zero_() for t in tensors)
    try:
        with tempfile.TemporaryDirectory(dir=kept.folder) as folder, quiet(), torch.inference_mode(False):
            program = torch.export.export(Core(navigator, given), examples, strict=False)
            made = torch._inductor.aoti_compile_and_package(program, package_path=f"{folder}/step.pt2")
            return kept.keep(name, Path(str(made)))
    except OSError as error:
        raise InputError(f"cannot keep the compiled step in {kept.folder}: {error}") from None


@contextmanager
def quiet() -> Iterator[None]:
    """Without what PyTorch says about its own code."""
    log = logging.getLogger("torch._inductor.ir")
    level = log.level
    log.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings(), torch.no_grad():
            warnings.simplefilter("ignore")
            yield
    finally:
        log.setLevel(level)


def core_parts(navigator: Navigator) -> list[Any]:
    """What decides how a navigator sees and steers."""
    return [navigator.controller, navigator.ranging, navigator.reckoning]


def dense(pixels: Tensor) -> Tensor:
    """The same in one of two memory layouts, colour by colour or pixel by pixel: a library serves one of them."""
    if pixels.stride(-3) == 1 < pixels.shape[-3]:
        return pixels.movedim(-3, -1).contiguous().movedim(-1, -3)
    return pixels.contiguous()


def tensors_of(value: Any) -> list[Tensor]:
    """All tensors of nested tuples, in order."""
    return [part for part in tree_leaves(value) if isinstance(part, Tensor)]


def rebuild(like: Any, tensors: Iterator[Tensor]) -> Any:
    """Nested tuples like those, with other tensors; whatever is not a tensor stays."""
    return tree_map(lambda part: next(tensors) if isinstance(part, Tensor) else part, like)
