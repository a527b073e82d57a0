"""The stand-in for people who correct a result by hand: scenes whose materials are known, and whose photo is a view.

An object needs correction where its mean colour over all views is more than 10 off in CIEDE2000.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from skimage.color import deltaE_ciede2000
from torch import Tensor

from torchrender.photo.lab import lab_from_linear
from torchrender.photo.style import finish
from torchrender.photo.style.objects import cut_scene
from torchrender.photo.style.options import StyleOptions, StyleWarning
from torchrender.photo.style.search import random_choice
from torchrender.photo.style.session import Style
from torchrender.photo.style.terms import default_light, pictures, radiance, view_terms
from torchrender.photo.style.transfer import style_scene
from torchrender.photo.style.views import Views, look, make_views
from torchrender.scene.camera import Cameras
from torchrender.scene.files.scene_geometry import rotation_xyz
from torchrender.scene.material import Material, Sampler
from torchrender.scene.model import Scene

LIMIT = 10.0
RANDOM = 20
TURN_DEG = 15.0


@dataclass(frozen=True, eq=False)
class KnownPhoto:
    """A photo of a scene with known materials."""

    photo: Tensor  # (H,W,3)
    rows: Tensor  # (m,8) true materials
    shown: Tensor  # (m,) bool objects that the photo shows
    cameras: Cameras  # the views of the run


def known_photo(scene: Scene, options: StyleOptions, registered: bool) -> KnownPhoto:
    """The scene in its own colours, seen from the generated view that shows most objects.

    Registered: that view is one of the run's. Otherwise it is left out, and the photo is taken from a fifth of the way
    to its target, turned by 15 degrees: a place from which the run has no view.
    """
    objects = cut_scene(scene, options.cut)
    cameras = make_views(scene, objects, options)
    views = look(scene, objects, cameras, options.visible_share)
    best = int(views.visible[:, : options.views].sum(dim=0).argmax())
    camera = cameras[best]
    if not registered:
        way = camera.forward[0] * float((camera.eye[0] - scene.bounds.mean(dim=0)).norm())
        eye = camera.eye[0] + 0.2 * way
        target = eye + rotation_xyz(torch.tensor([0.0, TURN_DEG, 0.0])) @ way
        fov = math.degrees(2 * math.atan2(camera.height / 2, float(camera.intrinsics[0, 1, 1])))
        camera = Cameras.look_at(
            eye, target, width=camera.width, height=camera.height, fov_deg=fov, near=float(camera.near[0])
        )
        cameras = cameras[[k for k in range(len(cameras)) if k != best]]
    seen = look(scene, objects, camera, options.visible_share)
    rows = finish.own_rows(scene, objects, finish.own_colors(scene, objects, views), 8)
    return KnownPhoto(_rendered(scene, seen, rows), rows, seen.visible[:, 0], cameras)


def _rendered(scene: Scene, views: Views, rows: Tensor) -> Tensor:
    glow = torch.stack([m.emission for m in scene.materials]).clamp(0.0, 1.0)
    rest = torch.where(views.gbuffer.covered[..., None], glow[views.gbuffer.material.clamp_min(0)], torch.tensor(0.8))
    return pictures(views, view_terms(scene, views, default_light(scene)), rows, rest)[0]


def stripped(scene: Scene) -> Scene:
    """The scene without its colours; lamps stay."""
    grey = tuple(
        m
        if float(m.emission.max()) > 0
        else replace(m, diffuse=torch.full((3,), 0.5), diffuse_texture=None, samplers=_others(m), specular=0.0)
        for m in scene.materials
    )
    return replace(scene, materials=grey, meshes=tuple(replace(m, colors=None) for m in scene.meshes))


def _others(material: Material) -> dict[str, Sampler]:
    """How the textures lie that stay."""
    return {name: sampler for name, sampler in material.samplers.items() if name != "diffuse_texture"}


def mean_colors(style: Style, rows: Tensor) -> np.ndarray:
    """(m,3) Lab of the mean colour of each object over its pixels in all views; NaN where it has none."""
    count = len(style.names)
    total, pixels = torch.zeros(count, 3, dtype=torch.float64), torch.zeros(count, dtype=torch.float64)
    for view in style.problem.terms:
        total.index_add_(0, view.object, radiance(view, rows))
        pixels += torch.bincount(view.object, minlength=count)
    lab = lab_from_linear(total / pixels.clamp_min(1.0)[:, None])
    return torch.where(pixels[:, None] > 0, lab, torch.nan).numpy()


def known_row(name: str, scene: Scene, options: StyleOptions, registered: bool) -> dict[str, Any]:
    """Shares of objects that need correction: of all, of those that the photo shows; and at random choices."""
    known = known_photo(scene, options, registered)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StyleWarning)
        style = style_scene(stripped(scene), known.photo, options, cameras=known.cameras)
    truth = mean_colors(style, known.rows)
    seen = ~np.isnan(truth[:, 0])

    def errors(choice: np.ndarray) -> np.ndarray:
        rows = style.candidates.materials[torch.arange(len(choice)), torch.from_numpy(choice)]
        return deltaE_ciede2000(truth, mean_colors(style, rows))

    own = errors(style.result.choice)
    shown = known.shown.numpy() & seen
    chance = [errors(random_choice(style.usable.numpy(), style.start, seed)) for seed in range(RANDOM)]
    best = np.full(len(own), np.inf)
    for column in range(style.usable.shape[1]):
        usable = style.usable[:, column].numpy()
        best = np.where(usable, np.minimum(best, errors(np.full(len(own), column))), best)
    return {
        "scene": name,
        "registered": registered,
        "objects": int(seen.sum()),
        "shown": int(shown.sum()),
        "wrong": float((own[seen] > LIMIT).mean()),
        "wrong_shown": float((own[shown] > LIMIT).mean()),
        "wrong_start": float((errors(style.start)[seen] > LIMIT).mean()),
        "wrong_random": float(np.mean([(e[seen] > LIMIT).mean() for e in chance])),
        "wrong_possible": float((np.where(np.isinf(best), own, best)[seen] > LIMIT).mean()),
        "median": float(np.median(own[seen])),
    }
