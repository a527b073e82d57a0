"""The numpy view of a tensor."""

from __future__ import annotations

import numpy as np
import torch

from torchrender.arrays import view


def test_memory_is_shared_where_type_and_layout_fit_and_copied_elsewhere():
    tensor = torch.arange(6.0).reshape(2, 3)
    shared = view(tensor, np.float32)
    tensor[1, 2] = 9.0
    assert shared[1, 2] == 9.0
    for copied in (view(tensor, np.float64), view(tensor.T, np.float32)):
        assert copied.flags.c_contiguous
    tensor[1, 2] = 7.0
    assert copied.shape == (3, 2) and copied[2, 1] == 9.0


def test_a_tensor_with_gradients_is_seen_without_them():
    tensor = torch.ones(3, requires_grad=True)
    np.testing.assert_array_equal(view(tensor * 2, np.float32), [2.0, 2.0, 2.0])
