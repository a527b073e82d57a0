"""Materials for a scene from a photo that a client sends."""

from __future__ import annotations

from typing import Any

import torch

from torchrender.numerics.color import srgb_from_linear
from torchrender.photo.style.finish import albedo
from torchrender.photo.style.options import SearchOptions, StyleOptions
from torchrender.photo.style.session import Style
from torchrender.photo.style.sheet import contact_sheet
from torchrender.photo.style.transfer import style_scene
from torchrender.scene.files.gltf.out.write import glb_bytes
from torchrender.scene.model import Scene
from torchrender_service.logs import collecting
from torchrender_service.renderers.jobs import StylePhoto
from torchrender_service.renderers.photos.pictures import png_bytes, read_photo


def style_photo(scene: Scene, job: StylePhoto) -> dict[str, Any]:
    """The scene as GLB, the contact sheet as PNG, or what was chosen as plain values; with times and warnings.

    Raises:
        ServiceError, TorchRenderError: the photo, an object's name or a region is not usable.
    """
    image = read_photo(job.photo, job.max_pixels)
    options = StyleOptions(
        views=job.views,
        cut=job.by,
        keep_textures=job.keep_textures,
        seed=job.seed,
        search=SearchOptions(prior_weight=job.prior),
    )
    with collecting() as said:
        style = style_scene(scene, image, options, keep=job.lock, pick=job.pick)
        made = {"glb": _glb, "png": _sheet, "json": _facts}[job.format](style)
    return {**made, "timings_ms": dict(style.timings_ms), "warnings": said}


def _glb(style: Style) -> dict[str, Any]:
    return {"file": glb_bytes(style.scene)}


def _sheet(style: Style) -> dict[str, Any]:
    return {"file": png_bytes(contact_sheet(style))}


def _facts(style: Style) -> dict[str, Any]:
    colors = srgb_from_linear(albedo(style.materials, style.problem.cosine)).clamp(0, 1)
    codes = (colors * 255).round().to(torch.int64).tolist()
    rows = style.materials.tolist()
    unseen = set(style.unseen)
    objects = [
        {
            "name": name,
            "color": "#{:02x}{:02x}{:02x}".format(*codes[i]),
            "ambient": rows[i][:3],
            "diffuse": rows[i][3:6],
            "specular": rows[i][6],
            "exponent": rows[i][7],
            "candidate": int(style.choice[i]),
            "seen": name not in unseen,
            "locked": i in style.locked,
        }
        for i, name in enumerate(style.names)
    ]
    cost = {"before": style.before.total, "after": style.after.total, "moves": style.result.iterations}
    return {"objects": objects, "cost": cost, "views": len(style.problem.views)}
