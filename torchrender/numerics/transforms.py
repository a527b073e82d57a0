"""Matrices of rigid motions and pinhole projection, float64."""

from __future__ import annotations

import torch
from torch import Tensor

from torchrender.errors import CameraError

_PARALLEL = 1e-9


def look_at_matrix(eye: Tensor, target: Tensor, up: Tensor) -> Tensor:
    """``camera_from_world`` (4,4) float64 of a camera at ``eye`` that looks at ``target``.

    A view direction along ``up`` is not an error: the world axis least aligned with it replaces ``up``.

    Raises:
        CameraError: eye and target coincide.
    """
    eye, target, up = (v.to(torch.float64) for v in (eye, target, up))
    forward = target - eye
    length = forward.norm()
    if not length > 0:
        raise CameraError(f"eye and target must differ, both are {eye.tolist()}")
    forward = forward / length
    up_length = up.norm()
    right = torch.linalg.cross(forward, up / up_length if up_length > 0 else up)
    if right.norm() < _PARALLEL:
        axis = torch.zeros(3, dtype=torch.float64)
        axis[int(forward.abs().argmin())] = 1.0
        right = torch.linalg.cross(forward, axis)
    right = right / right.norm()
    down = torch.linalg.cross(forward, right)
    matrix = torch.eye(4, dtype=torch.float64)
    matrix[:3, :3] = torch.stack([right, down, forward])
    matrix[:3, 3] = -matrix[:3, :3] @ eye
    return matrix


def pinhole_matrix(fx: float, fy: float, cx: float, cy: float) -> Tensor:
    """(3,3) float64 intrinsics in pixels."""
    return torch.tensor([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]], dtype=torch.float64)
