"""What Phong's model needs of every pixel, so that any materials can be put on the views at once.

``I = k_a + k_d d + k_s s^alpha`` with ``d = max(n.l, 0)``, ``s = max(r.v, 0)`` and ``r = 2 (n.l) n - l`` for one white
point light without falloff, shadows or inter-reflection: specification 11, section 4. A row of a material is
``[k_a (3), k_d (3), k_s (1 or 3), alpha]``.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from torchrender.photo.style.views import Views
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene
from torchrender.shade import diffuse_color

DARK_MIRROR = 1e-4
"""Below it a highlight is none: s^alpha ln s tends to 0."""
LIGHT_BELOW_TOP = 0.05
LIGHT_OUTSIDE = (0.6, 1.5, 0.8)  # from the middle, in diagonals


@dataclass(frozen=True, eq=False)
class ViewTerms:
    """The N pixels of one view that show an object."""

    object: Tensor  # (N,) int64
    row: Tensor  # (N,) int64 place in the flat picture
    diffuse: Tensor  # (N,) float64 d
    mirror: Tensor  # (N,) float64 s, 0 below DARK_MIRROR
    log_mirror: Tensor  # (N,) float64 ln s, -inf where s is 0
    gain: Tensor | None  # (N,3) float64 pattern of the object's texture, mean one; None: no texture is kept

    def of(self, chosen: Tensor) -> ViewTerms:
        """The pixels of the objects that are chosen, (m,) bool."""
        if bool(chosen.all()):
            return self
        rows = chosen[self.object].nonzero().reshape(-1)
        return ViewTerms(
            object=self.object[rows],
            row=self.row[rows],
            diffuse=self.diffuse[rows],
            mirror=self.mirror[rows],
            log_mirror=self.log_mirror[rows],
            gain=None if self.gain is None else self.gain[rows],
        )


def default_light(scene: Scene, cameras: Cameras | None = None) -> Tensor:
    """(3,) float64: 5 % of the height below the top centre of the scene's box.

    Of a scene that all cameras see from outside its box the light is outside, too, above and to a side: within the box
    it would stand inside the thing.
    """
    low, high = scene.bounds
    light = (low + high) / 2
    if cameras is not None and not bool(((cameras.eye >= low) & (cameras.eye <= high)).all(dim=1).any()):
        return light + scene.diagonal * torch.tensor(LIGHT_OUTSIDE, dtype=torch.float64)
    light[1] = high[1] - LIGHT_BELOW_TOP * (high[1] - low[1])
    return light


def view_terms(scene: Scene, views: Views, light: Tensor, keep_textures: bool = False) -> tuple[ViewTerms, ...]:
    """The terms of every view under a point light at ``light`` (3,) float64."""
    pattern = _patterns(scene, views) if keep_textures else None
    return tuple(_terms(views, number, light, pattern) for number in range(len(views)))


def _terms(views: Views, number: int, light: Tensor, pattern: Tensor | None) -> ViewTerms:
    seen = views.object[number].reshape(-1)
    rows = (seen >= 0).nonzero().reshape(-1)
    gbuffer = views.gbuffer
    position = gbuffer.position[number].reshape(-1, 3)[rows]
    normal = gbuffer.normal[number].reshape(-1, 3)[rows].double()
    to_light = torch.nn.functional.normalize(light - position, dim=1, eps=1e-30)
    if gbuffer.cameras.orthographic:
        to_eye = -gbuffer.cameras.forward[number].expand_as(position)
    else:
        to_eye = torch.nn.functional.normalize(gbuffer.cameras.eye[number] - position, dim=1, eps=1e-30)
    cosine = (normal * to_light).sum(dim=1)
    mirrored = 2.0 * cosine[:, None] * normal - to_light
    mirror = (mirrored * to_eye).sum(dim=1).clamp(0.0, 1.0)
    # A light behind the surface mirrors nothing, whatever r.v says.
    mirror = torch.where((mirror >= DARK_MIRROR) & (cosine > 0), mirror, 0.0)
    return ViewTerms(
        object=seen[rows],
        row=rows,
        diffuse=cosine.clamp_min(0.0),
        mirror=mirror,
        log_mirror=mirror.log(),
        gain=None if pattern is None else pattern[number].reshape(-1, 3)[rows],
    )


def _patterns(scene: Scene, views: Views) -> Tensor:
    """(n,H,W,3) float64 diffuse colour over its mean per object; 1 where an object has no colour of its own."""
    color = diffuse_color(scene, views.gbuffer).double()
    count = len(views.pixels)
    seen = views.object.reshape(-1)
    flat = color.reshape(-1, 3)
    total = torch.zeros(count + 1, 3, dtype=torch.float64).index_add_(0, seen + 1, flat)
    mean = total / torch.bincount(seen + 1, minlength=count + 1).clamp_min(1)[:, None]
    ratio = flat / mean[seen + 1].clamp_min(1e-12)
    return torch.where(mean[seen + 1] > 1e-6, ratio, 1.0).reshape(color.shape)


def radiance(terms: ViewTerms, materials: Tensor) -> Tensor:
    """(N,3) float64 linear light of a view's pixels, clamped to [0,1], for materials (m,8|10) float64."""
    own = materials[terms.object]
    ambient, diffuse, specular, exponent = own[:, :3], own[:, 3:6], own[:, 6:-1], own[:, -1]
    color = torch.addcmul(ambient, diffuse, terms.diffuse[:, None])
    if terms.gain is not None:
        color = color * terms.gain
    shiny = ((specular > 0).any(dim=1) & (terms.mirror > 0)).nonzero().reshape(-1)
    if len(shiny):
        lobe = (exponent[shiny] * terms.log_mirror[shiny]).exp()
        color[shiny] += specular[shiny] * lobe[:, None]
    return color.clamp_(0.0, 1.0)


def pictures(views: Views, terms: tuple[ViewTerms, ...], materials: Tensor, rest: Tensor) -> Tensor:
    """(n,H,W,3) float32 linear renderings with materials (m,8|10); ``rest`` (n,H,W,3) shows what is no object."""
    out = rest.clone().reshape(len(terms), -1, 3)
    for number, view in enumerate(terms):
        out[number, view.row] = radiance(view, materials).float()
    return out.reshape(*views.object.shape, 3)


def mean_terms(terms: tuple[ViewTerms, ...], count: int) -> Tensor:
    """(m,) float64 mean of d over all pixels of each object in all views; the mean of all where it has none."""
    total, pixels = torch.zeros(count, dtype=torch.float64), torch.zeros(count, dtype=torch.float64)
    for view in terms:
        total.index_add_(0, view.object, view.diffuse)
        pixels += torch.bincount(view.object, minlength=count)
    overall = float(total.sum() / pixels.sum().clamp_min(1.0))
    return torch.where(pixels > 0, total / pixels.clamp_min(1.0), overall)
