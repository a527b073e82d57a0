"""Phong rows as materials of a scene.

A row ``[k_a, k_d, k_s, alpha]`` becomes a metallic-roughness material, so that files and other programs show the same:

- base colour: the reflectance that looks as bright as the row does on average, under ambient light of a fifth and a
  point light: ``(k_a + k_d d) / (0.2 + d)`` with the object's mean d; brought below one without a change of hue;
- roughness: the lobe of bare plastic (4 % at normal incidence) is as high as the highlight where its exponent is
  ``n = 50 k_s - 2``; the exponent is n, or alpha where that is less;
- metalness: 0, or where plastic with alpha's own lobe would stay below k_s what it takes to be as high, up to 8 % at
  normal incidence: beyond that a surface counts as a mirror, of which a fitted highlight says nothing;
- no highlight: roughness 1.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from torchrender.numerics.texture import channels_of
from torchrender.photo.lab import lab_from_linear, linear_from_lab
from torchrender.photo.style.objects import StyleObjects
from torchrender.photo.style.phong import AMBIENT_SHARE, MAX_EXPONENT
from torchrender.photo.style.views import Views
from torchrender.scene.files.gltf.out.materials import metalness
from torchrender.scene.light import PointLight
from torchrender.scene.material import DIELECTRIC_F0, Material, Sampler, from_metallic_roughness
from torchrender.scene.model import Scene
from torchrender.shade import diffuse_color

MAX_SPECULAR = 2 * DIELECTRIC_F0
_LIGHTNESS_SPAN, _WARM = 30.0, (5.0, 20.0)


def albedo(rows: Tensor, cosine: Tensor) -> Tensor:
    """(m,3) diffuse reflectance in [0,1] that looks as rows (m,8|10) do at mean d ``cosine`` (m,)."""
    light = cosine[:, None]
    color = (rows[:, :3] + rows[:, 3:6] * light) / (AMBIENT_SHARE + light)
    return color / color.amax(dim=1, keepdim=True).clamp_min(1.0)


def exponent_roughness(exponent: float) -> float:
    """The roughness that :func:`from_metallic_roughness` reads as this Phong exponent."""
    return math.sqrt(math.sqrt(2.0 / (4.0 * max(exponent, 0.0) + 2.0)))


def as_material(name: str, color: Tensor, specular: float, exponent: float) -> Material:
    """A metallic-roughness material from a reflectance (3,), a highlight's height k_s and its exponent."""
    if specular <= 0.0:
        return from_metallic_roughness(name=name, base_color=color, metallic=0.0, roughness=1.0)
    degree = min(2.0 * specular / (exponent + 2.0), MAX_SPECULAR)
    metal = metalness(float(color.max()), degree)
    lobe = exponent if degree > DIELECTRIC_F0 else 2.0 * specular / DIELECTRIC_F0 - 2.0
    base = color / (1.0 - metal) if metal < 1.0 else torch.full((3,), degree)
    if float(base.max()) > 1.0:  # a nearly white surface cannot be metal without getting darker
        metal, base = 0.0, color
    return from_metallic_roughness(
        name=name,
        base_color=base.float(),
        metallic=metal,
        roughness=exponent_roughness(min(max(lobe, 1.0), exponent)),
    )


def own_rows(scene: Scene, objects: StyleObjects, colors: Tensor, width: int) -> Tensor:
    """(m,8|10) float64 rows that look as the objects' present materials do; ``colors`` (m,3) from :func:`own_colors`.

    The highlight is that of the material with most triangles.
    """
    out = torch.zeros(len(objects), width, dtype=torch.float64)
    out[:, :3], out[:, 3:6] = AMBIENT_SHARE * colors, colors
    for index, numbers in enumerate(objects.meshes):
        largest = max(numbers, key=lambda k: len(scene.meshes[k].faces))
        material = scene.materials[scene.meshes[largest].material]
        exponent = min(max(material.shininess, 1.0), MAX_EXPONENT)
        height = min(material.specular * (exponent + 2.0) / 2.0, 1.0)
        out[index, 6:-1] = (height * material.specular_color[: width - 7].double()).clamp(0.0, 1.0)
        out[index, -1] = exponent
    return out


def own_colors(scene: Scene, objects: StyleObjects, views: Views) -> Tensor:
    """(m,3) float64 mean diffuse reflectance over all pixels of each object; of its materials where it has none."""
    seen = views.object.reshape(-1) + 1
    flat = diffuse_color(scene, views.gbuffer).double().reshape(-1, 3)
    total = torch.zeros(len(objects) + 1, 3, dtype=torch.float64).index_add_(0, seen, flat)[1:]
    pixels = torch.bincount(seen, minlength=len(objects) + 1)[1:]
    out = total / pixels.clamp_min(1)[:, None]
    for index in (pixels == 0).nonzero().reshape(-1).tolist():
        used = [scene.materials[scene.meshes[k].material] for k in objects.meshes[index]]
        out[index] = torch.stack([_mean_color(m) for m in used]).mean(dim=0)
    return out.clamp(0.0, 1.0)


def _mean_color(material: Material) -> Tensor:
    color = material.diffuse.double()
    if material.diffuse_texture is not None:
        color = color * channels_of(material.diffuse_texture, 0, 3).double().mean(dim=(0, 1))
    return color


