"""What a batch of cameras is made of, and what is held against it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import torch
from torch import Tensor

from torchrender.brief import brief, brief_html
from torchrender.checks import check_finite, check_no_gradient, check_place, is_whole
from torchrender.errors import CameraError
from torchrender.scene.parts.places import FARTHEST_EYE, check_near

if TYPE_CHECKING:
    from typing_extensions import Self

MAX_SIDE = 32768
RIGID = 1e-3
"""So far may axes be from unit length and right angles: matrices come rounded."""


def check_side(name: str, pixels: object) -> None:
    """Refuse what is no width or height of a picture.

    Raises:
        CameraError: names the argument.
    """
    if not is_whole(pixels) or not 1 <= pixels <= MAX_SIDE:
        raise CameraError(f"{name} must be an integer in [1, {MAX_SIDE}], got {pixels!r}")


class Size(NamedTuple):
    """Of a picture, pixels."""

    width: int
    height: int


def sides(asked: tuple[int | None, int | None], usual: tuple[int, int]) -> Size:
    """Width and height of a picture; a side that nobody asks for keeps the usual shape.

    Raises:
        CameraError: no size of a picture.
    """
    for name, pixels in zip(("width", "height"), asked, strict=True):
        if pixels is not None:
            check_side(name, pixels)
    factors = [one / own for one, own in zip(asked, usual, strict=True) if one is not None]
    factor = factors[0] if factors else 1.0
    return Size(*(max(1, round(factor * own)) if one is None else one for one, own in zip(asked, usual, strict=True)))


@dataclass(frozen=True, eq=False)
class CameraRecord:
    """B cameras that share one image size.

    Perspective: ``u = fx x/z + cx``, ``v = fy y/z + cy``. Orthographic: ``u = fx x + cx``, ``v = fy y + cy`` with
    ``fx`` in pixels per scene unit. Fragments with ``z < near`` or ``z > far`` are not seen; near and far are float64,
    one number or one for each camera.

    Raises:
        CameraError: a wrong shape, a value that is not finite, a matrix that is no rotation, near not in front of far.
        GradientError: a matrix that asks for gradients, which pictures do not give.
    """

    camera_from_world: Tensor  # (B,4,4) float64, rigid
    intrinsics: Tensor  # (B,3,3) float64 [[fx, skew, cx], [0, fy, cy], [0, 0, 1]], pixels
    width: int
    height: int
    near: Tensor = field(default_factory=lambda: torch.tensor(0.01, dtype=torch.float64))  # (B,), > 0 for perspective
    far: Tensor = field(default_factory=lambda: torch.tensor(math.inf, dtype=torch.float64))  # (B,), or +inf then
    orthographic: bool = False

    __repr__ = brief
    _repr_html_ = brief_html

    def __post_init__(self) -> None:
        for name in ("camera_from_world", "intrinsics", "near", "far"):
            check_no_gradient("a camera", **{name: getattr(self, name)})
            value = torch.as_tensor(getattr(self, name)).detach().to("cpu", torch.float64)
            object.__setattr__(self, name, check_place(name, value, CameraError))
        matrix, k = self.camera_from_world, self.intrinsics
        if matrix.dim() != 3 or matrix.shape[1:] != (4, 4):
            raise CameraError(f"camera_from_world must have shape (B, 4, 4), got {tuple(matrix.shape)}")
        count = matrix.shape[0]
        if k.shape != (count, 3, 3):
            raise CameraError(f"intrinsics must have shape ({count}, 3, 3), got {tuple(k.shape)}")
        for name in ("near", "far"):
            value = getattr(self, name)
            if value.dim() > 1 or value.numel() not in (1, count):
                raise CameraError(f"{name} must be one number or have shape ({count},), got {tuple(value.shape)}")
            object.__setattr__(self, name, value.reshape(-1).expand(count).contiguous())
        for name, side in (("width", self.width), ("height", self.height)):
            check_side(name, side)
            object.__setattr__(self, name, int(side))
        self._check_values()

    def _check_values(self) -> None:
        # In numpy: cameras are made by the dozen for each picture, and torch takes ten times as long for a few numbers.
        matrix, k = self.camera_from_world.detach().numpy(), self.intrinsics.detach().numpy()
        near, far = self.near.detach().numpy(), self.far.detach().numpy()
        if len(matrix) and np.abs(matrix[:, :3, 3]).max() > 2.0 * FARTHEST_EYE and np.isfinite(matrix).all():
            check_near("camera_from_world", self.camera_from_world[:, :3, 3], CameraError, limit=FARTHEST_EYE)
        if not np.isfinite(matrix).all():
            check_finite("camera_from_world", self.camera_from_world, CameraError)
        if not np.isfinite(k).all():
            check_finite("intrinsics", self.intrinsics, CameraError)
        if len(matrix) == 0:
            return
        turn = matrix[:, :3, :3]
        off = np.abs(turn @ turn.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
        if not (off < RIGID).all():
            told = f"camera_from_world must be a rotation and a shift, mirrored or not: number {int(off.argmax())}"
            raise CameraError(f"{told} is off by {float(off.max()):.3g} from unit axes at right angles")
        if not (np.abs(matrix[:, 3] - (0.0, 0.0, 0.0, 1.0)) < RIGID).all():
            raise CameraError(f"camera_from_world must have the last row 0, 0, 0, 1, got {matrix[:, 3].tolist()}")
        if (k[:, (0, 1), (0, 1)] <= 0).any():
            raise CameraError("intrinsics must have positive focal lengths")
        if (np.abs(k[:, (1, 2, 2, 2), (0, 0, 1, 2)] - (0.0, 0.0, 0.0, 1.0)) > 1e-9).any():
            rows = k[0].tolist()
            raise CameraError(f"intrinsics must be [[fx, skew, cx], [0, fy, cy], [0, 0, 1]], not {rows}: transposed?")
        if not self.orthographic and not (near > 0).all():
            raise CameraError(f"near must be > 0, got {near.tolist()}")
        if not (far > near).all() or np.isinf(near).any():
            raise CameraError(f"far must be greater than near, got near {near.tolist()} far {far.tolist()}")
        if self.orthographic and np.isinf(far).any():
            raise CameraError("far must be finite for orthographic cameras")

    # --------------------------------------------------------------- reading

    def __len__(self) -> int:
        return int(self.camera_from_world.shape[0])

    def __getitem__(self, index: int | slice | Sequence[int] | Tensor) -> Self:
        """A batch of the chosen cameras; an integer gives a batch of one."""
        if is_whole(index):
            index = [range(len(self))[index]]
        return replace(
            self,
            camera_from_world=self.camera_from_world[index],
            intrinsics=self.intrinsics[index],
            near=self.near[index],
            far=self.far[index],
        )

    @property
    def rotation(self) -> Tensor:
        """(B,3,3): rows are the camera's right, down and forward axes in world space."""
        return self.camera_from_world[:, :3, :3]

    @property
    def world_from_camera(self) -> Tensor:
        """(B,4,4), the inverse of ``camera_from_world``."""
        # Asked for dozens of times for each picture: torch takes five times as long for a few numbers.
        return torch.from_numpy(np.linalg.inv(self.camera_from_world.numpy()))

    @property
    def eye(self) -> Tensor:
        """(B,3) centre of projection (orthographic: origin of the camera frame) in world space."""
        return self.world_from_camera[:, :3, 3]

    @property
    def forward(self) -> Tensor:
        """(B,3) unit view direction in world space."""
        return torch.nn.functional.normalize(self.world_from_camera[:, :3, 2], dim=-1)
