"""What can be chosen for a score, known before anything heavy is imported."""

from __future__ import annotations

from typing import Literal

METHODS = ("published", "cooperative", "hebbian", "scale-free, owners", "scale-free", "greedy", "ica", "nmf")
"""Names for `ndtorch_train.score.methods.method`."""

PEERS = ("picard", "sobi", "mm-ica", "easi")
"""Further names: what others use to separate sources. Picard needs a package of its own."""

LABELLED = ("figures", "mog2-norfair", "mog2-bytetrack", "knn-norfair", "knn-bytetrack")
"""What labelled video can be scored with: the models for video, and background subtraction with a tracker of boxes."""

Split = Literal["tune", "test"]
"""Tune on the one, report the other."""

SETTLE = 4.0
"""Seconds every method gets before the clock of the score starts, as in the papers."""

LONGEST = 104.0
"""Seconds of brightness drawn for every scene, so that a scene does not depend on how long it is watched."""
