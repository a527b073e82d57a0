"""Hard numerical cases of reconstruction and reprojection (specification 02, section 8)."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from depth_scenes import both, depth_images, front_camera, offset_camera, wall
from torchrender.rays import RayCaster
from torchrender.reconstruct.corners import ReconstructOptions, fit_corners
from torchrender.reconstruct.discs import reconstruct_discs
from torchrender.reconstruct.hybrid import reconstruct_hybrid
from torchrender.reconstruct.reproject import reproject
from torchrender.scene import shapes
from torchrender.scene.camera import Cameras
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene

METHODS = ("hybrid", "grid", "splat")


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 10_000), rho=st.floats(1.01, 2.0), merge=st.booleans())
def test_any_normals_keep_corners_near_their_sample(seed: int, rho: float, merge: bool) -> None:
    """Edge-on samples, planes whose horizon crosses the pixel, no normal at all: no spikes, nothing behind the eye."""
    generator = torch.Generator().manual_seed(seed)
    images = depth_images(Scene(meshes=(wall(-5.0),)), front_camera(10))
    normal = torch.nn.functional.normalize(torch.randn(1, 10, 10, 3, generator=generator), dim=-1)
    ray = torch.nn.functional.normalize(images.position, dim=-1).float()
    edge_on = torch.nn.functional.normalize(normal - (normal * ray).sum(-1, keepdim=True) * ray, dim=-1)
    images.normal[:] = torch.where(torch.rand(1, 10, 10, 1, generator=generator) < 0.5, edge_on, normal)
    images.normal[0, 0] = 0.0
    images.depth[:] = torch.rand(1, 10, 10, generator=generator) * 3 + 1
    quads = fit_corners(images, None, ReconstructOptions(guess_ratio=rho, merge_guesses=merge))
    ratio = quads.depth / images.depth[:, :, None]
    # Merged corners are means of values that each lie within rho of their own sample and within both tolerances.
    assert float(ratio.min()) > 0.2 and float(ratio.max()) < 5.0
    lone = fit_corners(
        images,
        depth_images(Scene(), offset_camera(images.cameras)),
        ReconstructOptions(guess_ratio=rho, merge_guesses=False),
    )
    ratio = lone.depth / images.depth[:, :, None]
    assert float(ratio.min()) >= 1 / rho - 1e-6 and float(ratio.max()) <= rho + 1e-6
    assert torch.allclose(lone.depth[0, 0], images.depth[0, 0].expand(4, 10))


def test_border_pixels_have_true_corners() -> None:
    mesh = reconstruct_hybrid(*both(Scene(meshes=(wall(-5.0, tilt_deg=30.0),)), front_camera(5)))
    assert sorted(mesh.corner.tolist()) == list(range(36)) and not bool(mesh.approx.any())


def test_guessed_corners_stay_before_the_near_plane() -> None:
    camera = Cameras.look_at([0.0, 0, 0], [0.0, 0, -1.0], width=8, height=8, fov_deg=60.0, near=0.999)
    images = depth_images(Scene(meshes=(wall(-1.05, tilt_deg=60.0),)), camera)
    assert bool(images.covered.any())
    quads = fit_corners(images)
    assert float(quads.depth[torch.isfinite(quads.depth)].min()) >= 0.999


def test_faces_without_area_are_kept_but_never_hit() -> None:
    images, offset = both(Scene(meshes=(wall(-5.0),)), front_camera(6))
    mesh = reconstruct_hybrid(images, offset)
    flat = mesh.geometry.vertices.clone()
    flat[:, 1] = 0.0  # all corners of every quad on one line
    caster = RayCaster(mesh.geometry).rebuilt(flat)
    assert len(mesh.faces) == 72
    assert not bool(caster.first_hit(torch.zeros(1, 3), torch.tensor([[0.0, 0.0, -1.0]])).hit.any())


def test_coplanar_objects_join_unless_ids_must_match() -> None:
    left, right = wall(-5.0, right=0.02), wall(-5.0, left=0.02)
    images, offset = both(Scene(meshes=(left, right)), front_camera(12))
    assert set(images.object_id.unique().tolist()) == {0, 1}
    joined = reconstruct_hybrid(images, offset)
    assert len(joined.vertices) == 13 * 13
    apart = reconstruct_hybrid(images, offset, ReconstructOptions(match_id=True))
    assert len(apart.vertices) == 14 * 13
    for mesh in (joined, apart):  # no crack either way
        hits = RayCaster(mesh.geometry).first_hit(*(r.reshape(-1, 3) for r in images.cameras.scaled(7).rays()))
        assert bool(hits.hit.all())


@pytest.mark.parametrize("method", METHODS)
def test_cameras_inside_geometry_and_on_samples(method: str) -> None:
    ball = shapes.sphere(1.0, 32)
    scene = Scene(meshes=(Mesh(vertices=ball.vertices + torch.tensor([0.0, 0, -4.0]), faces=ball.faces),))
    images = depth_images(scene, front_camera(32, fov_deg=40.0))
    inside = [front_camera(32, eye=(0.0, 0.0, z)) for z in (-4.0, -3.0, -3.0 + 1e-9, -2.999)]
    for camera in inside:
        result = reproject(images, camera, method=method)
        assert not bool(result.color.isnan().any()) and not bool(result.depth.isnan().any())
        assert bool((result.depth[result.valid] >= 0.01 * (1 - 1e-5)).all())
    # The surface of the ball from within is its back: nothing is drawn.
    assert not bool(reproject(images, inside[0], method=method).valid.any())


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("offset", [1e4, 1e6])
def test_far_from_the_origin(method: str, offset: float) -> None:
    def view(away: float) -> torch.Tensor:
        shift = torch.tensor([away, 0.0, 0.0], dtype=torch.float64)
        plane = wall(-5.0, tilt_deg=20.0, left=-6.0, right=6.0)
        scene = Scene(meshes=(Mesh(vertices=plane.vertices + shift, faces=plane.faces),))
        cameras = Cameras.look_at(
            torch.tensor([[0.0, 0, 0]]) + shift, torch.tensor([[0.0, 0, -1]]) + shift, width=24, height=24, near=0.01
        )
        target = Cameras.look_at(
            torch.tensor([[0.3, 0, 0.2]]) + shift, torch.tensor([[0.0, 0, -5]]) + shift, width=24, height=24, near=0.01
        )
        return reproject(depth_images(scene, cameras), target, method=method).depth

    here, there = view(0.0), view(offset)
    assert float((torch.isfinite(here) == torch.isfinite(there)).float().mean()) > 0.98
    valid = torch.isfinite(here) & torch.isfinite(there)
    assert float((here / there - 1)[valid].abs().max()) < 1e-4


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_scale_does_not_matter(scale: float) -> None:
    def view(size: float) -> tuple[torch.Tensor, torch.Tensor]:
        ball = shapes.sphere(1.0, 24)
        vertices = (ball.vertices.double() + torch.tensor([0.2, 0, -3.0])) * size
        cameras = Cameras.look_at([0.0, 0, 0], [0.0, 0, -size], width=24, height=24, near=0.01 * size)
        target = Cameras.look_at([0.3 * size, 0, 0], [0.0, 0, -3 * size], width=24, height=24, near=0.01 * size)
        result = reproject(depth_images(Scene(meshes=(Mesh(vertices=vertices, faces=ball.faces),)), cameras), target)
        return result.valid, result.depth / size

    valid, depth = view(1.0)
    other_valid, other = view(scale)
    assert float((valid == other_valid).float().mean()) > 0.99
    both_valid = valid & other_valid
    assert torch.allclose(depth[both_valid], other[both_valid], rtol=1e-4)


@settings(deadline=None, max_examples=25)
@given(
    eye=st.tuples(*[st.floats(-6, 6)] * 3),
    toward=st.tuples(*[st.floats(-1, 1)] * 3),
    fov=st.floats(1.0, 170.0),
    method=st.sampled_from(METHODS),
)
def test_any_camera_gives_finite_pictures(eye: tuple, toward: tuple, fov: float, method: str) -> None:
    scene = Scene(meshes=(shapes.box(torch.tensor([2.0, 2.0, 2.0])), wall(-3.0, tilt_deg=15.0)))
    images = depth_images(
        scene, Cameras.look_at([[1.0, 1, 4], [-2.0, 0, 3]], [0.0, 0, 0], width=12, height=12, near=0.01)
    )
    target = torch.tensor(eye) + torch.tensor(toward) + torch.tensor([0.0, 0.0, -1.5])
    camera = Cameras.look_at(torch.tensor(eye), target, width=21, height=13, fov_deg=fov, near=0.01)
    result = reproject(images, camera, method=method)
    assert not bool(result.color.isnan().any())
    assert torch.equal(torch.isfinite(result.depth), result.valid)
    assert torch.equal(result.source >= 0, result.valid)
    assert bool((result.depth[result.valid] >= 0.01 * (1 - 1e-5)).all())


def test_one_pixel_images_and_single_rows() -> None:
    for width, height in ((1, 1), (1, 7), (7, 1)):
        camera = Cameras.look_at([0.0, 0, 0], [0.0, 0, -1.0], width=width, height=height, near=0.01)
        images = depth_images(Scene(meshes=(wall(-5.0, tilt_deg=10.0),)), camera)
        assert len(reconstruct_hybrid(images).faces) == 2 * width * height
        assert bool(reproject(images, camera).valid.all())
        assert not bool(reproject(images, camera, method="grid").valid.any())
        assert len(reconstruct_discs(images).faces) == 6 * width * height
    assert math.isfinite(float(images.depth.sum()))
