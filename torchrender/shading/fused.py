"""Shading by the compiled kernel: straight from what is seen, without a G-buffer."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.utils.weak import WeakIdKeyDictionary

from torchrender.arrays import Recycler
from torchrender.arrays import view as array
from torchrender.buffers import GBuffer, RaySurface, VisibilityBuffer
from torchrender.kernels.compile import thread_count
from torchrender.kernels.shading.needs import stages_of
from torchrender.kernels.shading.pack import pack_planes
from torchrender.kernels.shading.records import (
    IRRADIANCE_SIDE,
    SPAN,
    TILE,
    UNLIT,
    Out,
    Packed,
    Reach,
    Samples,
    Sky,
    View,
)
from torchrender.kernels.shading.shade import shade
from torchrender.numerics.lobe_albedo import albedo_table
from torchrender.numerics.texture import padded
from torchrender.scene.mesh import Geometry
from torchrender.scene.model import Scene
from torchrender.shading.attributes import attribute_arrays, eye_of
from torchrender.shading.lights import LightLists, light_table
from torchrender.shading.linear_cosines import filled_up
from torchrender.shading.lobes import Around, Sent
from torchrender.shading.looks import looks_of
from torchrender.shading.origin import origin_of
from torchrender.shading.sky import SkyMaps, sky_lobes

Array = np.ndarray[Any, Any]
f4 = np.float32
_PACKED: WeakIdKeyDictionary = WeakIdKeyDictionary()
_memory = Recycler(1 << 26)
_NONE, _NONE4 = np.zeros((0, 3), f4), np.zeros((0, 4), f4)
_EVERYWHERE = (np.zeros(1, np.int64), np.zeros(0, np.int32))
"""No lists of lights: each may reach all pixels."""


def send_fused(
    scene: Scene,
    samples: VisibilityBuffer | RaySurface,
    visibility: Tensor | None,
    around: Around,
    how: tuple[str, Tensor | None, bool],
    lists: LightLists | None = None,
) -> Sent:
    """As :func:`torchrender.shading.plain.send`, the background of images included.

    Args:
        samples: of the scene's own geometry; hits of rays must know their triangles.
        how: way of area lights; colour (3,) of the background, None: environment, else ambient light; mirrors: compute
            what they need, else those parts are empty.
        lists: of images, lights that are not listed for a block of pixels are left out there.
    """
    area_light, background, mirrors = how
    packed = packed_geometry(scene.geometry)
    looks = looks_of(scene.materials, scene.material_table)
    sky = _sky(scene, background)
    images = 1 if isinstance(samples, RaySurface) else len(samples.cameras)
    assert samples.triangle is not None
    count = samples.triangle.numel()
    each = count // max(images, 1)
    made = np.zeros if isinstance(samples, RaySurface) else _memory.empty
    radiance = made((count, 3), f4)
    more = [np.zeros((count if mirrors else 0, 3), f4) for _ in range(2)]
    shadow = None if visibility is None or not len(visibility) else array(visibility, f4).reshape(len(visibility), -1)
    lights = _rows_of(scene, lists)
    share = np.zeros(0, f4) if around.visibility is None else array(around.visibility, f4)
    bent = np.zeros((0, 3), f4) if around.normal is None else array(around.normal.T, f4)
    for k in range(images):
        view, seen = _hits(scene, samples) if isinstance(samples, RaySurface) else _image(scene, samples, k)
        part = slice(k * each, (k + 1) * each)
        none = np.zeros((0, 1), f4)
        reach = Reach(
            light_table(scene.lights, view.origin, area_light),
            none if shadow is None or not len(shadow) else np.ascontiguousarray(shadow[:, part]),
            lights,
            share[part],
            bent[part],
            *_listed(lists, k, images),
        )
        out = Out(radiance[part], more[0][part], more[1][part], np.zeros((0, 4), f4))
        _run(seen, view, packed, looks, sky, reach, out, side=1 if lists is None else lists.side)
    return Sent(torch.from_numpy(radiance).T, *(torch.from_numpy(value).T for value in more))


def read_fused(scene: Scene, samples: VisibilityBuffer | RaySurface, rows: Tensor) -> tuple[Tensor, Tensor]:
    """Shading normals (N,3), bent by their maps, and roughness (N,) of samples in flat rows (N,); nothing is lit."""
    chosen = np.zeros(samples.covered.numel(), np.bool_)
    chosen[rows.numpy()] = True
    surface = np.zeros((len(chosen), 4), f4)
    _read(scene, samples, chosen, _no_sky(), (_NONE, surface))
    found = torch.from_numpy(surface).index_select(0, rows)
    return found[:, :3], found[:, 3]


def matt_fused(scene: Scene, samples: VisibilityBuffer, chosen: Tensor) -> tuple[Tensor, Tensor]:
    """What surfaces send (N,3) where diffuse light of irradiance pi comes from all around and nothing is mirrored, and
    (N,4) their shading normals and roughness; of the flat samples ``chosen`` (N,) bool, 0 for others."""
    picked, count = array(chosen, np.bool_), chosen.numel()
    sent, surface = np.zeros((count, 3), f4), np.zeros((count, 4), f4)
    _read(scene, samples, picked, _even_sky(1.0), (sent, surface))
    made = torch.from_numpy(sent)
    table = scene.material_table
    if bool((table.emission > 0).any()) or bool((table.physical.kind == UNLIT).any()):
        dark = np.zeros((count, 3), f4)
        _read(scene, samples, picked, _even_sky(0.0), (dark, _NONE4))
        made = made - torch.from_numpy(dark)
    return made, torch.from_numpy(surface)


def _read(
    scene: Scene, samples: VisibilityBuffer | RaySurface, chosen: Array, sky: Sky, made: tuple[Array, Array]
) -> None:
    """Chosen samples (N,) under the sky alone: radiance (N,3) and surface (N,4), either may have no rows."""
    packed = packed_geometry(scene.geometry)
    looks = looks_of(scene.materials, scene.material_table)
    images = 1 if isinstance(samples, RaySurface) else len(samples.cameras)
    each = len(chosen) // max(images, 1)
    dark = Reach(
        np.zeros((0, 32), f4), np.zeros((0, 1), f4), np.zeros(0, np.int64), np.zeros(0, f4), _NONE, *_EVERYWHERE
    )
    for k in range(images):
        view, seen = _hits(scene, samples) if isinstance(samples, RaySurface) else _image(scene, samples, k)
        part = slice(k * each, (k + 1) * each)
        triangle = np.where(chosen[part].reshape(seen.triangle.shape), seen.triangle, -1)
        out = Out(made[0][part], _NONE, _NONE, made[1][part])
        _run(seen._replace(triangle=triangle), view, packed, looks, sky, dark, out)


def _run(*given: Any, side: int = 1) -> None:
    """The kernel on its records, with the stages that it needs; lights are listed for blocks of ``side`` pixels."""
    columns, rows = TILE if given[0].triangle.shape[0] > 1 else (SPAN, 1)
    stages = stages_of(*given)
    shade(*given, stages._replace(columns=columns, rows=rows, workers=thread_count(), side=side))


def _rows_of(scene: Scene, lists: LightLists | None) -> Array:
    """(L,) int64 which shadow factors a light has, -1: none, all of it arrives."""
    count = len(scene.lights)
    if lists is None or lists.shaded is None:
        return np.arange(count)
    rows = np.full(count, -1)
    rows[list(lists.shaded)] = np.arange(len(lists.shaded))
    return rows


def _listed(lists: LightLists | None, k: int, images: int) -> tuple[Array, Array]:
    """Where the lists of image ``k`` begin, and what is listed."""
    if lists is None:
        return _EVERYWHERE
    blocks = (len(lists.starts) - 1) // images
    starts = array(lists.starts[k * blocks : (k + 1) * blocks + 1], np.int64)
    return starts, array(lists.lights, np.int32)


def packed_geometry(geometry: Geometry) -> Packed:
    """The triangles as the kernel reads them, packed once for each geometry."""
    known = _PACKED.get(geometry)
    if known is None:
        known = _PACKED[geometry] = _packed(geometry)
    made: Packed = known
    return made


def _packed(geometry: Geometry) -> Packed:
    vertices, count = geometry.vertices, geometry.triangle_count
    corners = torch.zeros(len(vertices), 8)
    corners[:, 3:6] = 1.0
    for columns, value in ((slice(0, 3), geometry.normals), (slice(3, 6), geometry.colors), (slice(6, 8), geometry.uv)):
        if value is not None:
            corners[:, columns] = value
    second = geometry.uv1
    further = torch.zeros(0 if second is None else len(vertices), 4)
    if second is not None:
        further[:, :2] = second
    planes, density = np.zeros((count, 4), f4), np.zeros(0 if second is None else count, f4)
    mesh = attribute_arrays(geometry)
    uv1 = np.zeros((0, 2), f4) if second is None else second.numpy()
    pack_planes(mesh.vertices, mesh.faces, mesh.uv, uv1, planes, density)
    table = geometry.tangent_table
    return Packed(
        corners=corners.numpy(),
        planes=planes,
        ids=torch.cat([geometry.faces, geometry.material.to(torch.int32)[:, None]], dim=1).numpy().view(np.uint32),
        further=further.numpy(),
        density=density,
        tangent_row=np.zeros(0, np.int32) if table is None else table.row.numpy(),
        tangents=np.zeros((0, 3, 4), f4) if table is None else table.corners.numpy(),
    )


def _image(scene: Scene, seen: VisibilityBuffer, k: int) -> tuple[View, Samples]:
    """Camera ``k`` and what it sees."""
    cameras = seen.cameras
    eye = eye_of(cameras, k)
    origin = origin_of(scene, seen, k).numpy()
    numbers = np.concatenate(
        [eye.rays.reshape(-1), eye.origin - origin, eye.forward, [eye.footprint, float(eye.orthographic), 0, 0, 0]]
    ).astype(f4)
    images = (array(seen.depth[k], f4), array(seen.triangle[k], np.int64), array(seen.barycentric[k], f4))
    return View(numbers, origin), Samples(*images, np.zeros((0, 3)), np.zeros((0, 3), f4), np.zeros(0))


def _hits(scene: Scene, hits: RaySurface) -> tuple[View, Samples]:
    """Hits of rays as an image of one row."""
    assert hits.triangle is not None and hits.barycentric is not None and hits.width is not None
    triangle = array(hits.triangle, np.int64).reshape(1, -1)
    position = array(hits.position, np.float64).reshape(-1, 3)
    weights, to_eye = array(hits.barycentric, f4).reshape(1, -1, 2), array(hits.to_eye, f4).reshape(-1, 3)
    samples = Samples(
        np.zeros((1, 0), f4), triangle, weights, position, to_eye, array(hits.width, np.float64).reshape(-1)
    )
    return View(np.zeros(20, f4), origin_of(scene, hits).numpy()), samples


def _sky(scene: Scene, background: Tensor | None) -> Sky:
    """Light from all around; with an environment its octahedral maps."""
    environment, table = scene.environment, albedo_table()
    ambient = scene.ambient.detach().float()
    if environment is None:
        maps = SkyMaps(torch.zeros(0, 0, 3), torch.zeros(0, 3), torch.zeros(0, 2, dtype=torch.int64))
    else:
        maps = SkyMaps.of(environment, scene.material_table.has_physical)
    if environment is None or background is not None:
        shown = (ambient if background is None else background).reshape(1, 1, 3).clamp_min(0.0)
        turn, strength = 0.0, 1.0
    else:
        shown = environment.radiance if environment.shown is None else environment.shown
        turn, strength = environment.rotation_deg, environment.intensity
    return Sky(
        ambient=array(ambient, f4),
        irradiance=array(maps.irradiance.reshape(-1, 3), f4),
        mirrored=array(maps.mirrored, f4),
        levels=array(maps.levels, np.int64),
        albedo=array(table.split, f4),
        mean=array(table.mean, f4),
        sheen=array(table.sheen, f4),
        lobes=array(sky_lobes(), f4),
        cosines=array(filled_up(), f4),
        radiance=array(shown, f4),
        turn=np.array([math.radians(turn), strength], f4),
    )


def _no_sky() -> Sky:
    """Nothing around, for surfaces that are read only."""
    empty = np.zeros((0, 3), f4)
    maps = (empty, empty, np.zeros((0, 2), np.int64))
    four, one, eight = (np.zeros((0, 0, size), f4) for size in (4, 1, 8))
    tables = (four, np.zeros((0, 4), f4), one, four, eight)
    return Sky(np.zeros(3, f4), *maps, *tables, np.zeros((1, 1, 3), f4), np.zeros(2, f4))


@cache
def _even_sky(irradiance: float) -> Sky:
    """Diffuse light of an irradiance over pi that is the same everywhere; mirrors show nothing."""
    table, side = albedo_table(), IRRADIANCE_SIDE + 2
    levels = np.array([[0, 1], [9, 1]])
    return Sky(
        ambient=np.zeros(3, f4),
        irradiance=padded(torch.full((side * side, 3), irradiance)).numpy(),
        mirrored=padded(torch.zeros(18, 3)).numpy(),
        levels=levels,
        albedo=array(table.split, f4),
        mean=array(table.mean, f4),
        sheen=array(table.sheen, f4),
        lobes=array(sky_lobes(), f4),
        cosines=array(filled_up(), f4),
        radiance=np.zeros((1, 1, 3), f4),
        turn=np.zeros(2, f4),
    )


def is_of(samples: GBuffer | RaySurface, scene: Scene) -> bool:
    """Every attribute of the samples is that of the scene's own triangles."""
    return getattr(samples, "source", None) is scene.geometry
