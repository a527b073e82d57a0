"""Reconstruction of depth images: the acceptance items of specification 02 that concern meshes."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from depth_scenes import both, depth_images, front_camera, keep_pixels, offset_camera, wall
from torchrender.buffers import DepthImages
from torchrender.errors import InputError, OptionError
from torchrender.raster import rasterize_visibility
from torchrender.rays import RayCaster
from torchrender.reconstruct.corners import ReconstructOptions, SampleQuads, fit_corners
from torchrender.reconstruct.discs import reconstruct_discs
from torchrender.reconstruct.hybrid import Reconstruction, reconstruct_grid, reconstruct_hybrid
from torchrender.reconstruct.quality import closedness, edge_uses, nearby_cameras, quality
from torchrender.scene import shapes
from torchrender.scene.camera import Cameras
from torchrender.scene.mesh import Mesh, concatenate
from torchrender.scene.model import Scene

SIZE = 24


def twin_corners(images: DepthImages, offset: DepthImages, options: ReconstructOptions) -> tuple[Tensor, Tensor]:
    """Slow twin without merging: corner depths (B,H,4,W) and which are true, straight from the formulas."""
    count, height, width = images.depth.shape
    depth = torch.full((count, height, 4, width), torch.inf, dtype=torch.float64)
    true = torch.zeros(count, height, 4, width, dtype=torch.bool)
    for b in range(count):
        camera = images.cameras[b]
        k = camera.intrinsics[0]
        footprint = max(1 / float(k[0, 0]), 1 / float(k[1, 1]))

        def ray(u: float, v: float, k: Tensor = k) -> Tensor:
            return torch.linalg.inv(k) @ torch.tensor([u, v, 1.0], dtype=torch.float64)

        for j in range(height):
            for i in range(width):
                z = float(images.depth[b, j, i])
                if math.isinf(z):
                    continue
                n = camera.rotation[0] @ images.normal[b, j, i].double()
                s = z * ray(i + 0.5, j + 0.5)
                for c, (du, dv) in enumerate(((0, 0), (0, 1), (1, 1), (1, 0))):
                    slope = float(n @ ray(i + du, j + dv))
                    target = float(n @ s) / slope if abs(slope) >= 1e-6 else math.nan
                    if not (math.isfinite(target) and target > 0):
                        target = z
                    seen = float(offset.depth[b, j + dv, i + du])
                    same = not options.match_id or bool(
                        offset.object_id[b, j + dv, i + du] == images.object_id[b, j, i]
                    )
                    margin = options.footprint_tolerance * footprint * z + options.slope_tolerance * abs(target - z)
                    ok = same and abs(seen - target) <= margin
                    guess = max(
                        min(max(target, z / options.guess_ratio), z * options.guess_ratio), float(camera.near[0])
                    )
                    depth[b, j, c, i] = seen if ok else guess
                    true[b, j, c, i] = ok
    return depth, true


def true_corners(quads: SampleQuads) -> Tensor:
    """(B,H,4,W) bool."""
    j = quads.joined
    cut = (j[:, :-1, :-1] >> 12, j[:, 1:, :-1] >> 13, j[:, 1:, 1:] >> 14, j[:, :-1, 1:] >> 15)
    return torch.stack([(c & 1).bool() for c in cut], dim=2)


def faces_toward(mesh: Reconstruction) -> Tensor:
    """Sign of each face's normal against the direction to its camera; 0 for faces without area."""
    corners = mesh.vertices[mesh.faces.long()]
    normal = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    eye = mesh.images.cameras.eye[mesh.face_image]
    return ((eye - corners[:, 0]) * normal).sum(1)


def scene_of_shapes() -> Scene:
    ball = shapes.sphere(0.8, 32)
    ball = Mesh(vertices=ball.vertices + torch.tensor([0.3, 0.1, -3.0]), faces=ball.faces)
    return Scene(meshes=(ball, wall(-4.0, tilt_deg=20.0)))


