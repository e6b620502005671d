"""Importing torchvision where its compiled part cannot load."""

from __future__ import annotations

import torch

_declared: list[torch.library.Library] = []


def import_torchvision() -> None:
    """Import torchvision, also beside a PyTorch its compiled operators do not fit (a CPU-only one).

    torchvision describes its operators `nms` and `qnms` to PyTorch as it is imported, and fails where the
    compiled library that should have declared them did not load. Resizing and cropping need neither, so they
    are declared here without an implementation, and only once the import has failed for that reason.
    """
    try:
        import torchvision
    except RuntimeError as error:
        if "operator torchvision::" not in str(error) or _declared:
            raise
        # The declarations last as long as this object does.
        library = torch.library.Library("torchvision", "DEF")  # type: ignore[no-untyped-call]
        for name in ("nms", "qnms"):
            schema = f"{name}(Tensor dets, Tensor scores, float iou_threshold) -> Tensor"
            library.define(schema)  # type: ignore[no-untyped-call]
        _declared.append(library)
        import torchvision  # noqa: F401
