"""Cameras as other programs write them, into this project's convention and back.

Here, as in OpenCV: x right, y down, z forward, world to camera, and the centre of the upper left pixel at (0.5, 0.5).
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor

from torchrender.checks import check_finite, check_no_gradient, is_number
from torchrender.errors import CameraError, ViewWarning
from torchrender.numerics.quaternions import rotations
from torchrender.numerics.transforms import pinhole_matrix
from torchrender.scene.cameras.record import CameraRecord, check_side

if TYPE_CHECKING:
    from typing_extensions import Self

Numbers = Tensor | np.ndarray[Any, Any] | Sequence[Any]
"""Tensors, arrays, and lists of numbers or of those."""
FLIP = torch.diag(torch.tensor([1.0, -1.0, -1.0, 1.0], dtype=torch.float64))
"""From y up, z backward to y down, z forward, and back."""
RIGID = 1e-4
"""Files round their matrices: so far may a rotation be off, and it is made exact."""
WIDEST_DEG = 179.9
"""Opening angle of a view, at most."""
COLMAP_MODELS = {"SIMPLE_PINHOLE": 3, "PINHOLE": 4, "SIMPLE_RADIAL": 4, "RADIAL": 5, "OPENCV": 8}
"""Numbers of each; of those behind the focal lengths and the principal point, distortion, all must be 0."""


class CameraDoors(CameraRecord):
    """Ways in from, and out to, the conventions of other programs."""

    @classmethod
    def from_opencv(
        cls,
        K: Numbers,
        R: Numbers,
        t: Numbers | None = None,
        *,
        width: int,
        height: int,
        pixel_center: float = 0.5,
        near: Tensor | float = 0.01,
        far: Tensor | float = math.inf,
    ) -> Self:
        """From world to camera, ``x = K (R p + t)``, as ``cv2.projectPoints`` and ``cv2.calibrateCamera`` have it.

        Args:
            K: (3,3) or (B,3,3), pixels.
            R: (3,3) or (B,3,3); or (4,4), (B,4,4) or (B,3,4) with ``t`` inside.
            t: (3,), (3,1), (B,3) or (B,3,1); None where R has it.
            pixel_center: coordinates of the centre of the upper left pixel: 0.5, or 0 as OpenCV's own calibration.

        Raises:
            CameraError: a shape that does not fit, a matrix that is mirrored, scaled or no rotation.

        Warns:
            ViewWarning: a principal point far from the middle, as of a ``K`` of pictures of another size.
        """
        pose = _pose("R", R, None if t is None else _batch("t", t, ((3,), (3, 1))))
        k = _batch("K", K, ((3, 3),)).clone()
        k[:, (0, 1), 2] += 0.5 - _centre(pixel_center)
        _doubt_centre(k, width, height)
        return cls._made(pose, k, width, height, near, far)

    @classmethod
    def from_opengl(
        cls,
        c2w: Numbers,
        *,
        width: int,
        height: int,
        fov_deg: float | None = None,
        fov_x_deg: float | None = None,
        K: Numbers | None = None,
        near: Tensor | float = 0.01,
        far: Tensor | float = math.inf,
    ) -> Self:
        """From camera to world with x right, y up, z backward: OpenGL, Blender, NeRF's ``transforms.json``.

        Args:
            c2w: (4,4), (B,4,4), (3,4) or (B,3,4).
            fov_deg: vertical opening angle; or ``fov_x_deg``, the horizontal one (``camera_angle_x`` in degrees); or
                ``K`` (3,3) or (B,3,3) with positive focal lengths, in pixels whose centres lie
                at 0.5, y down.

        Raises:
            CameraError: as above, or not exactly one of ``fov_deg``, ``fov_x_deg`` and ``K``.

        Warns:
            ViewWarning: an angle that may be in radians; a ``K`` as above.
        """
        if sum(one is not None for one in (fov_deg, fov_x_deg, K)) != 1:
            raise CameraError("give one of fov_deg, fov_x_deg and K")
        if K is not None:
            k = _batch("K", K, ((3, 3),))
            _doubt_centre(k, width, height)
        else:
            name, angle, side = ("fov_deg", fov_deg, height) if fov_deg is not None else ("fov_x_deg", fov_x_deg, width)
            focal = focal_length(name, angle or 0.0, side)
            k = pinhole_matrix(focal, focal, width / 2, height / 2)[None]
        pose = torch.linalg.inv(_pose("c2w", c2w, None) @ FLIP)
        return cls._made(pose, k, width, height, near, far)

    @classmethod
    def from_gltf(
        cls, matrix: Numbers, *, yfov: float, width: int, height: int, znear: float = 0.01, zfar: float | None = None
    ) -> Self:
        """A perspective camera of glTF: the node's global matrix (4,4), mathematical order, and ``yfov`` in radians.

        Nodes may be scaled: glTF says that a camera takes no notice of it.
        """
        pose = _batch("matrix", matrix, ((4, 4),)).clone()
        pose[:, :3, :3] = torch.nn.functional.normalize(pose[:, :3, :3], dim=1)
        far = math.inf if zfar is None else zfar
        return cls.from_opengl(pose, fov_deg=math.degrees(yfov), width=width, height=height, near=znear, far=far)

    @classmethod
    def from_colmap(
        cls,
        qvec: Numbers,
        tvec: Numbers,
        *,
        model: str,
        params: Sequence[float],
        width: int,
        height: int,
        near: Tensor | float = 0.01,
        far: Tensor | float = math.inf,
    ) -> Self:
        """A row of COLMAP's ``images.txt`` with its row of ``cameras.txt``; several images of one camera are a batch.

        Args:
            qvec: (4,) or (B,4): w, x, y, z.
            tvec: (3,) or (B,3).
            model, params: as in ``cameras.txt``. Lenses with distortion are refused: undistort the photos first.
        """
        if model not in COLMAP_MODELS:
            raise CameraError(f"model must be one of {', '.join(COLMAP_MODELS)}, got {model!r}")
        if len(params) != COLMAP_MODELS[model]:
            raise CameraError(f"params of {model} must be {COLMAP_MODELS[model]} numbers, got {len(params)}")
        square = model.startswith("SIMPLE") or model == "RADIAL"
        count = 3 if square else 4
        if any(params[count:]):
            raise CameraError(f"params of {model} have distortion {list(params[count:])}: undistort the photos first")
        fx, fy, cx, cy = (params[0], *params[:3]) if square else params[:4]
        rotation = rotation_of(_batch("qvec", qvec, ((4,),)))
        return cls.from_opencv(
            pinhole_matrix(fx, fy, cx, cy), rotation, tvec, width=width, height=height, near=near, far=far
        )

    def opencv(self, *, pixel_center: float = 0.5) -> tuple[Tensor, Tensor, Tensor]:
        """K (B,3,3), R (B,3,3) and t (B,3), float64: the way back from :meth:`from_opencv`."""
        self._needs_perspective("opencv")
        k = self.intrinsics.clone()
        k[:, (0, 1), 2] -= 0.5 - _centre(pixel_center)
        return k, self.rotation.clone(), self.camera_from_world[:, :3, 3].clone()

    def opengl(self) -> tuple[Tensor, Tensor]:
        """Camera to world with y up and z backward (B,4,4), and K (B,3,3): the way back from :meth:`from_opengl`."""
        self._needs_perspective("opengl")
        return self.world_from_camera @ FLIP, self.intrinsics.clone()

    def _needs_perspective(self, name: str) -> None:
        if self.orthographic:
            raise CameraError(f"{name}() is for perspective cameras, these are orthographic")

    @classmethod
    def _made(cls, pose: Tensor, k: Tensor, width: int, height: int, near: Tensor | float, far: Tensor | float) -> Self:
        count = max(len(pose), len(k))
        if {len(pose), len(k)} - {1, count}:
            raise CameraError(f"as many K as poses, or one, are needed: got {len(k)} K and {len(pose)} poses")
        nearest, farthest = (torch.as_tensor(one, dtype=torch.float64) for one in (near, far))
        poses, lenses = pose.expand(count, 4, 4).contiguous(), k.expand(count, 3, 3).contiguous()
        return cls(poses, lenses, width, height, nearest, farthest)


def rotation_of(quaternion: Tensor) -> Tensor:
    """Rotations (B,3,3) of quaternions (B,4) w, x, y, z, which need not have unit length.

    Raises:
        CameraError: one of length zero.
    """
    if not bool((quaternion.norm(dim=1) > 0).all()):
        raise CameraError("qvec must not be zero")
    return torch.from_numpy(rotations(quaternion.roll(-1, 1).numpy()))


def _batch(name: str, value: Numbers, shapes: tuple[tuple[int, ...], ...]) -> Tensor:
    """Finite float64 with a batch dimension, of the first of these shapes."""
    try:
        if isinstance(value, Sequence):
            value = torch.from_numpy(np.array([np.asarray(one, np.float64) for one in value]))
        out = torch.as_tensor(value, dtype=torch.float64)
    except (TypeError, ValueError, RuntimeError) as error:
        raise CameraError(f"{name} must be numbers, got {type(value).__name__}") from error
    for shape in shapes:
        if tuple(out.shape) == shape:
            out = out[None]
        if tuple(out.shape[1:]) == shape and out.dim() == len(shape) + 1:
            return check_finite(name, out.reshape(len(out), *shapes[0]), CameraError)
    wanted = " or ".join(str(one).replace(",)", ")") for one in shapes)
    raise CameraError(f"{name} must have shape {wanted}, or a batch of those, got {tuple(out.shape)}")


def _pose(name: str, value: Numbers, offset: Tensor | None) -> Tensor:
    """(B,4,4) of rotations with offsets, or of matrices that hold both."""
    if offset is not None:
        turn = _batch(name, value, ((3, 3),))
    else:
        try:
            whole = _batch(name, value, ((4, 4),))
            last = torch.tensor([0.0, 0.0, 0.0, 1.0], dtype=torch.float64)
            if bool(((whole[:, 3] - last).abs() > RIGID).any()):
                raise CameraError(f"{name} must have the last row 0 0 0 1, got {whole[0, 3].tolist()}")
        except CameraError as error:
            if "shape" not in str(error):
                raise
            whole = _batch(name, value, ((3, 4),))
        turn, offset = whole[:, :3, :3], whole[:, :3, 3]
    count = max(len(turn), len(offset))
    if {len(turn), len(offset)} - {1, count}:
        raise CameraError(f"{name} and t must be as many, got {len(turn)} and {len(offset)}")
    pose = torch.eye(4, dtype=torch.float64).repeat(count, 1, 1)
    pose[:, :3, :3] = _rotation(name, turn)
    pose[:, :3, 3] = offset
    return pose


def _rotation(name: str, turn: Tensor) -> Tensor:
    """Exact rotations (B,3,3) nearest to these."""
    size = torch.linalg.det(turn).abs().clamp_min(1e-300).pow(1 / 3)
    off = (turn @ turn.transpose(1, 2) - torch.eye(3, dtype=torch.float64)).abs().amax(dim=(1, 2))
    shape = (turn / size[:, None, None] @ (turn / size[:, None, None]).transpose(1, 2) - torch.eye(3)).abs()
    for at in range(len(turn)):
        where = f"{name}[{at}]" if len(turn) > 1 else name
        if float(torch.linalg.det(turn[at])) < 0 and float(shape[at].max()) < 1e-3:
            raise CameraError(f"{where} mirrors (its determinant is negative): cameras can only be turned and moved")
        if float(off[at]) <= RIGID:
            continue
        if float(shape[at].max()) < 1e-3:
            raise CameraError(f"{where} scales by {float(size[at]):.6g}: divide its first three columns by that")
        raise CameraError(
            f"{where} is no rotation: its rows are off from unit length and right angles by {off[at]:.3g}"
        )
    if bool((off <= 1e-12).all()):
        return turn
    u, _, v = torch.linalg.svd(turn)
    return u @ v


def focal_length(name: str, degrees: float, side: int) -> float:
    """Pixels, of an opening angle over ``side`` pixels."""
    check_no_gradient("a camera", **{name: degrees})
    if not is_number(degrees) or not 0.0 < degrees <= WIDEST_DEG:
        raise CameraError(f"{name} must be in (0, {WIDEST_DEG}], got {degrees!r}")
    check_side("width and height", side)
    _doubt_angle(name, degrees)
    return 0.5 * side / math.tan(math.radians(degrees) / 2)


def _doubt_angle(name: str, degrees: float) -> None:
    """Warn of opening angles that are usual in radians, and as degrees those of a telescope."""
    if 0.2 <= degrees <= math.pi:
        told = f"{name} is {degrees:.4g} degrees, the view of a telescope: if it is in radians, give math.degrees of it"
        warnings.warn(told, ViewWarning, stacklevel=4)


def _doubt_centre(k: Tensor, width: int, height: int) -> None:
    """Warn of intrinsics that were measured in pictures of another size."""
    middle = k[:, :2, 2] / torch.tensor([width, height], dtype=torch.float64)
    if bool(((middle < FARTHEST) | (middle > 1.0 - FARTHEST)).any()):
        x, y = k[0, :2, 2].tolist()
        told = f"K has its principal point at ({x:.5g}, {y:.5g}), far from the middle of {width} x {height} pixels"
        warnings.warn(
            f"{told}: if K is of pictures of another size, scale its first two rows", ViewWarning, stacklevel=3
        )


FARTHEST = 0.3
"""Of a picture's sides: nearer to the border principal points are doubted."""


def _centre(value: float) -> float:
    if value not in (0, 0.5):
        raise CameraError(f"pixel_center must be 0 or 0.5, got {value!r}")
    return float(value)
