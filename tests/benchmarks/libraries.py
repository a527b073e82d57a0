"""What kornia takes beside what is used in its place: python tests/benchmarks/libraries.py.

One picture of 1024 x 768 and the median of seven runs each, in milliseconds; the rows are those of docs/libraries.md.
"""

from __future__ import annotations

import os
import statistics
import sys
import time
from collections.abc import Callable

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

import cv2
import kornia
import numpy as np
import torch

from torchrender.kernels.warp.joint_upsampling import spread_colors
from torchrender.numerics.texture import build_pyramid
from torchrender.photo.fog.depth.labels import guided
from torchrender.scene.camera import Cameras
from torchrender.wire.containers import plane_normals

HEIGHT, WIDTH = 768, 1024


def median_ms(call: Callable[[], object]) -> float:
    """Of seven runs after one that warms up."""
    call()
    taken = []
    for _ in range(7):
        begin = time.perf_counter()
        call()
        taken.append(1e3 * (time.perf_counter() - begin))
    return statistics.median(taken)


def pairs() -> dict[str, tuple[Callable[[], object], Callable[[], object]]]:
    """By what is done: kornia's way, and the other one."""
    chance = torch.Generator().manual_seed(0)
    grey, color = torch.rand(HEIGHT, WIDTH, generator=chance), torch.rand(HEIGHT, WIDTH, 3, generator=chance)
    image, picture = grey[None, None], color.permute(2, 0, 1)[None]
    depth = 2.0 + grey
    camera = Cameras.look_at([0.0, 0.0, 0.0], [0.0, 0.0, -1.0], width=WIDTH, height=HEIGHT)
    matrix = torch.tensor([[[1.01, 0.02, 3.0], [0.01, 0.99, -2.0], [1e-5, 2e-5, 1.0]]])
    v, u = torch.meshgrid(torch.arange(float(HEIGHT)), torch.arange(float(WIDTH)), indexing="ij")
    u, v = u + 3.0 * grey, v - 2.0 * grey
    few = torch.nn.functional.avg_pool2d(picture, 2)[0].permute(1, 2, 0).contiguous().numpy()
    coarse = np.ascontiguousarray(depth.numpy()[::2, ::2])
    ids, small = np.zeros(depth.shape, np.int64), np.zeros(coarse.shape, np.int64)
    out, asked = np.zeros((HEIGHT, WIDTH, 3), np.float32), np.ones(depth.shape, np.bool_)
    grown = torch.nn.functional.interpolate(torch.from_numpy(few).permute(2, 0, 1)[None], (HEIGHT, WIDTH))

    def joint() -> None:
        kinds = np.zeros(1, np.int64)
        spread_colors(few, (coarse, small, small), (depth.numpy(), ids, ids), kinds, (0.05, 0.01, 1e-4), asked, out)

    return {
        "Gaussian blur, 11 pixels": (
            lambda: kornia.filters.gaussian_blur2d(image, (11, 11), (2.0, 2.0)),
            lambda: cv2.GaussianBlur(grey.numpy(), (11, 11), 2.0),
        ),
        "gradient of a picture": (
            lambda: kornia.filters.spatial_gradient(image, mode="diff"),
            lambda: cv2.spatialGradient((255 * grey).byte().numpy()),
        ),
        "guided filter, 25 pixels": (
            lambda: kornia.filters.guided_blur(image, image, 25, 1e-3, separable=True),
            lambda: guided(grey.numpy(), grey.numpy(), 25),
        ),
        "normals from depth": (
            lambda: kornia.geometry.depth.depth_to_normals(depth[None, None].double(), camera.intrinsics),
            lambda: plane_normals(depth, camera),
        ),
        "homography": (
            lambda: kornia.geometry.transform.warp_perspective(picture, matrix, (HEIGHT, WIDTH)),
            lambda: cv2.warpPerspective(color.numpy(), matrix[0].numpy(), (WIDTH, HEIGHT)),
        ),
        "remap by a flow": (
            lambda: kornia.geometry.transform.remap(picture, u[None], v[None], align_corners=True),
            lambda: cv2.remap(color.numpy(), u.numpy(), v.numpy(), cv2.INTER_LINEAR),
        ),
        "pyramid": (
            lambda: kornia.geometry.transform.build_pyramid(picture, 8),
            lambda: build_pyramid(color),
        ),
        "joint upsampling by depth": (
            lambda: kornia.filters.joint_bilateral_blur(grown, image, (5, 5), 0.1, (1.5, 1.5)),
            joint,
        ),
    }


if __name__ == "__main__":
    for name, (theirs, ours) in pairs().items():
        sys.stdout.write(f"| {name} | {median_ms(theirs):.1f} | {median_ms(ours):.1f} |\n")
