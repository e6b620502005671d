"""The methods by their names."""

from __future__ import annotations

from collections.abc import Sequence

from torch import Tensor

from ndtorch.errors import InputError
from ndtorch.nearest import meant
from ndtorch_train.score.choices import METHODS, PEERS
from ndtorch_train.score.methods import Greedy, Ica, Learned, Method, Nmf, ScaleFree
from ndtorch_train.score.peers import Easi, MmIca, Picard, Sobi


def method(name: str, truth: Sequence[Tensor]) -> Method:
    """The method of that name; only nmf looks at the truth, for the number of bars."""
    if name == "published":
        return Learned("competitive")
    if name in ("cooperative", "hebbian"):
        return Learned(name)
    if name == "scale-free":
        return ScaleFree("sums")
    if name == "scale-free, owners":
        return ScaleFree("owners")
    if name == "greedy":
        return Greedy()
    if name == "ica":
        return Ica()
    if name == "picard":
        return Picard()
    if name == "sobi":
        return Sobi()
    if name == "mm-ica":
        return MmIca()
    if name == "easi":
        return Easi()
    if name == "nmf":
        return Nmf([len(features) for features in truth])
    known = (*METHODS, *PEERS)
    raise InputError(f"rules must be among {', '.join(known)}, got {name!r}{meant(name, known)}")
