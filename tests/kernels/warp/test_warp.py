"""The warp kernels against slow, obvious twins."""

from __future__ import annotations

import numba
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from depth_scenes import depth_images, front_camera, wall
from torchrender.kernels.atomics import store_max
from torchrender.kernels.warp.corners import FIRST, SECOND
from torchrender.kernels.warp.warp import Canvas, Poses, Quads, draw_quads
from torchrender.raster import rasterize_visibility
from torchrender.reconstruct.corners import fit_corners
from torchrender.reconstruct.reproject import reproject
from torchrender.scene.camera import Cameras
from torchrender.scene.mesh import Mesh, concatenate
from torchrender.scene.model import Scene


def twin(corners: np.ndarray, shape: np.ndarray, matrix: np.ndarray, near: float, size: tuple[int, int]) -> tuple:
    """Nearest quad and depth per pixel by testing every pixel against every triangle, in float64 and unsnapped."""
    width, height = size
    depth = np.full((height, width), np.inf)
    owner = np.full((height, width), -1)
    border = np.zeros((height, width), bool)  # pixels so close to an edge that snapping may decide
    _, h, _, w = corners.shape
    for j in range(h):
        for i in range(w):
            if not shape[0, j, i]:
                continue
            points = []
            for c, (du, dv) in enumerate(((0, 0), (0, 1), (1, 1), (1, 0))):
                points.append(float(corners[0, j, c, i]) * (matrix[0, :, :3] @ [i + du, j + dv, 1.0]) + matrix[0, :, 3])
            order = ((1, 2, 3), (3, 0, 1)) if shape[0, j, i] & 1 else ((0, 1, 2), (2, 3, 0))
            for tri in order:
                if min(points[c][2] for c in tri) < near:
                    continue
                a, b, c = (points[c][:2] / points[c][2] for c in tri)
                q = [1.0 / points[c][2] for c in tri]
                area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
                if area >= 0:
                    continue
                for y in range(height):
                    for x in range(width):
                        p = (x + 0.5, y + 0.5)
                        e = [
                            ((n[0] - m[0]) * (p[1] - m[1]) - (n[1] - m[1]) * (p[0] - m[0])) / area
                            for m, n in ((b, c), (c, a), (a, b))
                        ]
                        if min(e) > -0.02:
                            border[y, x] |= min(e) < 0.02
                        if min(e) >= 0:
                            z = 1.0 / sum(k * v for k, v in zip(e, q))
                            if z < depth[y, x]:
                                depth[y, x], owner[y, x] = z, j * w + i
    return depth, owner, border


@settings(deadline=None, max_examples=15)
@given(
    seed=st.integers(0, 10_000),
    turn=st.floats(-0.3, 0.3),
    shift=st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1.5, 1.0)),
)
def test_quads_equal_the_slow_twin(seed: int, turn: float, shift: tuple[float, float, float]) -> None:
    rng = np.random.default_rng(seed)
    corners = rng.uniform(2.0, 4.0, (1, 4, 4, 5)).astype(np.float32)
    shape = rng.choice(np.array([0, 6, 7], np.uint8), (1, 4, 5))
    k = np.array([[4.0, 0, 2.5], [0, 4.0, 2.0], [0, 0, 1.0]])
    target = np.array([[9.0, 0.2, 5.5], [0, 9.0, 5.0], [0, 0, 1.0]])
    rotation = np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
    matrix = np.concatenate([target @ rotation @ np.linalg.inv(k), (target @ np.array(shift))[:, None]], axis=1)[None]
    size = (11, 10)
    keys = np.zeros(size[0] * size[1], np.uint64)
    draw_quads(Quads(corners, shape, 0.0), Poses(matrix, 0.01, np.ones(1)), 2, Canvas(keys, *size))
    depth, owner, border = twin(corners, shape, matrix, 0.01, size)
    keys = keys.reshape(10, 11)
    number = np.where(keys > 0, 0xFFFFFFFF - (keys & np.uint64(0xFFFFFFFF)).astype(np.int64), -1)
    q = (keys >> np.uint64(32)).astype(np.uint32).view(np.float32)
    sure = ~border
    np.testing.assert_array_equal(number[sure], owner[sure])
    hit = sure & (owner >= 0)
    np.testing.assert_allclose(1.0 / q[hit], depth[hit], rtol=2e-3)


def test_the_atomic_maximum() -> None:
    @numba.njit
    def put(values, index, value):
        store_max(values, index, value)

    values = np.array([5, 2**63], np.uint64)
    put(values, 0, np.uint64(3))
    assert values[0] == 5
    put(values, 0, np.uint64(2**63 + 1))
    put(values, 1, np.uint64(7))
    assert values.tolist() == [2**63 + 1, 2**63]


