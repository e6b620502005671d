"""A frame of one car as kernels take it."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from ndtorch.navigation.one_frame import as_array

pytest.importorskip("numba")


def test_a_frame_is_handed_on_without_a_copy_where_it_has_no_gaps():
    frame = torch.rand(1, 3, 4, 5)
    array, last = as_array(frame)
    assert (array.shape, last) == ((1, 3, 4, 5), False)
    assert np.shares_memory(array, frame.numpy())
    beside = frame.contiguous(memory_format=torch.channels_last)
    array, last = as_array(beside)
    assert (array.shape, last) == ((1, 4, 5, 3), True)
    assert np.shares_memory(array, beside.numpy())
    assert np.array_equal(array.transpose(0, 3, 1, 2), frame.numpy())
    array, last = as_array(frame[..., ::2])
    assert (array.shape, last) == ((1, 3, 4, 3), False)
    assert np.array_equal(array, frame[..., ::2].numpy())
