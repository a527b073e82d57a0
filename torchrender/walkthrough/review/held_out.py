"""Photos that were not used, against pictures of the walkthrough from their cameras."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from torchrender.numerics.color import srgb_from_linear
from torchrender.scene.camera import Cameras
from torchrender.walkthrough.draw import FILLED, draw_walkthrough
from torchrender.walkthrough.frames.prepare import Capture, Progress, prepare, quiet, read_frame
from torchrender.walkthrough.frames.record import Array, RgbdSequence
from torchrender.walkthrough.frames.registration import locate, shift_color, shifted
from torchrender.walkthrough.frames.rim import empty_rim
from torchrender.walkthrough.model import Walkthrough
from torchrender.walkthrough.options import DrawOptions, WalkthroughOptions


@dataclass(frozen=True)
class HeldOutError:
    """Error on N photos that the walkthrough was not made of. PSNR is of sRGB values, over covered pixels.

    The empty rim of undistorted photos shows nothing: its pixels do not count.
    """

    names: tuple[str, ...]
    psnr_db: tuple[float, ...]
    coverage: tuple[float, ...]  # share of pixels that show something
    filled: tuple[float, ...]  # share of pixels that show made-up texels
    depth_error: tuple[float, ...]  # median, share of depth
    ms: tuple[float, ...]  # of drawing

    @property
    def mean_psnr_db(self) -> float:
        """Mean over photos; NaN if there are none."""
        return float(np.mean(self.psnr_db)) if self.psnr_db else float("nan")

    @property
    def mean_coverage(self) -> float:
        """Mean over photos; NaN if there are none."""
        return float(np.mean(self.coverage)) if self.coverage else float("nan")

    def record(self) -> dict[str, object]:
        """For the report of a build."""
        return {
            "photos": list(self.names),
            "psnr_db": round(self.mean_psnr_db, 3),
            "coverage": round(self.mean_coverage, 5),
            "each_psnr_db": [round(v, 2) for v in self.psnr_db],
            "each_coverage": [round(v, 4) for v in self.coverage],
            "filled": round(float(np.mean(self.filled)), 5) if self.filled else None,
            "depth_error": round(float(np.mean(self.depth_error)), 6) if self.depth_error else None,
            "frame_ms": round(float(np.median(self.ms)), 2) if self.ms else None,
        }


def located_poses(
    capture: Capture, held: RgbdSequence, world: Array, options: WalkthroughOptions, progress: Progress = quiet
) -> dict[str, Array]:
    """World-from-camera poses of held-out photos among photos whose own poses were repaired. Nothing else is learned
    from
    them."""
    found = {}
    for frame in progress([f for f in held.frames if f.depth is not None], "locate held-out photos"):
        turned = replace(frame, world_from_camera=world @ frame.world_from_camera)
        photo = prepare(RgbdSequence((turned,), held.name), options)
        shift_color(photo, capture.color_shift)
        found[frame.name] = locate(capture, photo, options.seed)
    return found


def photo_camera(lens: Array, pose: Array, size: tuple[int, int], near: float) -> Cameras:
    """A camera from fx, fy, cx, cy, world-from-camera (4,4) and height and width."""
    k = torch.tensor([[[lens[0], 0, lens[2]], [0, lens[1], lens[3]], [0, 0, 1.0]]], dtype=torch.float64)
    return Cameras(
        torch.linalg.inv(torch.from_numpy(np.ascontiguousarray(pose)))[None],
        k,
        size[1],
        size[0],
        torch.tensor([near], dtype=torch.float64),
        torch.tensor([torch.inf], dtype=torch.float64),
    )


def code_psnr(image: Tensor, photo: Array, mask: Tensor) -> float:
    """PSNR in dB of a linear picture (H,W,3) against sRGB codes (H,W,3) over ``mask`` (H,W); NaN if that is empty."""
    if not bool(mask.any()):
        return float("nan")
    made = srgb_from_linear(image.clamp(0, 1))[mask].double()
    truth = torch.from_numpy(photo)[mask].double() / 255
    return float(-10 * torch.log10((made - truth).square().mean().clamp_min(1e-12)))


def held_out_error(
    walkthrough: Walkthrough,
    held: RgbdSequence | None,
    options: DrawOptions | None = None,
    *,
    poses: Mapping[str, Array] | None = None,
    progress: Progress = quiet,
) -> HeldOutError:
    """Draw the walkthrough from the cameras of photos and compare.

    Colour is moved over depth as it was for the photos that were used; gains are not applied.

    Args:
        poses: (4,4) world-from-camera poses by name, in the frame of the walkthrough; else those given with the photos.
    """
    rows: list[tuple[str, float, float, float, float, float]] = []
    world = walkthrough.world_from_input.numpy()
    affine = np.array(walkthrough.report.get("color_shift", np.eye(2, 3).tolist()))
    frames = [f for f in held.frames if f.depth is not None] if held is not None else []
    for frame in progress(frames, "held-out photos"):
        color, depth, lens = read_frame(frame)
        if not np.array_equal(affine, np.eye(2, 3)):
            color = shifted(color, affine)
        shown = torch.from_numpy(~empty_rim(color))
        near = 1e-3 * max(walkthrough.diagonal, 1e-9)
        pose = (
            world @ frame.world_from_camera if poses is None else poses.get(frame.name, world @ frame.world_from_camera)
        )
        camera = photo_camera(lens, pose, (depth.shape[0], depth.shape[1]), near)
        drawn = draw_walkthrough(walkthrough, camera, options)
        covered = drawn.covered[0]
        known = covered.numpy() & np.isfinite(depth) & (depth > 0)
        off = np.abs(drawn.depth[0].numpy()[known] - depth[known]) / depth[known]
        rows.append(
            (
                frame.name,
                code_psnr(drawn.image[0], color, covered & shown),
                float(covered[shown].float().mean()),
                float((drawn.kind[0] == FILLED)[shown].float().mean()),
                float(np.median(off)) if len(off) else float("nan"),
                sum(drawn.statistics[0].ms.values()),
            )
        )
    columns = list(zip(*rows)) if rows else [()] * 6
    return HeldOutError(*columns)