def adjusted(rows: Tensor, cosine: Tensor, sliders: tuple[float, float, float]) -> Tensor:
    """Rows (m,8|10) made lighter, more saturated and warmer: three numbers in [-1,1], 0 for no change.

    Steps are taken in Lab on the reflectance: up to 30 in L, saturation times 0 to 2, and (5, 20) in a and b.
    """
    lightness, saturation, warmth = sliders
    if not any(sliders):
        return rows
    before = albedo(rows, cosine)
    lab = lab_from_linear(before)
    lab[:, 0] = (lab[:, 0] + _LIGHTNESS_SPAN * lightness).clamp(0.0, 100.0)
    lab[:, 1:] = lab[:, 1:] * (1.0 + saturation) + warmth * torch.tensor(_WARM, dtype=lab.dtype)
    after = linear_from_lab(lab).clamp(0.0, 1.0)
    out = rows.clone()
    ratio = after / before.clamp_min(1e-4)
    out[:, :3] = (rows[:, :3] * ratio).clamp(0.0, 1.0)
    out[:, 3:6] = (rows[:, 3:6] * ratio).clamp(0.0, 1.0)
    black = (before < 1e-3).any(dim=1)
    out[black, :3], out[black, 3:6] = AMBIENT_SHARE * after[black], after[black]
    return out


def styled_scene(scene: Scene, objects: StyleObjects, made: Sequence[Material | None], ratios: Tensor | None) -> Scene:
    """The scene with a material for each object; None keeps what an object has.

    ``ratios`` (m,3): textures and vertex colours stay, and the object's own colours are multiplied by this.
    """
    materials = list(scene.materials)
    meshes = list(scene.meshes)
    for index, material in enumerate(made):
        if material is None:
            continue
        rows: dict[int, int] = {}
        for number in objects.meshes[index]:
            before = scene.materials[meshes[number].material]
            own = ratios is not None or _has_shape(before) or bool((before.emission > 0).any())
            old = meshes[number].material if own else -1
            if old not in rows:
                rows[old] = len(materials)
                chosen = _holed(before, material) if ratios is None else _patterned(before, material, ratios[index])
                materials.append(replace(chosen, emission=before.emission) if own else chosen)
            colors = meshes[number].colors if ratios is not None else None
            meshes[number] = replace(meshes[number], material=rows[old], colors=colors)
    used = sorted({m.material for m in meshes})
    place = {row: k for k, row in enumerate(used)}
    return replace(
        scene,
        meshes=tuple(replace(m, material=place[m.material]) for m in meshes),
        materials=_named_apart([materials[row] for row in used]),
    )


def _has_shape(material: Material) -> bool:
    """Whether a texture cuts holes: leaves are leaves by their alpha."""
    texture = material.diffuse_texture
    return material.alpha_cutoff is not None and texture is not None and texture.shape[2] == 4


def _holed(old: Material, new: Material) -> Material:
    """The new material with the holes of the old one's texture, if it has any; its colours go."""
    if not _has_shape(old) or old.diffuse_texture is None:
        return new
    alpha = channels_of(old.diffuse_texture, 3, 4)
    texture = torch.cat([torch.ones(*alpha.shape[:2], 3), alpha], dim=-1)
    return replace(new, diffuse_texture=texture, samplers=_lies_as(old), alpha_cutoff=old.alpha_cutoff)


def _patterned(old: Material, new: Material, ratio: Tensor) -> Material:
    """The new material with the old one's texture; reflectances stay at most one, texel by texel."""
    color = old.diffuse * ratio.float()
    texture = old.diffuse_texture
    if texture is not None:
        above = color.clamp_min(1.0)
        if bool((above > 1.0).any()):
            shown, alpha = channels_of(texture, 0, 3), channels_of(texture, 3, texture.shape[2])
            texture = torch.cat([(shown * above).clamp(max=1.0), alpha], dim=-1)
    return replace(
        new, diffuse=color.clamp(0.0, 1.0), diffuse_texture=texture, samplers=_lies_as(old),
        alpha_cutoff=old.alpha_cutoff,
    )  # fmt: skip


def _lies_as(old: Material) -> dict[str, Sampler]:
    """How the colour texture of a material lies on the surface, where that is told."""
    return {name: sampler for name, sampler in old.samplers.items() if name == "diffuse_texture"}


def _named_apart(materials: list[Material]) -> tuple[Material, ...]:
    taken: set[str] = set()
    out = []
    for material in materials:
        number, name = 2, material.name
        while name in taken:
            name, number = f"{material.name} ({number})", number + 1
        taken.add(name)
        out.append(material if name == material.name else replace(material, name=name))
    return tuple(out)


def with_style_light(scene: Scene, views: Views, light: Tensor) -> Scene:
    """The scene; if nothing lights it, under the light of the fit: ambient 0.2, and the point light, which brings a
    facing surface at the median distance the irradiance pi.
    """
    if scene.with_default_light() is scene:
        return scene
    position = views.gbuffer.position[views.object >= 0]
    square = float((position - light).square().sum(dim=-1).median()) if len(position) else scene.diagonal**2
    intensity = torch.full((3,), math.pi * max(square, 1e-12))
    lamp = PointLight(position=light.float(), intensity=intensity, name="style light")
    return replace(scene, lights=(lamp,), ambient=torch.full((3,), AMBIENT_SHARE))