@pytest.mark.parametrize("scale", [1, 3])
def test_joined_quads_cover_each_pixel_once(scale: int) -> None:
    """A quad is only seen where no other is: all pixels of a frame-filling plane have an owner, and in place."""
    images = depth_images(Scene(meshes=(wall(-5.0, tilt_deg=50.0),)), front_camera(16))
    quads = fit_corners(images)
    camera = images.cameras.scaled(scale)
    keys = np.zeros(camera.width * camera.height, np.uint64)
    to_target = np.zeros((1, 3, 4))
    to_target[0, :, :3] = np.diag([scale, scale, 1.0])
    draw_quads(
        Quads(quads.depth.numpy(), quads.shape.numpy(), 0.0),
        Poses(to_target, 0.01, np.ones(1)),
        2,
        Canvas(keys, 16 * scale, 16 * scale),
    )
    owner = (0xFFFFFFFF - (keys & np.uint64(0xFFFFFFFF)).astype(np.int64)).reshape(16 * scale, 16 * scale)
    wanted = np.kron(np.arange(256).reshape(16, 16), np.ones((scale, scale), np.int64))
    assert (keys > 0).all()
    np.testing.assert_array_equal(owner, wanted)


def test_splats_equal_ray_disc_intersection() -> None:
    images = depth_images(Scene(meshes=(wall(-4.0, tilt_deg=30.0),)), front_camera(8))
    mask = torch.zeros(1, 8, 8, dtype=torch.bool)
    mask[0, 2:5:2, 3:6:2] = True
    images.depth[~mask], images.triangle[~mask] = torch.inf, -1
    camera = front_camera(60, eye=(0.2, 0.1, -0.5), fov_deg=50.0)
    result = reproject(images, camera, method="splat")
    origin, ray = camera.rays()
    best = torch.full((60, 60), torch.inf, dtype=torch.float64)
    for j, i in mask[0].nonzero().tolist():
        centre, normal = images.position[0, j, i], images.normal[0, j, i].double()
        own = torch.nn.functional.normalize(centre, dim=0)
        footprint = float(images.cameras.footprint(images.depth.double())[0, j, i])
        radius = (0.5**0.5) * footprint / max(abs(float(own @ normal)), 0.1)
        t = ((centre - origin[0]) @ normal) / (ray[0] @ normal)
        inside = (origin[0] + t[..., None] * ray[0] - centre).norm(dim=-1) <= radius
        best = torch.where(inside & (t > 0.01), torch.minimum(best, t), best)
    assert int((torch.isfinite(best)).sum()) > 100
    assert float((torch.isfinite(best) == result.valid[0]).float().mean()) > 0.9995
    agree = torch.isfinite(best) & result.valid[0]
    assert torch.allclose(result.depth[0][agree].double(), best[agree], rtol=1e-5)


def test_quads_through_the_near_plane_agree_with_the_rasteriser() -> None:
    """A floor below the camera that reaches behind it: quads are cut at the near plane, not dropped."""
    floor = Mesh(
        vertices=torch.tensor([[-4.0, -1, -8], [4, -1, -8], [4, -1, 8], [-4, -1, 8]]),
        faces=torch.tensor([[0, 2, 1], [0, 3, 2]]),
    )
    scene = Scene(meshes=(floor,))
    above = Cameras.look_at([0.0, 5.0, 0.1], [0.0, -1.0, 0.0], width=12, height=12, fov_deg=60.0, near=0.01)
    images = depth_images(scene, above)
    low = Cameras.look_at([0.0, -0.7, 0.5], [0.0, -0.9, -2.0], width=64, height=64, fov_deg=90.0, near=0.05)
    result = reproject(images, low)
    truth = rasterize_visibility(concatenate([floor]), low)
    covered = result.valid & truth.covered
    assert int(covered.sum()) > 1000
    assert not bool((result.valid & ~truth.covered).any())
    assert bool(result.valid[0, -1].all())  # the floor under the camera comes from quads that reach behind it
    assert float((result.depth / truth.depth - 1)[covered].abs().max()) < 1e-3


def test_what_is_nearer_than_the_near_plane_hides_nothing() -> None:
    """A quad that reaches from before the near plane to behind it, and another one behind: no hole where it is cut."""
    corners = np.zeros((2, 1, 4, 1), np.float32)
    corners[0, 0, :, 0] = (0.2, 1.5, 3.0, 1.5)  # upper left, lower left, lower right, upper right: cut along a diagonal
    corners[1] = 4.0
    shape = np.full((2, 1, 1), FIRST | SECOND, np.uint8)
    matrix = np.zeros((2, 3, 4))
    matrix[:, 0, 0] = matrix[:, 1, 1] = 16.0
    matrix[:, 2, 2] = 1.0
    keys = np.zeros(16 * 16, np.uint64)
    draw_quads(Quads(corners, shape, 0.0), Poses(matrix, 1.0, np.ones(2)), 2, Canvas(keys, 16, 16))
    owner = (0xFFFFFFFF - (keys & np.uint64(0xFFFFFFFF)).astype(np.int64)).reshape(16, 16)
    inverse = (keys >> np.uint64(32)).astype(np.uint32).view(np.float32).reshape(16, 16)
    assert set(np.unique(owner)) == {0, 1} and owner[0, 0] == 1 and owner[15, 15] == 0
    assert (owner == 1).sum() > 10 and inverse.max() <= 1.0 + 1e-6
