"""Tensors as numpy arrays: what compiled kernels read."""

from __future__ import annotations

from typing import Any

import numpy as np
from torch import Tensor


def view(tensor: Tensor, dtype: type | np.dtype[Any]) -> np.ndarray[Any, Any]:
    """A contiguous numpy view of a CPU tensor, copied only where type or layout differ."""
    return np.ascontiguousarray(tensor.detach().cpu().numpy(), dtype=dtype)
