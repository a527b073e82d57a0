"""Visibility between views and flow: closed forms, agreement of both methods, and motion that is followed."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

import torchrender as tr
from torchrender.errors import InputError, OptionError
from torchrender.scene import shapes
from torchrender.scene.mesh import Mesh

WIDTH, HEIGHT, FOCAL = 64, 48, 60.0
K = torch.tensor([[FOCAL, 0.0, WIDTH / 2], [0.0, FOCAL, HEIGHT / 2], [0.0, 0.0, 1.0]])


def camera(x: float = 0.0, y: float = 0.0) -> tr.Cameras:
    """Looks along +z from (x, y, 0)."""
    return tr.Cameras.from_opencv(K, torch.eye(3), [-x, -y, 0.0], width=WIDTH, height=HEIGHT)


def wall(depth: float, half: float, name: str = "wall") -> Mesh:
    """A square across the z axis."""
    corners = torch.tensor([[-half, -half, depth], [half, -half, depth], [half, half, depth], [-half, half, depth]])
    return Mesh(vertices=corners, faces=torch.tensor([[0, 1, 2], [0, 2, 3]]), name=name)


@pytest.fixture(scope="module")
def layers() -> tr.Scene:
    """A small square at depth 2 before a large one at depth 4."""
    return tr.Scene(meshes=[wall(2.0, 0.3, "near"), wall(4.0, 50.0, "far")])


@pytest.mark.parametrize("method", ["rays", "depth"])
def test_flow_of_a_sideways_step_is_focal_times_step_over_depth(layers, method) -> None:
    a, b = (tr.rasterize(layers, camera(x)) for x in (0.0, 0.25))
    found = tr.flow(a, b, method=method)
    wanted = torch.stack([-FOCAL * 0.25 / a.depth, torch.zeros_like(a.depth)], dim=-1)
    torch.testing.assert_close(found.flow, wanted, atol=1e-4, rtol=0)


@pytest.mark.parametrize("method", ["rays", "depth"])
def test_what_the_near_square_hides_is_occluded(layers, method) -> None:
    """A point at u of the far wall lies at u - 3.75 in b; the near square covers [-9 - 7.5, 9 - 7.5] there."""
    a, b = (tr.rasterize(layers, camera(x)) for x in (0.0, 0.25))
    found = tr.flow(a, b, method=method)
    u, v = (camera().pixel_centres() - torch.tensor([WIDTH / 2, HEIGHT / 2])).unbind(-1)
    far = a.depth[0] > 3.0
    moved = u - 3.75
    hidden = far & (v.abs() < 9.0) & (moved > -16.5) & (moved < 1.5)
    outside = far & (moved < -WIDTH / 2)
    edge = (v.abs() - 9.0).abs() < 1.0
    edge |= ((moved + 16.5).abs() < 1.0) | ((moved - 1.5).abs() < 1.0)
    sure = ~edge if method == "depth" else torch.ones_like(edge)
    wanted = ~(hidden | outside)
    assert torch.equal(found.visible[0][sure], wanted[sure])
    assert torch.equal(found.occluded[0][sure], ~wanted[sure])
    assert int(hidden.sum()) > 50


def test_both_methods_agree_away_from_edges_on_a_furnished_room() -> None:
    scene = tr.load("cornell_box")
    base = scene.camera(width=120, height=90)
    step = base.camera_from_world.clone()
    step[:, 0, 3] -= 0.15
    a, b = tr.rasterize(scene, base), tr.rasterize(scene, replace(base, camera_from_world=step))
    by_rays, by_depth = tr.flow(a, b), tr.flow(a, b, method="depth")
    # Away from edges of either picture: where object and depth of neighbours agree, and so where the point lands.
    inner = _inner(a)
    landing = (by_rays.flow + base.pixel_centres().float()).floor().long()
    column, row = landing[..., 0].clamp(0, 119), landing[..., 1].clamp(0, 89)
    inner &= _inner(b)[0, row, column]
    inner &= (landing[..., 0] > 1) & (landing[..., 0] < 118)
    same = by_rays.visible == by_depth.visible
    assert int(inner.sum()) > 4000
    assert float(same[inner].float().mean()) >= 0.999
    assert torch.equal(by_rays.visible, tr.visibility(b.cameras, a))


def _inner(g: tr.GBuffer) -> torch.Tensor:
    kinds = torch.nn.functional.unfold(g.object_id[:, None].double(), 5, padding=2).reshape(1, 25, *g.depth.shape[1:])
    return (kinds == kinds[:, 12:13]).all(dim=1)


def test_moving_surfaces_are_followed(layers) -> None:
    shift = torch.tensor([0.1, 0.05, 0.0])
    near, far = layers.meshes
    later = replace(layers, meshes=(replace(near, vertices=near.vertices + shift), far))
    a, b = tr.rasterize(layers, camera()), tr.rasterize(later, camera())
    found = tr.flow(a, b)
    square = a.object_id == 0
    torch.testing.assert_close(
        found.flow[square], torch.tensor([3.0, 1.5]).expand(int(square.sum()), 2), atol=1e-4, rtol=0
    )
    torch.testing.assert_close(found.flow[~square], torch.zeros(int((~square).sum()), 2), atol=1e-4, rtol=0)
    assert bool(found.visible[square].all())
    assert not bool(found.visible[~square].all())


def test_visibility_of_several_cameras_and_other_occluders(layers) -> None:
    seen = tr.rasterize(layers, camera())
    two = tr.Cameras.cat([camera(), camera(50.0)])
    both = tr.visibility(two, seen)
    assert bool(both[0].all())
    assert not bool(both[1].any())  # nothing of it lies inside that view
    cover = wall(1.0, 50.0)
    assert not bool(tr.visibility(camera(), seen, cover).any())
    assert bool(tr.visibility(camera(), seen, tr.RayCaster(layers)).all())
    parallel = tr.Cameras(torch.eye(4)[None], torch.tensor([[[10.0, 0, 32], [0, 10.0, 24], [0, 0, 1]]]), 64, 48,
                          torch.tensor(0.0), torch.tensor(9.0), orthographic=True)  # fmt: skip
    square = seen.object_id == 0
    view = tr.visibility(parallel, seen)
    assert bool(view[square].all())
    behind = ~square & (seen.position[..., :2].abs().amax(dim=-1) < 0.3)
    assert not bool(view[behind].any())


def test_empty_pixels_have_no_flow() -> None:
    ball = tr.Scene(
        meshes=[replace(shapes.sphere(0.5, 16), vertices=shapes.sphere(0.5, 16).vertices + torch.tensor([0, 0, 3.0]))]
    )
    a = tr.rasterize(ball, camera())
    found = tr.flow(a, a)
    assert bool(torch.isnan(found.flow[~a.covered]).all())
    assert not bool((found.visible | found.occluded)[~a.covered].any())
    torch.testing.assert_close(found.flow[a.covered], torch.zeros(int(a.covered.sum()), 2), atol=1e-4, rtol=0)
    nothing = tr.rasterize(tr.Scene(), camera())
    assert not bool(tr.flow(nothing, nothing).visible.any())


def test_what_does_not_fit_is_named(layers) -> None:
    a, two = tr.rasterize(layers, camera()), tr.rasterize(layers, tr.Cameras.cat([camera(), camera()]))
    with pytest.raises(InputError, match="b must have 1 or 1 pictures, got 2"):
        tr.flow(a, two)
    with pytest.raises(InputError, match="got 3 and 2"):
        tr.visibility(tr.Cameras.cat([camera()] * 3), two)
    with pytest.raises(OptionError, match="method must be one of rays, depth"):
        tr.flow(a, a, method="guess")
    loose = replace(a, depth=a.depth)
    with pytest.raises(InputError, match="shape must be given"):
        tr.visibility(camera(), loose)


def test_arguments_of_other_classes_are_named(layers) -> None:
    picture = tr.rasterize(layers, camera())
    with pytest.raises(InputError, match="gbuffer must be GBuffer, got int"):
        tr.visibility(camera(), 3)
    with pytest.raises(InputError, match="cameras must be Cameras, got"):
        tr.visibility(picture, picture)
    with pytest.raises(InputError, match="b must be GBuffer, got int"):
        tr.flow(picture, 3)
