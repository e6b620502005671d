"""Models as programs that run without this package: torch.export, AOTInductor and ONNX, chunk by chunk.

`torch.export` takes every model but `foreground`, which finds blobs outside torch. ONNX has no complex numbers:
for it the orientation filters are products of real matrices, see `OrientedDoG.use_real_arithmetic`.
"""

from __future__ import annotations

import copy
import io
from contextlib import ExitStack
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

import torch
from torch import Tensor, nn

from ndtorch.arguments import as_path, check_number, check_state
from ndtorch.binding.models.base import BindingModel
from ndtorch.errors import InputError, did_you_mean
from ndtorch.utils.files import replacing
from ndtorch.utils.tensors import leaves, mapped
from ndtorch.vision.orientation import OrientedDoG

__all__ = ["export"]

Format = Literal["pt2", "aoti", "onnx"]
SUFFIXES: dict[str, str] = {"pt2": ".pt2", "aoti": ".aoti.pt2", "onnx": ".onnx"}


class ProgramStep(nn.Module):
    """A model with its state as a flat list of tensors: what is exported.

    Args:
        model: the model.
        example: a state like those to come, or None for the first chunk of a run, which starts without one.
    """

    def __init__(self, model: BindingModel, example: Any = None) -> None:
        super().__init__()
        self.model, self.example = model, example
        self.names = list(leaves(example))

    def forward(self, frames: Tensor, *state: Tensor) -> tuple[Tensor, ...]:
        """Frames and the tensors of a state -> signals, and the tensors of the state after them."""
        given = dict(zip(self.names, state, strict=True))
        before = mapped(self.example, lambda name, _: given[name]) if self.names else None
        signals, after = self.model(frames, before)
        # A tensor that goes out as it came in would be the same memory.
        return tuple(part.clone() for part in (*signals, *leaves(after).values()))


def export(
    model: BindingModel, folder: str | Path, format: Format = "pt2", frames: int = 8, batch: tuple[int, ...] = ()
) -> list[Path]:
    """Write a model as two programs, `first` and `next`: for the first chunk of a run, and for all that follow.

    `first(frames)` and `next(frames, *state)` return the signals, in the order of the model's signals, and then the
    tensors of the state, in the order of `ndtorch.utils.tensors.leaves`; those go into the next call. Frames are
    `[*batch, frames, 3, H, W]`, floats in 0..1, and are not checked.

    Args:
        model: the model, on the CPU.
        folder: where to write.
        format: "pt2" for `torch.export.load`, "aoti" for `torch._inductor.aoti_load_package` (a C++ compiler is needed
            here, no Python there), "onnx" for ONNX (needs `pip install onnx onnxscript`).
        frames: frames of a chunk.
        batch: dimensions of a batch.

    Returns:
        the two files.

    Raises:
        InputError: a format that is not there, a model that cannot be exported or makes more or fewer rows than
            frames, or a folder that cannot be written.
    """
    if format not in SUFFIXES:
        raise InputError(f"format must be one of {', '.join(SUFFIXES)}, got {format!r}{did_you_mean(format, SUFFIXES)}")
    place = as_path("folder", folder)
    check_state(model, BindingModel, "model")
    check_number("frames", frames, least=1, whole=True)
    if not model.exportable:
        raise InputError(f"{model.name} cannot be exported: it does part of its work outside torch")
    rows = frames / (model.dt * model.fps)
    if abs(rows / frames - 1) > 1e-9:
        raise InputError(
            f"{model.name} makes {rows:g} rows of {frames} frames at {model.fps:g} frames a second; "
            "a program needs one row a frame"
        )
    if format == "onnx":
        if find_spec("onnx") is None or find_spec("onnxscript") is None:
            raise InputError("ONNX needs two more packages: pip install onnx onnxscript")
        model = copy.deepcopy(model)
        for part in model.modules():
            if isinstance(part, OrientedDoG):
                part.use_real_arithmetic()
    example = torch.rand(*batch, frames, 3, *model.size)
    with torch.no_grad():
        _, state = model(example)
        tensors = tuple(leaves(state).values())
        programs = {
            "first": torch.export.export(ProgramStep(model), (example,)),
            "next": torch.export.export(ProgramStep(model, state), (example, *tensors)),
        }
    whole = {place / f"{name}{SUFFIXES[format]}": packed(program, format) for name, program in programs.items()}
    try:
        place.mkdir(parents=True, exist_ok=True)
        with ExitStack() as stack:  # all of them, or none and the old files stay
            for path, data in whole.items():
                stack.enter_context(replacing(path)).write_bytes(data)
    except OSError as error:
        raise InputError(f"{error.filename} cannot be written: {error.strerror}") from None
    return list(whole)


def packed(program: torch.export.ExportedProgram, format: Format) -> bytes:
    """A program as the bytes of its file.

    On a full disk torch's own writer ends the process, whoever catches what it raises. In memory it never fails.
    """
    data = io.BytesIO()
    if format == "pt2":
        torch.export.save(program, data)
    elif format == "onnx":
        made = torch.onnx.export(program, (), verbose=False)
        assert made is not None
        data.write(made.model_proto.SerializeToString())
    else:
        torch._inductor.aoti_compile_and_package(program, package_path=data)
    return data.getvalue()
