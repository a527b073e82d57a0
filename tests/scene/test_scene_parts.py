"""Meshes, materials, lights, media, environment and the scene that holds them."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from torchrender.errors import InputError, MeshError, OptionError
from torchrender.kernels.raster.project import BLOCK
from torchrender.kernels.raster.records import SOLID
from torchrender.scene.cutout import Corners, build_cutout
from torchrender.scene.environment import Environment, latlong_directions
from torchrender.scene.light import DirectionalLight, PointLight, RectLight, SpotLight
from torchrender.scene.load import load
from torchrender.scene.material import Material, Sampler, from_metallic_roughness
from torchrender.scene.medium import Medium
from torchrender.scene.mesh import CLUSTER, Mesh, concatenate
from torchrender.scene.model import Scene

TRIANGLE = torch.tensor([[0.0, 0, 0], [2, 0, 0], [0, 2, 0]])
FACE = torch.tensor([[0, 1, 2]])


def strip(count, **fields):
    """``count`` separate triangles along x."""
    vertices = (TRIANGLE[None] + 3.0 * torch.arange(count)[:, None, None] * torch.tensor([1.0, 0, 0])).reshape(-1, 3)
    return Mesh(vertices=vertices, faces=torch.arange(3 * count).reshape(-1, 3), **fields)


def test_concatenation_keeps_ids_and_fills_what_is_missing():
    first = strip(2, uv=torch.rand(6, 2), object_id=7)
    second = strip(CLUSTER + 5, normals=torch.ones(3 * (CLUSTER + 5), 3), material=1)
    g = concatenate([first, second])
    assert g.triangle_count == CLUSTER + 7
    assert g.object_id.tolist() == [7, 7] + [1] * (CLUSTER + 5)
    assert g.material.tolist() == [0, 0] + [1] * (CLUSTER + 5)
    assert torch.equal(g.uv[:6], first.uv) and float(g.uv[6:].abs().sum()) == 0
    assert float(g.normals[:6].abs().sum()) == 0 and bool((g.normals[6:] == 1).all())
    assert g.colors is None and g.cutout is None
    assert g.runs.tolist() == [0, 2, CLUSTER + 7]
    assert g.clusters.tolist() == [[0, 2], [2, 2 + CLUSTER], [2 + CLUSTER, CLUSTER + 7]]
    assert torch.equal(g.vertices[g.faces[2].long()], second.vertices[:3].double())


def test_clusters_hold_all_triangles_once_and_stay_within_their_mesh():
    far_apart = strip(300)
    shuffled = Mesh(vertices=far_apart.vertices, faces=far_apart.faces[torch.randperm(300)])
    g = concatenate([shuffled, strip(3)])
    assert sorted(g.order.tolist()) == list(range(303))
    assert torch.equal(g.order[300:].sort().values, torch.tensor([300, 301, 302], dtype=torch.int32))
    rows, faces, listed = g.numbering
    assert torch.equal(rows[faces.long()], g.faces) and torch.equal(listed, faces[g.order.long()])
    assert torch.equal(g.numbered_vertices, g.vertices[rows.long()]) and len(rows) == len(g.faces.unique())
    starts, blocks = g.cluster_blocks
    for c, ((first, end), (low, high)) in enumerate(zip(g.clusters, g.cluster_bounds, strict=True)):
        used = g.faces[g.order[first:end].long()].long()
        corners = g.vertices[used]
        assert torch.equal(corners.amin((0, 1)), low) and torch.equal(corners.amax((0, 1)), high)
        assert float(high[0] - low[0]) <= 3.0 * (CLUSTER + 6)  # neighbours, however the faces were shuffled
        own = faces[g.order[first:end].long()]
        assert sorted(blocks[starts[c] : starts[c + 1]].tolist()) == (own // BLOCK).unique().tolist()
    torch.testing.assert_close(g.bounds[1], torch.tensor([899.0, 2, 0], dtype=torch.float64))


@pytest.mark.parametrize("scale", [1.0, 1e-150, 1e14])
def test_face_normals_of_any_size_and_of_nothing(scale):
    vertices = torch.cat([TRIANGLE, torch.zeros(3, 3)]).double() * scale
    g = concatenate([Mesh(vertices=vertices, faces=torch.tensor([[0, 1, 2], [3, 4, 5], [0, 2, 1]]))])
    torch.testing.assert_close(g.face_normals, torch.tensor([[0.0, 0, 1], [0, 0, 0], [0, 0, -1]]))


def test_bad_meshes_are_named():
    with pytest.raises(MeshError, match=r"'m'.*vertices"):
        Mesh(name="m", vertices=torch.zeros(3, 2), faces=FACE)
    with pytest.raises(MeshError, match=r"'m'.*faces"):
        Mesh(name="m", vertices=TRIANGLE, faces=FACE.float())
    with pytest.raises(MeshError, match=r"'m'.*uv"):
        Mesh(name="m", vertices=TRIANGLE, faces=FACE, uv=torch.zeros(2, 2))
    with pytest.raises(InputError, match=r"'m'.*material"):
        Scene(meshes=(Mesh(name="m", vertices=TRIANGLE, faces=FACE, material=3),))


def test_materials_check_themselves():
    for field, value in (("specular", 1.5), ("gloss", -0.1), ("shininess", math.nan), ("alpha_cutoff", 2.0)):
        with pytest.raises(OptionError, match=field):
            Material(**{field: value})
    with pytest.raises(InputError, match="diffuse_texture"):
        Material(diffuse_texture=torch.zeros(4, 4))
    codes: Any = np.zeros((8, 8, 3), np.uint8)
    with pytest.raises(InputError, match=r"must hold floats in linear light, got uint8: divide codes"):
        Material(diffuse_texture=codes)
    grey: Any = np.full((8, 8, 3), 0.5)
    shown = Material(diffuse_texture=grey)
    assert torch.equal(shown.diffuse, torch.ones(3)), "as bright as the file"
    assert torch.equal(Material().diffuse, torch.full((3,), 0.8))
    assert torch.equal(Material(diffuse=0.3, diffuse_texture=grey).diffuse, torch.full((3,), 0.3))
    assert isinstance(Material(diffuse_texture=grey).diffuse_texture, torch.Tensor)
    with pytest.raises(InputError, match="diffuse"):
        Material(diffuse=torch.tensor([0.1, math.nan, 0]))


def test_metallic_roughness_limits():
    red = torch.tensor([0.9, 0.1, 0.1])
    plastic = from_metallic_roughness(base_color=red, metallic=0.0, roughness=0.5)
    metal = from_metallic_roughness(base_color=red, metallic=1.0, roughness=0.1)
    torch.testing.assert_close(plastic.diffuse, red)
    assert plastic.specular == pytest.approx(0.04) and not plastic.is_reflector
    assert float(metal.diffuse.sum()) == 0 and metal.specular == pytest.approx(0.9) and metal.is_reflector
    torch.testing.assert_close(metal.specular_color * metal.specular, red)
    assert metal.shininess > plastic.shininess
    for roughness in (0.0, 1.0):
        assert 1.0 <= from_metallic_roughness(base_color=red, metallic=0.5, roughness=roughness).shininess <= 1e6


def test_cutout_masks_only_textures_with_holes():
    holey = torch.ones(2, 3, 4)
    holey[0, 1, 3] = 0.2
    materials = (
        Material(diffuse_texture=holey, alpha_cutoff=0.5),
        Material(diffuse_texture=torch.ones(2, 2, 4), alpha_cutoff=0.5),
        Material(diffuse_texture=holey),
    )
    corners = Corners(torch.arange(12).reshape(4, 3), torch.rand(12, 2), None, None)
    cutout = build_cutout(materials, torch.tensor([0, 1, 2, 0]), corners, 12)
    assert cutout.mask.tolist() == [0, -1, -1, 0]
    assert cutout.triangles.tolist() == [0, 3]
    solid = (cutout.texels >= SOLID).tolist()
    assert cutout.table.tolist() == [[0, 2, 3, 0]] and solid == [True, False, True, True, True, True]
    assert build_cutout(materials[1:], torch.tensor([0, 1]), corners, 12) is None


def test_cutouts_lie_as_their_sampler_says_and_count_all_opacities():
    turned = torch.tensor([[0.0, 2.0, 0.1], [1.0, 0.0, 0.0]])
    sampler = Sampler(uv_set=1, transform=turned, wrap_u="mirror", wrap_v="clamp")
    leaf = Material(
        diffuse_texture=torch.full((2, 2, 4), 0.6), alpha_cutoff=0.5, samplers={"diffuse_texture": sampler}, opacity=0.9
    )
    uv1, alpha = torch.rand(3, 2), torch.tensor([1.0, 0.5, 0.0])
    corners = Corners(torch.tensor([[0, 1, 2]]), torch.zeros(3, 2), uv1, alpha)
    cutout = build_cutout((leaf,), torch.tensor([0]), corners, 3)
    torch.testing.assert_close(cutout.vertices, torch.stack([2 * uv1[:, 1] + 0.1, uv1[:, 0], alpha], dim=1))
    assert cutout.table.tolist() == [[0, 2, 2, 1 + 3 * 2]] and bool((cutout.texels >= SOLID).all())
    nothing = build_cutout((Material(opacity=0.0, alpha_cutoff=0.5),), torch.tensor([0]), corners, 3)
    assert nothing.texels.tolist() == [0]


def test_lights_normalise_and_check():
    assert float(DirectionalLight(direction=torch.tensor([0.0, -3, 0])).direction.norm()) == pytest.approx(1)
    with pytest.raises(InputError, match=r"DirectionalLight\.direction"):
        DirectionalLight(direction=torch.zeros(3))
    with pytest.raises(InputError, match=r"PointLight\.position"):
        PointLight(position=torch.tensor([0.0, 1]))
    with pytest.raises(OptionError, match="inner_deg"):
        SpotLight(position=torch.zeros(3), direction=torch.ones(3), inner_deg=40, outer_deg=30)
    for outer, inner in ((5.0, 10.0 / 3.0), (30.0, 20.0), (60.0, 20.0)):
        usual = SpotLight(position=torch.zeros(3), direction=torch.ones(3), outer_deg=outer)
        assert usual.inner_deg == pytest.approx(inner)
        assert replace(usual, inner_deg=1.0, outer_deg=2.0).inner_deg == 1.0
    spot = SpotLight(position=torch.zeros(3), direction=torch.tensor([0.0, -1, 0]), inner_deg=20, outer_deg=40)
    share = spot.cone(torch.cos(torch.deg2rad(torch.tensor([0.0, 19, 30, 41, 180]))))
    assert share[:2].tolist() == [1, 1] and share[3:].tolist() == [0, 0]
    # The shader of KHR_lights_punctual: clamp(cosine * scale + offset)^2, both numbers from the cosines of the cone.
    inner, here, outer = (math.cos(math.radians(angle)) for angle in (20, 30, 40))
    assert float(share[2]) == pytest.approx(((here - outer) / (inner - outer)) ** 2, rel=1e-5)


def test_area_light_samples_are_cell_centres():
    light = RectLight(corner=torch.zeros(3), edge_u=torch.tensor([2.0, 0, 0]), edge_v=torch.tensor([0.0, 0, 4]))
    assert light.area == pytest.approx(8) and light.normal.tolist() == [0, -1, 0]
    samples = light.samples(2)
    assert samples.tolist() == [[0.5, 0, 1], [0.5, 0, 3], [1.5, 0, 1], [1.5, 0, 3]]
    torch.testing.assert_close(light.samples(5).mean(0), light.centre)
    line = RectLight(corner=torch.zeros(3), edge_u=torch.zeros(3), edge_v=torch.ones(3))
    assert line.area == 0 and float(line.normal.abs().sum()) == 0


def test_environment_looks_up_what_it_stores():
    radiance = torch.rand(16, 32, 3, generator=torch.Generator().manual_seed(0))
    environment = Environment(radiance=radiance, intensity=2.0)
    torch.testing.assert_close(environment.lookup(latlong_directions(16, 32)), 2 * radiance, atol=2e-4, rtol=0)
    middle = Environment(radiance=radiance).lookup(torch.tensor([[0.0, 0, -1]]))
    torch.testing.assert_close(middle[0], radiance[7:9, 15:17].mean((0, 1)), atol=1e-5, rtol=0)
    turned = Environment(radiance=radiance, rotation_deg=90).lookup(torch.tensor([[0.0, 0, -1]]))
    torch.testing.assert_close(turned, Environment(radiance=radiance).lookup(torch.tensor([[1.0, 0, 0]])))


def test_constant_environment_gives_pi_times_its_radiance():
    sky = Environment.constant(torch.tensor([0.5, 1.0, 2.0]))
    normals = torch.nn.functional.normalize(torch.randn(50, 3, generator=torch.Generator().manual_seed(1)), dim=1)
    expected = math.pi * torch.tensor([0.5, 1.0, 2.0]).expand(50, 3)
    torch.testing.assert_close(sky.irradiance(normals), expected, rtol=5e-3, atol=0)


def test_intensity_scales_irradiance_as_it_scales_radiance():
    """Once, not twice: a constant sky of intensity 2 brings 2 pi."""
    up = torch.tensor([[0.0, 1.0, 0.0]])
    for intensity in (0.0, 0.5, 2.0, 1e3):
        sky = Environment(radiance=torch.ones(16, 32, 3), intensity=intensity)
        torch.testing.assert_close(sky.irradiance(up), torch.full((1, 3), intensity * math.pi), rtol=5e-3, atol=1e-9)
    colors = torch.rand(16, 32, 3, generator=torch.Generator().manual_seed(2))
    plain, strong = (Environment(radiance=colors, intensity=value).irradiance(up) for value in (1.0, 3.0))
    torch.testing.assert_close(strong, 3.0 * plain)


def test_irradiance_of_a_bright_upper_half():
    sky = torch.zeros(64, 128, 3)
    sky[:32] = 1.0
    environment = Environment(radiance=sky)
    up, side, down = environment.irradiance(torch.tensor([[0.0, 1, 0], [1, 0, 0], [0, -1, 0]]))[:, 0].tolist()
    assert up == pytest.approx(math.pi, rel=0.03)
    assert side == pytest.approx(math.pi / 2, rel=0.03)
    assert down == pytest.approx(0.0, abs=0.1)


@pytest.mark.parametrize("side", [1, 2, 5])
def test_every_texel_of_a_cube_shows_where_opengl_says(side):
    """OpenGL 4.6, table 8.19: direction to the middle of each texel, and back."""
    faces = torch.arange(6 * side * side).reshape(6, side, side)[..., None].expand(-1, -1, -1, 3)
    environment = Environment.from_cube(faces, height=256)
    assert set(environment.radiance[..., 0].long().reshape(-1).tolist()) == set(range(6 * side * side))
    middles = 2 * (torch.arange(side) + 0.5) / side - 1
    t, s = torch.meshgrid(middles, middles, indexing="ij")
    one = torch.ones_like(s)
    for face, way in enumerate(
        ((one, -t, -s), (-one, -t, s), (s, one, t), (s, -one, -t), (s, -t, one), (-s, -t, -one))
    ):
        found = environment.lookup(torch.nn.functional.normalize(torch.stack(way, dim=-1), dim=-1))
        torch.testing.assert_close(found, faces[face].float(), atol=1e-3, rtol=0)


def test_cube_faces_land_where_they_belong():
    faces = torch.arange(6.0)[:, None, None, None].expand(6, 4, 4, 3)
    environment = Environment.from_cube(faces + 1, height=64)
    axes = torch.tensor([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
    torch.testing.assert_close(environment.lookup(axes)[:, 0], torch.arange(6.0) + 1)
    with pytest.raises(InputError, match="faces"):
        Environment.from_cube(torch.zeros(5, 4, 4, 3))


def test_bad_environments_and_media_are_named():
    with pytest.raises(InputError, match="negative"):
        Environment(radiance=-torch.ones(2, 2, 3))
    with pytest.raises(InputError, match="finite"):
        Environment(radiance=torch.full((2, 2, 3), math.inf))
    with pytest.raises(InputError, match="high"):
        Medium(low=torch.ones(3), high=torch.zeros(3))
    with pytest.raises(OptionError, match="asymmetry"):
        Medium(low=torch.zeros(3), high=torch.ones(3), asymmetry=1.0)
    with pytest.raises(InputError, match="density"):
        Medium(low=torch.zeros(3), high=torch.ones(3), density=torch.zeros(3))


def test_default_light_only_where_there_is_none():
    dark = Scene(meshes=(strip(1),))
    lit = dark.with_default_light()
    assert len(lit.lights) == 1 and lit.environment is not None
    assert dark.geometry is dark.with_default_light().geometry
    assert lit.with_default_light() is lit
    lamp = Scene(meshes=(strip(1),), materials=(Material(emission=torch.ones(3)),))
    assert lamp.with_default_light() is lamp


def test_unknown_cameras_are_refused_with_the_known_names():
    scene = Scene(meshes=(strip(1),))
    with pytest.raises(InputError, match="none"):
        scene.camera("front", width=8, height=8)
    named = Scene(meshes=(strip(1),), cameras={"door": scene.camera(width=8, height=8)})
    with pytest.raises(InputError, match="door"):
        named.camera("front", width=8, height=8)
    assert named.camera(width=16, height=8).width == 16


CORNER: Any = {"vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "faces": [[0, 1, 2]]}


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda word: Mesh(**CORNER, material=word), "mesh 'mesh': material must be a number in Scene"),
        (lambda word: Mesh(**CORNER, material=Material(name=word)), "mesh 'mesh': material must be a number in Scene"),
        (lambda word: Mesh(**CORNER, object_id=word), "mesh 'mesh': object_id must be a number, got 'red'"),
        (lambda _: Mesh(**CORNER, name=3), "name of a mesh must be text, got int"),
        (lambda word: Mesh.sphere(word), "must be a number, got 'red'"),
        (lambda word: Mesh.sphere(segments=word), "must be a number, got 'red'"),
        (lambda word: Mesh(**CORNER).transformed(word), "matrix must be"),
        (lambda word: Material(specular=word), "specular must be a number, got 'red'"),
        (lambda word: Material(metallic=word), "metallic must be a number, got 'red'"),
        (lambda _: Material(name=3), "name of a material must be text"),
        (lambda word: Environment.constant(word), "color must be 3 numbers, got 'red'"),
        (lambda word: Environment(radiance=torch.ones(2, 4, 3), intensity=word), "intensity must be a number"),
        (lambda word: Environment(radiance=torch.ones(2, 4, 3), rotation_deg=word), "rotation_deg must be a number"),
        (lambda word: Medium(low=(0, 0, 0), high=(1, 1, 1), density=word), "density must be a number, got 'red'"),
        (lambda _: Scene(name=3), "name of a scene must be text"),
        (lambda word: Scene(cameras=[word]), "cameras must be a mapping of names to Cameras, such as"),
        (lambda word: Scene(cameras={"front": word}), "camera 'front' must be Cameras, got str"),
        (lambda word: Scene().at(word), "time must be a finite number of seconds, got 'red'"),
        (lambda _: Scene().with_meshes(3), "meshes must be Mesh, one or several, got int"),
        (lambda _: Scene().moved(3, torch.eye(4)), "name of an object must be text, got int"),
        (lambda word: load("city", size=word), "size must be a number, got 'red'"),
        (lambda _: load(3), "load takes a path or a name, got int"),
    ],
)
def test_slips_of_type_are_told_by_name(make: Any, told: str) -> None:
    with pytest.raises(InputError, match=re.escape(told)):
        make("red")


def test_an_unknown_object_tells_how_many_there_are() -> None:
    scene = Scene(meshes=[Mesh(**CORNER, name=f"part {number}") for number in range(12)])
    with pytest.raises(InputError, match=r"there are part 0, .*part 7 … \(12 in all\)$"):
        scene.mesh("zzz")
    few = Scene(meshes=[Mesh(**CORNER, name=f"part {number}") for number in range(8)])
    with pytest.raises(InputError, match=r"part 6, part 7$"):
        few.mesh("zzz")


def test_meshes_without_any_material_are_told_so() -> None:
    with pytest.raises(InputError, match="materials must not be empty: mesh 'plane' has number 0 of them"):
        Scene(meshes=[Mesh.plane(1.0)], materials=[])
    assert Scene(materials=[]).materials == ()
