"""Batched pinhole (and orthographic) cameras.

Camera frame: OpenCV style, right-handed, x right, y down, z forward. Pixel (row j, column i) covers
[i, i+1) x [j, j+1); its centre is (i+0.5, j+0.5). Depth is camera z. All matrices are float64, because they feed
visibility decisions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from torchrender.checks import as_array, as_vector, check_finite, check_no_gradient, check_range, is_number
from torchrender.errors import CameraError
from torchrender.numerics.transforms import look_at_matrix, pinhole_matrix
from torchrender.scene.cameras.doors import CameraDoors, focal_length
from torchrender.scene.cameras.record import check_side
from torchrender.scene.parts.places import FARTHEST_EYE, check_near


class Cameras(CameraDoors):
    """B cameras that share one image size: what they are made of, ways in and out, how they project.

    Perspective: ``u = fx x/z + cx``, ``v = fy y/z + cy``. Orthographic: ``u = fx x + cx``, ``v = fy y + cy`` with
    ``fx`` in pixels per scene unit. Fragments with ``z < near`` or ``z > far`` are not seen.

    Raises:
        CameraError: a wrong shape, a value that is not finite, a matrix that is no rotation, near not in front of far.
    """

    # ---------------------------------------------------------------- making

    @classmethod
    def look_at(
        cls,
        eye: Tensor | Sequence[float],
        target: Tensor | Sequence[float],
        *,
        width: int,
        height: int,
        fov_deg: float = 50.0,
        up: Tensor | Sequence[float] = (0.0, 1.0, 0.0),
        near: float = 0.01,
        far: float = math.inf,
    ) -> Cameras:
        """Perspective cameras from eye and target, each (3,) or (B,3); ``fov_deg`` is the vertical opening angle.

        Warns:
            ViewWarning: an angle so small that it may be in radians.
        """
        focal = focal_length("fov_deg", fov_deg, height)
        k = pinhole_matrix(focal, focal, width / 2, height / 2)
        return cls._facing((eye, target, up), k, (width, height), (near, far))

    @classmethod
    def orthographic_view(
        cls,
        eye: Tensor | Sequence[float],
        target: Tensor | Sequence[float],
        *,
        width: int,
        height: int,
        view_height: float,
        up: Tensor | Sequence[float] = (0.0, 1.0, 0.0),
        near: float = 0.01,
        far: float = 1e6,
    ) -> Cameras:
        """Orthographic cameras from eye and target, each (3,) or (B,3), that see ``view_height`` scene units of height.

        Raises:
            CameraError: a height that is not above 0, or as of all cameras.
        """
        check_no_gradient("a camera", view_height=view_height)
        check_side("width and height", height)
        if not is_number(view_height) or not 0.0 < view_height < math.inf:
            raise CameraError(f"view_height must be above 0 and finite, got {view_height!r}")
        scale = height / view_height
        k = pinhole_matrix(scale, scale, width / 2, height / 2)
        return cls._facing((eye, target, up), k, (width, height), (near, far), orthographic=True)

    @classmethod
    def _facing(
        cls,
        given: Sequence[Tensor | Sequence[float]],
        k: Tensor,
        size: tuple[int, int],
        limits: tuple[float, float],
        *,
        orthographic: bool = False,
    ) -> Cameras:
        """Cameras at eyes that look at targets, upright along ups: each (3,) or (B,3)."""
        places = [_places(name, value) for name, value in zip(("eye", "target", "up"), given, strict=True)]
        counts = [len(place) for place in places]
        count = min(counts) if 0 in counts else max(counts)
        if any(n not in (1, count) for n in counts):
            raise CameraError(f"eye, target and up must be one or equally many, got {', '.join(map(str, counts))}")
        eyes, targets, ups = (place.expand(count, 3) for place in places)
        if not bool((ups != 0).any(dim=1).all()):
            raise CameraError("up must not be 0, 0, 0")
        matrices = [look_at_matrix(e, t, u) for e, t, u in zip(eyes, targets, ups, strict=True)]
        near, far = (torch.tensor(v, dtype=torch.float64) for v in limits)
        stacked = torch.stack(matrices) if matrices else torch.zeros(0, 4, 4, dtype=torch.float64)
        return cls(stacked, k.expand(count, 3, 3), *size, near, far, orthographic=orthographic)

    @classmethod
    def cat(cls, cameras: Sequence[Cameras]) -> Cameras:
        """One batch from several; all must share image size and projection."""
        if not cameras:
            raise CameraError("cameras must not be empty: an empty batch has a size of pictures, too")
        first = cameras[0]
        if any((c.width, c.height, c.orthographic) != (first.width, first.height, first.orthographic) for c in cameras):
            raise CameraError("cameras in one batch must share width, height and projection")
        return replace(
            first,
            camera_from_world=torch.cat([c.camera_from_world for c in cameras]),
            intrinsics=torch.cat([c.intrinsics for c in cameras]),
            near=torch.cat([c.near for c in cameras]),
            far=torch.cat([c.far for c in cameras]),
        )

    # --------------------------------------------------------------- reading

    def footprint(self, depth: Tensor) -> Tensor:
        """Width of one pixel at camera depth (B,...), scene units: ``z max(1/fx, 1/fy)``; orthographic: constant."""
        size = (1.0 / self.intrinsics[:, (0, 1), (0, 1)]).amax(dim=1).to(depth.dtype)
        size = size.reshape(-1, *([1] * (depth.dim() - 1)))
        return size.expand_as(depth) if self.orthographic else depth * size

    def pixel_centres(self, dtype: torch.dtype = torch.float64) -> Tensor:
        """(H,W,2): u and v of every pixel centre."""
        v, u = torch.meshgrid(
            torch.arange(self.height, dtype=dtype) + 0.5, torch.arange(self.width, dtype=dtype) + 0.5, indexing="ij"
        )
        return torch.stack([u, v], dim=-1)

    # ------------------------------------------------------------ projecting

    def transform(self, points: Tensor) -> Tensor:
        """Camera-space coordinates (B,...,3) of world points (B,...,3), or of (N,3) points for every camera."""
        points, shape = self._per_camera(points, 3)
        moved = points @ self.rotation.transpose(1, 2) + self.camera_from_world[:, None, :3, 3]
        return moved.reshape(shape)

    def project(self, points: Tensor) -> tuple[Tensor, Tensor]:
        """Pixel coordinates (B,...,2) and camera depth (B,...) of world points (B,...,3) or (N,3), float64.

        A point with ``z <= 0`` has no image: its pixel coordinates are NaN (test the depth first), its depth is right.
        """
        camera = self.transform(points)
        z = camera[..., 2]
        k = self.intrinsics.reshape(len(self), *([1] * (camera.dim() - 2)), 3, 3)
        if self.orthographic:
            x, y = camera[..., 0], camera[..., 1]
        else:
            safe = torch.where(z > 0, z, torch.nan)
            x, y = camera[..., 0] / safe, camera[..., 1] / safe
        u = k[..., 0, 0] * x + k[..., 0, 1] * y + k[..., 0, 2]
        v = k[..., 1, 1] * y + k[..., 1, 2]
        return torch.stack([u, v], dim=-1), z

    def unproject(self, pixels: Tensor, depth: Tensor) -> Tensor:
        """World points (B,...,3) float64 of pixel coordinates (B,...,2) (or (H,W,2)) at camera depth (B,...).

        Infinite depth gives infinite or NaN coordinates: mask empty pixels first.

        Raises:
            CameraError: pixels and depth are not of one shape, or not of as many cameras.
        """
        depth = self._of_cameras("depth", depth, 0)
        try:
            pixels = pixels.to(torch.float64).expand(*depth.shape, 2)
        except RuntimeError as error:
            told = f"pixels must have shape {(*depth.shape, 2)} as depth has, got {tuple(pixels.shape)}"
            raise CameraError(told) from error
        x, y = self._plane_coordinates(pixels)
        camera = torch.stack([x, y, torch.ones_like(x)], dim=-1)
        if self.orthographic:
            camera[..., 2] = depth
        else:
            camera = camera * depth[..., None]
        inverse = self.world_from_camera
        flat = (
            camera.reshape(len(self), math.prod(camera.shape[1:-1]), 3) @ inverse[:, :3, :3].transpose(1, 2)
            + inverse[:, None, :3, 3]
        )
        return flat.reshape(camera.shape)

    def rays(self, pixels: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """Origins and directions, each (B,...,3) float64, through pixel coordinates (default: all centres, (B,H,W,3)).

        Directions have camera z = 1, so the ray parameter *is* camera depth; normalise them to get ray length.
        Orthographic origins lie in the plane z = 0.

        Raises:
            CameraError: pixels of another number of cameras, or without two coordinates.
        """
        if pixels is None:
            pixels = self.pixel_centres().expand(len(self), self.height, self.width, 2)
        pixels = self._of_cameras("pixels", pixels, 2)
        x, y = self._plane_coordinates(pixels)
        inverse, count = self.world_from_camera, math.prod(pixels.shape[1:-1])
        if self.orthographic:
            flat = torch.stack([x, y, torch.zeros_like(x)], dim=-1).reshape(len(self), count, 3)
            origins = flat @ inverse[:, :3, :3].transpose(1, 2) + inverse[:, None, :3, 3]
            directions = inverse[:, None, :3, 2].expand_as(flat)
        else:
            flat = torch.stack([x, y, torch.ones_like(x)], dim=-1).reshape(len(self), count, 3)
            directions = flat @ inverse[:, :3, :3].transpose(1, 2)
            origins = inverse[:, None, :3, 3].expand_as(flat)
        return origins.reshape(*pixels.shape[:-1], 3), directions.reshape(*pixels.shape[:-1], 3)

    # --------------------------------------------------------------- changing

    def sub_camera(self, left: float, top: float, width: int, height: int) -> Cameras:
        """The same view, cut to the window whose upper left corner is at pixel coordinates (left, top).

        ``sub_camera(-0.5, -0.5, W+1, H+1)`` is the offset camera whose pixel centres are the corners of this one's
        pixels.
        """
        k = self.intrinsics.clone()
        k[:, 0, 2] -= left
        k[:, 1, 2] -= top
        return replace(self, intrinsics=k, width=width, height=height)

    def scaled(self, factor: float) -> Cameras:
        """The same view with ``factor`` times as many pixels along each side (rounded, at least one)."""
        check_range("factor", factor, 1e-6)
        width, height = max(1, round(self.width * factor)), max(1, round(self.height * factor))
        k = self.intrinsics.clone()
        k[:, 0] *= width / self.width
        k[:, 1] *= height / self.height
        return replace(self, intrinsics=k, width=width, height=height)

    def frustum_planes(self) -> Tensor:
        """(B,6,4) float64 planes (n, d) in world space, unit n pointing inwards: ``n.p + d >= 0`` inside.

        Order: left, right, top, bottom, near, far. An infinite far plane is (0, 0, 0, 1).
        """
        # In numpy: a picture of a millisecond has no time for forty calls of torch.
        k, near, far = (part.detach().numpy() for part in (self.intrinsics, self.near, self.far))
        rows = np.zeros((len(self), 6, 4))
        w, h = float(self.width), float(self.height)
        # p = K_rows applied to (x, y, z or 1): u - 0, W - u, v - 0, H - v, all times z for perspective.
        axis = 3 if self.orthographic else 2
        for plane, (row, sign, border) in enumerate(((0, 1.0, 0.0), (0, -1.0, w), (1, 1.0, 0.0), (1, -1.0, h))):
            rows[:, plane, 0] = sign * k[:, row, 0]
            rows[:, plane, 1] = sign * k[:, row, 1]
            rows[:, plane, axis] = sign * k[:, row, 2] + border
        rows[:, 4, 2], rows[:, 4, 3] = 1.0, -near
        finite = np.isfinite(far)
        rows[:, 5, 2] = np.where(finite, -1.0, 0.0)
        rows[:, 5, 3] = np.where(finite, far, 1.0)
        world = rows @ self.camera_from_world.detach().numpy()
        length = np.linalg.norm(world[..., :3], axis=-1, keepdims=True)
        return torch.from_numpy(np.where(length > 0, world / np.maximum(length, 1e-300), world))

    # ---------------------------------------------------------------- private

    def _per_camera(self, points: Tensor, size: int) -> tuple[Tensor, tuple[int, ...]]:
        points = points.to(torch.float64)
        if points.shape[-1] != size:
            raise CameraError(f"points must have a last dimension of {size}, got {tuple(points.shape)}")
        if points.dim() == 2:
            points = points.expand(len(self), *points.shape)
        if points.shape[0] != len(self):
            raise CameraError(f"points must have a first dimension of {len(self)}, got {tuple(points.shape)}")
        return points.reshape(len(self), math.prod(points.shape[1:-1]), size), tuple(points.shape)

    def _of_cameras(self, name: str, values: Tensor, size: int) -> Tensor:
        """(B,...,size) float64, or (B,...) for size 0."""
        if values.dim() < (2 if size else 1) or values.shape[0] != len(self) or (size and values.shape[-1] != size):
            wanted = f"({len(self)}, ..., {size})" if size else f"({len(self)}, ...)"
            raise CameraError(f"{name} must have shape {wanted}, got {tuple(values.shape)}")
        return values.to(torch.float64)

    def _plane_coordinates(self, pixels: Tensor) -> tuple[Tensor, Tensor]:
        k = self.intrinsics.reshape(len(self), *([1] * (pixels.dim() - 2)), 3, 3)
        y = (pixels[..., 1] - k[..., 1, 2]) / k[..., 1, 1]
        x = (pixels[..., 0] - k[..., 0, 2] - k[..., 0, 1] * y) / k[..., 0, 0]
        return x, y


def _places(name: str, value: Tensor | Sequence[float]) -> Tensor:
    """(B,3) float64 of one place or several."""
    check_no_gradient("a camera", **{name: value})
    places = as_array(name, value, error=CameraError).detach().to("cpu", torch.float64)
    if places.dim() not in (1, 2) or places.shape[-1] != 3:
        raise CameraError(f"{name} must have shape (3,) or (B, 3), got {tuple(places.shape)}")
    places = check_finite(name, places.reshape(len(places) if places.dim() == 2 else 1, 3), CameraError)
    return places if name == "up" else check_near(name, places, CameraError, limit=FARTHEST_EYE)


def framing_camera(
    boxes: Tensor, *, width: int, height: int, fov_deg: float = 45.0, direction: Sequence[float] = (0.55, 0.45, 1.0)
) -> Cameras:
    """A camera that sees all the boxes (N,2,3) from ``direction`` (their centre to the eye), filling 92 % of the image.

    Used where a scene brings no camera of its own. No boxes, or boxes without extent, are framed as one of unit size.
    """
    boxes = boxes.to(torch.float64)
    if not len(boxes) or not bool((boxes[:, 1].amax(0) > boxes[:, 0].amin(0)).any()):
        centre = boxes[0, 0] if len(boxes) else torch.zeros(3, dtype=torch.float64)
        boxes = torch.stack([centre - 0.5, centre + 0.5])[None]
    centre = (boxes[:, 0].amin(0) + boxes[:, 1].amax(0)) / 2
    axis = as_vector("direction", direction, dtype=torch.float64)
    axis = axis / axis.norm()
    corner = torch.cartesian_prod(*[torch.tensor([0, 1])] * 3)
    corners = boxes[:, corner, torch.arange(3)].reshape(-1, 3) - centre
    rotation = look_at_matrix(axis, torch.zeros(3), torch.tensor([0.0, 1.0, 0.0]))[:3, :3]
    x, y, z = (corners @ rotation.T).unbind(1)
    tangent = math.tan(math.radians(fov_deg) / 2) * 0.92
    distance = float((torch.maximum(x.abs() * height / width, y.abs()) / tangent - z).max())
    farthest = distance + float(z.max())
    return Cameras.look_at(
        centre + axis * distance,
        centre,
        width=width,
        height=height,
        fov_deg=fov_deg,
        near=1e-3 * distance,  # whoever goes on from here comes closer
        far=1.01 * farthest,
    )
