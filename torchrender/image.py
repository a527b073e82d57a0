"""A rendered picture with everything that it was made from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from torchrender.brief import brief
from torchrender.buffers import GBuffer, VisibilityBuffer
from torchrender.checks import check_choice, check_range, check_tensor
from torchrender.errors import ImageFileError
from torchrender.images.files import numbered, png_bytes, side_by_side, write_image, write_npz
from torchrender.numerics.color import srgb_from_linear
from torchrender.numerics.tonemap import OPERATORS, auto_exposure, tone_map
from torchrender.pipeline.history import RenderHistory
from torchrender.planning.plan import Plan
from torchrender.raster import rasterize, rasterize_visibility
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene

SUFFIXES = (".png", ".exr", ".npz")

EXR_CHANNELS = ("R", "G", "B", "Z", "N.X", "N.Y", "N.Z", "id.triangle", "id.object", "id.material")
"""Channels of an EXR file: radiance, camera depth, world-space normal and ids (-1 where empty)."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Image:
    """B pictures of one size, in linear light, with what they were made from.

    Raises:
        InputError: radiance that does not fit the cameras.
        OptionError: a tone-mapping operator that does not exist, an exposure outside [-64, 64].
    """

    radiance: Tensor  # (B,H,W,3) linear
    cameras: Cameras  # B
    scene: Scene  # with its lights, as it was rendered
    rendered: GBuffer | None = None  # what was shaded, if that has no more pixels than the picture
    seen: VisibilityBuffer | None = None  # by the picture's own pixels, if it was drawn for the scaling
    buffers: Mapping[str, Any] = field(default_factory=dict)  # those that were asked for, by name
    plan: Plan | None = None  # what was done and why, with predicted and measured times
    timings_ms: Mapping[str, float] = field(default_factory=dict)  # wall time of each step
    exposure: float | None = 0.0  # EV for display; None: automatic, one from the log-average luminance of all views
    tone_map: str = "none"  # operator for display
    history: RenderHistory | None = None  # for the next picture of a sequence; None where none was asked for

    def __post_init__(self) -> None:
        check_tensor("radiance", self.radiance, (len(self.cameras), self.cameras.height, self.cameras.width, 3))
        check_choice("tone_map", self.tone_map, OPERATORS)
        if self.exposure is not None:
            check_range("exposure", self.exposure, -64.0, 64.0)

    def __len__(self) -> int:
        return int(self.radiance.shape[0])

    @cached_property
    def gbuffer(self) -> GBuffer:
        """What every pixel of the picture sees; drawn on first use if the picture was rendered at another size."""
        return self._shaded_whole or rasterize(self.scene, self.cameras)

    @cached_property
    def visibility(self) -> VisibilityBuffer:
        """Depth and ids of :attr:`gbuffer`: quicker where that would have to be drawn."""
        return self._shaded_whole or self.seen or rasterize_visibility(self.scene.geometry, self.cameras)

    @property
    def _shaded_whole(self) -> GBuffer | None:
        """What was shaded, if that has the picture's size."""
        whole = self.rendered is not None and self.rendered.triangle.shape == self.radiance.shape[:3]
        return self.rendered if whole else None

    __repr__ = brief

    def _repr_png_(self) -> bytes:
        """In notebooks."""
        return png_bytes(side_by_side(self.displayed()))

    def displayed(self) -> Tensor:
        """(B,H,W,3) linear values in [0,1]: exposed and tone mapped, one exposure for all views."""
        exposure = self.exposure
        if exposure is None:
            covered = self.gbuffer.covered
            exposure = auto_exposure(self.radiance, mask=covered if bool(covered.any()) else None)
        return tone_map(self.radiance, self.tone_map, exposure=max(-64.0, min(64.0, exposure)))

    def to_srgb(self) -> Tensor:
        """(B,H,W,3) sRGB values in [0,1], as a display wants them."""
        return srgb_from_linear(self.displayed())

    def save(self, path: str | Path) -> list[Path]:
        """Write the pictures and return the files written, for several views numbered ``name_000``, ``name_001`` …

        - ``.png``: exposed, tone mapped, 8-bit sRGB.
        - ``.exr``: linear radiance, depth, normals and ids as named in ``EXR_CHANNELS``, float32 (ids are exact below
          2^24).
        - ``.npz``: radiance, every buffer and the cameras of all views in one file.

        Raises:
            ImageFileError: another suffix, a missing folder, or a file that cannot be written.
        """
        path = Path(path)
        suffix = path.suffix.lower()
        if suffix not in SUFFIXES:
            raise ImageFileError(
                path, f"pictures are saved as {', '.join(SUFFIXES)}, not {path.suffix or 'without one'}"
            )
        if suffix == ".npz":
            write_npz(path, self._arrays())
            return [path]
        if suffix == ".png":
            pictures, channels = self.displayed(), None
        else:
            pictures, channels = self._planes(), EXR_CHANNELS
        files = [numbered(path, number, len(self)) for number in range(len(self))]
        for file, picture in zip(files, pictures, strict=True):
            write_image(file, picture, channels=channels)
        return files

    def _planes(self) -> Tensor:
        g = self.gbuffer
        single = [g.depth, *g.normal.unbind(-1), g.triangle.float(), g.object_id.float(), g.material.float()]
        return torch.cat([self.radiance.detach(), torch.stack(single, dim=-1)], dim=-1)

    def _arrays(self) -> dict[str, Tensor]:
        g = self.gbuffer
        return {
            "radiance": self.radiance,
            "depth": g.depth,
            "triangle": g.triangle,
            "object_id": g.object_id,
            "material": g.material,
            "barycentric": g.barycentric,
            "position": g.position,
            "normal": g.normal,
            "geometric_normal": g.geometric_normal,
            "uv": g.uv,
            "color": g.color,
            **camera_arrays(g.cameras),
        }


def camera_arrays(cameras: Cameras) -> dict[str, Tensor]:
    """The cameras as named arrays for NPZ files."""
    return {
        "camera_from_world": cameras.camera_from_world,
        "intrinsics": cameras.intrinsics,
        "near": cameras.near,
        "far": cameras.far,
        "image_size": torch.tensor([cameras.width, cameras.height]),
        "orthographic": torch.tensor(cameras.orthographic),
    }
