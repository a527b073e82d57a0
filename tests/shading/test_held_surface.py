"""Depth, weights and attributes with visibility held: as drawn, and with the derivatives that differences show."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

import torchrender as tr
from torchrender.errors import InputError

BOX = tr.Mesh.box([1.0, 1.3, 0.8])
PERSPECTIVE = tr.Cameras.look_at([[1.5, 1.2, 2.0], [-1.0, 0.7, 2.4]], [0.1, 0.0, 0.0], width=12, height=9, fov_deg=40.0)
SKEWED = replace(
    PERSPECTIVE,
    intrinsics=PERSPECTIVE.intrinsics + torch.tensor([[2.0, 0.7, 0.4], [0.0, 0.0, -0.6], [0.0, 0.0, 0.0]]).double(),
)
ORTHOGRAPHIC = replace(
    PERSPECTIVE,
    intrinsics=torch.tensor([[5.0, 0.3, 6.2], [0.0, 4.0, 4.1], [0.0, 0.0, 1.0]]).double().expand(2, 3, 3),
    far=torch.tensor(50.0),
    orthographic=True,
)
VIEWS = pytest.mark.parametrize("cameras", [PERSPECTIVE, SKEWED, ORTHOGRAPHIC], ids=["lens", "skewed", "parallel"])


def scene(box: tr.Mesh = BOX) -> tr.Scene:
    return tr.Scene(meshes=[box])


@VIEWS
def test_values_are_those_that_were_drawn(cameras: tr.Cameras) -> None:
    seen = tr.rasterize(scene(), cameras)
    held = tr.held_surface(seen, BOX.vertices, BOX.faces)
    torch.testing.assert_close(held.depth.float(), seen.depth, rtol=1e-5, atol=0)
    torch.testing.assert_close(held.position, seen.position, rtol=1e-6, atol=1e-6)
    torch.testing.assert_close(held.barycentric[..., 1:].float(), seen.barycentric, rtol=0, atol=2e-5)
    assert bool(torch.isinf(held.depth[~seen.covered]).all()) and 20 < int(seen.covered.sum()) < 200
    torch.testing.assert_close(held.blend(BOX.vertices.double()), held.position, rtol=0, atol=1e-9)
    assert not tr.held_surface(seen, BOX.vertices, BOX.faces).depth.requires_grad


def _parts(cameras: tr.Cameras) -> tuple[Tensor, Tensor, Tensor]:
    return (
        BOX.vertices.double().clone().requires_grad_(),
        cameras.camera_from_world.clone().requires_grad_(),
        cameras.intrinsics.clone().requires_grad_(),
    )


@VIEWS
@pytest.mark.parametrize("what", ["depth", "barycentric", "position", "blend"])
def test_derivatives_are_exact(cameras: tr.Cameras, what: str) -> None:
    """gradcheck, in float64, of what the covered pixels have, to vertices, poses and intrinsics."""
    seen = tr.rasterize(scene(), cameras)
    colors = torch.rand(len(BOX.vertices), 2, dtype=torch.float64, generator=torch.Generator().manual_seed(3))

    def values(vertices: Tensor, pose: Tensor, lens: Tensor) -> Tensor:
        held = tr.held_surface(seen, vertices, BOX.faces, camera_from_world=pose, intrinsics=lens)
        found = held.blend(colors) if what == "blend" else getattr(held, what)
        return found[seen.covered][::5]

    assert torch.autograd.gradcheck(values, _parts(cameras), eps=1e-6, atol=1e-6)


def test_attributes_of_vertices_have_derivatives() -> None:
    held = tr.held_surface(tr.rasterize(scene(), PERSPECTIVE), BOX.vertices, BOX.faces)
    values = torch.rand(len(BOX.vertices), 3, dtype=torch.float64).requires_grad_()
    assert torch.autograd.gradcheck(lambda v: held.blend(v)[held.seen.covered][::7], (values,))


def test_the_next_picture_is_what_derivatives_foretell() -> None:
    """Moved vertices, drawn anew: pixels that see the same triangles have changed as the slope says."""
    step = 1e-3 * torch.tensor([[0.7, -0.4, 1.0]]) * (1.0 + BOX.vertices.double())
    vertices = BOX.vertices.double().clone().requires_grad_()
    before, after = (
        tr.rasterize(scene(replace(BOX, vertices=BOX.vertices.double() + k * step)), PERSPECTIVE) for k in (0, 1)
    )
    same = (before.triangle == after.triangle) & before.covered
    depth = tr.held_surface(before, vertices, BOX.faces).depth
    change = torch.zeros(int(same.sum()), dtype=torch.float64)
    for number, value in enumerate(depth[same]):
        (slope,) = torch.autograd.grad(value, vertices, retain_graph=True)
        change[number] = (slope * step).sum()
    wanted = (after.depth - before.depth)[same].double()
    assert len(change) > 40 and float(wanted.abs().max()) > 1e-4
    torch.testing.assert_close(change, wanted, rtol=0.02, atol=2e-6)


def test_outlines_carry_none_and_no_camera_is_an_empty_answer() -> None:
    seen = tr.rasterize(scene(), PERSPECTIVE)
    vertices = BOX.vertices.double().clone().requires_grad_()
    tr.held_surface(seen, vertices, BOX.faces).depth.nan_to_num(posinf=0.0).sum().backward()
    used = torch.zeros(len(vertices), dtype=torch.bool)
    used[BOX.faces[seen.triangle[seen.covered]].reshape(-1)] = True
    assert (
        vertices.grad is not None
        and bool((vertices.grad[~used] == 0).all())
        and bool(torch.isfinite(vertices.grad).all())
    )
    assert tr.held_surface(tr.rasterize(scene(), PERSPECTIVE[:0]), BOX.vertices, BOX.faces).depth.shape == (0, 9, 12)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"vertices": torch.zeros(4)}, r"vertices must have shape \(V, 3\)"),
        ({"vertices": torch.full((24, 3), torch.nan)}, "vertices must be finite"),
        ({"vertices": torch.zeros(2, 3)}, "faces must index 2 vertices"),
        ({"faces": BOX.faces[:1]}, "faces must be those that were drawn"),
        ({"camera_from_world": torch.eye(4)}, r"camera_from_world must have shape \(2, 4, 4\)"),
        ({"intrinsics": torch.eye(3)[None]}, r"intrinsics must have shape \(2, 3, 3\)"),
    ],
)
def test_what_does_not_fit_is_named(change: dict[str, Tensor], told: str) -> None:
    given = {"vertices": BOX.vertices, "faces": BOX.faces, **change}
    with pytest.raises(InputError, match=told):
        tr.held_surface(tr.rasterize(scene(), PERSPECTIVE), **given)
    held = tr.held_surface(tr.rasterize(scene(), PERSPECTIVE), BOX.vertices, BOX.faces)
    with pytest.raises(InputError, match="values must have a row"):
        held.blend(torch.zeros(3, 2))