@pytest.mark.parametrize("match_id", [False, True])
def test_corners_equal_the_slow_twin(match_id: bool) -> None:
    cameras = Cameras.look_at([[0.0, 0, 0], [0.7, 0.4, 0.0]], [0.2, 0.0, -3.0], width=19, height=17, near=0.01)
    images, offset = both(scene_of_shapes(), cameras)
    options = ReconstructOptions(merge_guesses=False, match_id=match_id)
    quads = fit_corners(images, offset, options)
    depth, true = twin_corners(images, offset, options)
    assert torch.equal(true_corners(quads), true)
    assert bool(true.any()) and not bool(true.all())
    assert torch.equal(torch.isinf(quads.depth), torch.isinf(depth))
    filled = torch.isfinite(depth)
    assert torch.allclose(quads.depth[filled].double(), depth[filled], rtol=1e-6)


def test_true_corners_project_onto_image_corners() -> None:
    cameras = Cameras.look_at([0.3, 0.2, 0.0], [0.2, 0.0, -3.0], width=SIZE, height=20, near=0.01)
    mesh = reconstruct_hybrid(*both(scene_of_shapes(), cameras))
    pixels, _ = cameras.project(mesh.vertices[None])
    wanted = torch.stack([mesh.corner % (SIZE + 1), mesh.corner // (SIZE + 1)], dim=1).double()
    assert float((pixels[0] - wanted).abs().max()) < 1e-6


@pytest.mark.parametrize("tilt", [0.0, 45.0, 85.0])
def test_a_plane_becomes_one_closed_mesh(tilt: float) -> None:
    scene = Scene(meshes=(wall(-5.0, tilt_deg=tilt),))
    camera = front_camera(SIZE, fov_deg=8.0)
    mesh = reconstruct_hybrid(*both(scene, camera))
    assert len(mesh.vertices) == (SIZE + 1) ** 2
    assert not bool(mesh.approx.any())
    assert mesh.true_corners.tolist() == [0, 0, 0, 0, SIZE**2]
    assert bool((faces_toward(mesh) > 0).all())
    once, twice, more = edge_uses(mesh.faces).tolist()
    assert (once, more) == (4 * SIZE, 0) and twice == 3 * SIZE**2 - 2 * SIZE
    normal = torch.tensor([-math.sin(math.radians(tilt)), 0.0, math.cos(math.radians(tilt))], dtype=torch.float64)
    along = torch.nn.functional.normalize(mesh.vertices, dim=1) @ normal
    distance = -5.0 * normal[2] / along  # ray length at which the plane is met
    assert float((mesh.vertices.norm(dim=1) / distance - 1).abs().max()) < 1e-5


def test_a_plane_is_closed_without_offset_images() -> None:
    images = depth_images(Scene(meshes=(wall(-5.0, tilt_deg=60.0),)), front_camera(SIZE, fov_deg=20.0))
    mesh = reconstruct_hybrid(images)
    assert len(mesh.vertices) == (SIZE + 1) ** 2
    assert bool(mesh.approx.all())
    assert closedness(fit_corners(images)) == 1.0


def test_a_sphere_keeps_its_true_corners() -> None:
    ball = shapes.sphere(1.0, 256)
    ball = Mesh(vertices=ball.vertices.double() + torch.tensor([0.0, 0.0, -5.0]), faces=ball.faces)
    camera = front_camera(64, fov_deg=35.0)  # radius about 20 pixels
    images, offset = both(Scene(meshes=(ball,)), camera)
    assert 18**2 < float(images.covered.sum()) / math.pi < 22**2
    quads = fit_corners(images, offset)
    seen = offset.covered
    on_ball = torch.stack([seen[:, :-1, :-1], seen[:, 1:, :-1], seen[:, 1:, 1:], seen[:, :-1, 1:]], dim=2)
    on_ball &= images.covered[:, :, None]
    assert float(true_corners(quads)[on_ball].float().mean()) >= 0.995


def two_walls() -> tuple[Scene, Cameras]:
    """Walls 10 footprints apart, the near one in the left half of the picture."""
    camera = front_camera(SIZE)
    gap = 10 * float(camera.footprint(torch.tensor([[5.0]]))[0, 0])
    return Scene(meshes=(wall(-5.0, right=0.05), wall(-5.0 - gap))), camera


@pytest.mark.parametrize("merge", [False, True])
def test_no_face_spans_a_step_and_each_side_keeps_its_rim(merge: bool) -> None:
    scene, camera = two_walls()
    images, offset = both(scene, camera)
    mesh = reconstruct_hybrid(images, offset, ReconstructOptions(merge_guesses=merge))
    _, depth = camera.project(mesh.vertices[None])
    spread = depth[0][mesh.faces.long()]
    assert float((spread.amax(1) - spread.amin(1)).max()) < 1e-4
    pixels = camera.project(mesh.vertices[None])[0][0][mesh.faces.long()]
    near = mesh.images.object_id.reshape(-1)[mesh.face_pixel] == 0
    edge = int((images.object_id[0, 0] == 0).sum())
    assert float(pixels[near][..., 0].max()) == pytest.approx(edge, abs=1e-6)
    assert float(pixels[~near][..., 0].min()) == pytest.approx(edge, abs=1e-6)
    grid = reconstruct_grid(images)
    columns = camera.project(grid.vertices[None])[0][0][grid.faces.long()][..., 0]
    near = grid.images.object_id.reshape(-1)[grid.face_pixel] == 0
    assert float(columns[near].max()) == pytest.approx(edge - 0.5, abs=1e-6)


def test_an_isolated_pixel_becomes_exactly_its_square() -> None:
    images, offset = both(Scene(meshes=(wall(-5.0, tilt_deg=40.0),)), front_camera(9))
    mask = torch.zeros(1, 9, 9, dtype=torch.bool)
    mask[0, 3, 6] = True
    keep_pixels(images, mask)
    keep_pixels(offset, torch.zeros(1, 10, 10, dtype=torch.bool))
    mesh = reconstruct_hybrid(images, offset)
    assert len(mesh.faces) == 2 and bool(mesh.approx.all())
    assert mesh.face_pixel.tolist() == [3 * 9 + 6] * 2
    fine = images.cameras.scaled(8)
    drawn = rasterize_visibility(mesh.geometry, fine, cull="back").covered[0]
    wanted = torch.zeros(72, 72, dtype=torch.bool)
    wanted[24:32, 48:56] = True
    assert torch.equal(drawn, wanted)
    assert len(reconstruct_grid(images).faces) == 0


@pytest.mark.parametrize("offset", [True, False])
def test_a_mesh_drawn_from_its_own_view_is_the_image(offset: bool) -> None:
    cameras = Cameras.look_at([[0.0, 0, 0], [0.7, 0.4, 0.0]], [0.2, 0.0, -3.0], width=SIZE, height=SIZE, near=0.01)
    scene = scene_of_shapes()
    images, shifted = both(scene, cameras)
    mesh = reconstruct_hybrid(images, shifted if offset else None)
    assert len(mesh.faces) == 2 * int(images.covered.sum())
    assert torch.equal(mesh.face_triangle, images.triangle.reshape(-1)[mesh.face_pixel])
    for b in range(2):
        seen = rasterize_visibility(concatenate([mesh.mesh(b)]), cameras[b], cull="back")
        assert torch.equal(seen.covered, images[b].covered)
        close = (seen.depth - images[b].depth).abs() <= 2 * cameras[b].footprint(images[b].depth)
        assert bool(close[seen.covered].all())
        own = torch.arange(SIZE * SIZE).reshape(1, SIZE, SIZE) + b * SIZE * SIZE
        first = int(mesh.face_start[b])
        assert torch.equal(mesh.face_pixel[seen.triangle[seen.covered] + first], own[seen.covered])


def test_geometry_holds_all_images() -> None:
    cameras = Cameras.look_at([[0.0, 0, 0], [0.7, 0.4, 0.0]], [0.2, 0.0, -3.0], width=SIZE, height=SIZE, near=0.01)
    images, offset = both(scene_of_shapes(), cameras)
    mesh = reconstruct_hybrid(images, offset)
    separate = concatenate([mesh.mesh(0), mesh.mesh(1)])
    for name in ("vertices", "faces", "object_id", "colors", "clusters"):
        assert torch.equal(getattr(mesh.geometry, name), getattr(separate, name)), name
    assert int(mesh.true_corners.sum()) == int(images.covered.sum())
    middle = torch.tensor([[0.0, 0.0, 0.0]], dtype=torch.float64)
    hit = RayCaster(mesh.geometry).first_hit(middle, torch.tensor([[0.2, 0.0, -3.0]], dtype=torch.float64))
    assert bool(hit.hit.all())


def test_merging_closes_the_gaps_that_lost_corners_leave() -> None:
    images, offset = both(scene_of_shapes(), front_camera(48))
    lost = torch.rand(offset.depth.shape, generator=torch.Generator().manual_seed(1)) < 0.3
    keep_pixels(offset, ~lost)
    apart = fit_corners(images, offset, ReconstructOptions(merge_guesses=False))
    merged = fit_corners(images, offset)
    assert closedness(apart) < 0.7
    assert closedness(merged) > 0.99


def test_colours_are_means_of_the_samples_around() -> None:
    images, offset = both(Scene(meshes=(wall(-5.0),)), front_camera(8))
    images.color[:] = torch.rand(1, 8, 8, 3, generator=torch.Generator().manual_seed(0))
    mesh = reconstruct_hybrid(images, offset)
    assert mesh.colors is not None
    colors = mesh.colors.reshape(9, 9, 3)
    assert torch.allclose(colors[3, 4], images.color[0, 2:4, 3:5].mean((0, 1)))
    assert torch.allclose(colors[0, 0], images.color[0, 0, 0])


def test_splitting_follows_the_flatter_diagonal() -> None:
    images, offset = both(scene_of_shapes(), front_camera(SIZE))
    fixed = fit_corners(images, offset, ReconstructOptions(adaptive_split=False))
    free = fit_corners(images, offset)
    z = free.depth.unbind(2)
    turned = (z[1] - z[3]).abs() < (z[0] - z[2]).abs()
    assert torch.equal((free.shape & 1).bool(), turned & images.covered)
    assert bool(turned.any()) and not bool((fixed.shape & 1).any())


def test_quality_of_the_three_reconstructions() -> None:
    scene = scene_of_shapes()
    camera = front_camera(48)
    images, offset = both(scene, camera)
    meshes = {
        "hybrid": reconstruct_hybrid(images, offset),
        "grid": reconstruct_grid(images),
        "splat": reconstruct_discs(images),
    }
    own = {name: quality(mesh, scene.geometry, camera) for name, mesh in meshes.items()}
    assert float(own["hybrid"].coverage) == 1.0 and float(own["hybrid"].overdraw) == 1.0
    assert float(own["grid"].coverage) < 1.0 and float(own["grid"].overdraw) == 1.0
    assert float(own["splat"].overdraw) > 2.0
    assert float(own["hybrid"].excess) == 0.0 and float(own["hybrid"].depth_error) < 0.1
    near = nearby_cameras(camera, 4, 0.1)
    hybrid, grid = (quality(meshes[name], scene.geometry, near).coverage for name in ("hybrid", "grid"))
    assert bool((hybrid > grid).all())
    assert float(torch.linalg.norm(near.eye - camera.eye, dim=1).max()) <= 0.1


def test_splats_have_the_area_and_normal_of_their_discs() -> None:
    images = depth_images(Scene(meshes=(wall(-5.0, tilt_deg=30.0),)), front_camera(6))
    mesh = reconstruct_discs(images, scale=1.3)
    corners = mesh.vertices[mesh.faces.long()]
    cross = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * cross.norm(dim=1).reshape(36, 6).sum(1)
    ray = torch.nn.functional.normalize(images.position.reshape(-1, 3), dim=1)
    facing = (ray * images.normal.reshape(-1, 3)).sum(1).abs()
    radius = math.sqrt(0.5) * 1.3 * images.cameras.footprint(images.depth.double()).reshape(-1) / facing
    assert torch.allclose(area, math.pi * radius.square(), rtol=1e-5)
    assert bool((faces_toward(mesh) > 0).all())


def test_what_is_refused() -> None:
    images, offset = both(scene_of_shapes(), front_camera(8))
    with pytest.raises(InputError, match="offset_images"):
        reconstruct_hybrid(images, images)
    with pytest.raises(InputError, match="half a pixel"):
        reconstruct_hybrid(images, depth_images(scene_of_shapes(), front_camera(9)))
    with pytest.raises(OptionError, match="footprint_tolerance"):
        ReconstructOptions(footprint_tolerance=0.1)
    with pytest.raises(OptionError, match="guess_ratio"):
        ReconstructOptions(guess_ratio=3.0)
    with pytest.raises(OptionError, match="scale"):
        reconstruct_discs(images, scale=3.0)
    with pytest.raises(InputError, match="pixels"):
        from torchrender.reconstruct.grid_mesh import fit_grid

        closedness(fit_grid(images))
    assert offset_camera(images.cameras).width == 9 and offset.depth.shape == (1, 9, 9)
