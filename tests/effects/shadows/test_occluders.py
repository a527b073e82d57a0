"""What a light's few depth images keep of a scene, as triangles that cast shadows."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from torchrender.depth.sample import sample_depth_images
from torchrender.effects.shadows.occluders import (
    MESHES,
    OccluderOptions,
    approximate_occluders,
    light_viewpoints,
    sampling_options,
)
from torchrender.effects.shadows.soft_shadow import SoftShadowOptions, soft_shadow
from torchrender.errors import OptionError
from torchrender.raster import rasterize, rasterize_visibility
from torchrender.rays import RayCaster
from torchrender.report.soft_shadows.errors import mean_errors
from torchrender.scene.light import RectLight
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.scene.procedural import build


def overhead(scene: Scene, side: float = 0.6) -> RectLight:
    centre, length = scene.bounds.mean(0) + torch.tensor([0.0, 0.75, 0.0]) * scene.diagonal, side * scene.diagonal
    corner = centre - torch.tensor([length / 2, 0.0, length / 2], dtype=torch.float64)
    return RectLight(corner=corner, edge_u=torch.tensor([length, 0, 0]), edge_v=torch.tensor([0, 0, length]))


def keys(corners: Tensor) -> set[tuple[float, ...]]:
    return {tuple(row) for row in corners.reshape(-1, 9).tolist()}


def triangles(scene: Scene, options: OccluderOptions) -> set[tuple[float, ...]]:
    found = approximate_occluders(scene, overhead(scene), options)
    return keys(found.vertices[found.faces.long()])


def test_triangles_are_those_that_the_images_store() -> None:
    scene, options = build("city", triangles=4000), OccluderOptions(size=96)
    images = sample_depth_images(
        scene, light_viewpoints(overhead(scene), scene.bounds, options), sampling_options(options)
    )
    stored = images.triangle[images.covered].unique()
    assert triangles(scene, options) == keys(scene.geometry.vertices[scene.geometry.faces[stored].long()])
    assert 0 < len(stored) < scene.geometry.triangle_count


def test_non_redundant_images_show_every_triangle_that_conventional_ones_show() -> None:
    # A first hit that is dropped is one whose triangle an earlier image stores.
    for name in ("nest", "city"):
        scene = build(name, triangles=4000)
        more, fewer = (triangles(scene, OccluderOptions(size=96, method=m)) for m in ("nonredundant", "conventional"))
        assert fewer < more


def test_shadows_of_the_shown_triangles_are_right_but_for_hidden_ones() -> None:
    scene = build("city", triangles=4000)
    light, view = overhead(scene), rasterize(scene, scene.camera(width=48, height=48))
    options = SoftShadowOptions(light_samples=6, map_size=256, visibility="shadow_map")
    truth = soft_shadow(scene.geometry, light, view, options, bounds=scene.bounds)
    errors = {}
    for mesh in MESHES:
        casters = approximate_occluders(scene, light, OccluderOptions(size=256, mesh=mesh))
        lit = soft_shadow(casters, light, view, options, bounds=scene.bounds)
        errors[mesh] = mean_errors(lit, truth, view.covered)
        if mesh == "triangles":  # a part of the scene casts no shadow that the scene does not cast
            assert not bool((truth.bits & ~lit.bits).any())
    assert errors["triangles"]["int"] < 1.0
    assert errors["triangles"]["vis"] < min(errors[mesh]["vis"] for mesh in MESHES[1:])
    assert errors["hybrid"]["vis"] < min(errors["grid"]["vis"], errors["splat"]["vis"])


def test_bounds_choose_what_the_images_frame() -> None:
    scene = build("city", triangles=4000)
    low, high = scene.bounds
    middle = torch.stack([low + 0.4 * (high - low), low + 0.6 * (high - low)])
    light = overhead(scene, 0.05)
    whole = approximate_occluders(scene, light, OccluderOptions(size=64))
    part = approximate_occluders(scene, light, OccluderOptions(size=64), bounds=middle)
    corners = part.vertices[part.faces.long()].mean(1)
    inside = ((corners > middle[0]) & (corners < middle[1])).all(-1).double().mean()
    every = whole.vertices[whole.faces.long()].mean(1)
    assert float(inside) > 2 * float(((every > middle[0]) & (every < middle[1])).all(-1).double().mean())


@pytest.mark.parametrize("mesh", MESHES)
def test_lights_without_area_and_scenes_without_triangles(mesh: str) -> None:
    scene, options = build("city", triangles=2000), OccluderOptions(size=48, mesh=mesh)
    light = overhead(scene)
    zero = torch.zeros(3)
    for small in (replace(light, edge_u=zero), replace(light, edge_u=zero, edge_v=zero)):
        assert approximate_occluders(scene, small, options).triangle_count > 0
    assert approximate_occluders(Scene(), light, options).triangle_count == 0


def test_part_of_a_geometry_is_drawn_and_hit_like_the_whole() -> None:
    scene = build("tree", triangles=4000)
    geometry = scene.geometry
    chosen = torch.zeros(geometry.triangle_count, dtype=torch.bool)
    chosen[::3] = True
    part = geometry.part(chosen)
    wanted = keys(geometry.vertices[geometry.faces[chosen].long()])
    assert keys(part.vertices[part.faces.long()]) == wanted and part.triangle_count == int(chosen.sum())
    camera = scene.camera(width=64, height=64)
    alone = Scene(meshes=(Mesh(vertices=geometry.vertices, faces=geometry.faces[chosen].long()),)).geometry
    seen, wanted_view = rasterize_visibility(part, camera), rasterize_visibility(alone, camera)
    assert torch.equal(seen.depth, wanted_view.depth) and int(seen.covered.sum()) > 100
    origins, directions = (r.reshape(-1, 3) for r in camera.rays())
    assert torch.equal(
        RayCaster(part).first_hit(origins, directions).t, RayCaster(alone).first_hit(origins, directions).t
    )


def test_options_are_checked() -> None:
    for wrong in ({"mesh": "cubes"}, {"pixel_test": "guess"}, {"size": 4}, {"method": "all"}):
        with pytest.raises(OptionError, match=next(iter(wrong))):
            OccluderOptions(**wrong)
