"""Reflections from clustered depth images: neighbouring mirror pixels share a depth image, every ray stays its own.

Reflective pixels are grouped by reflector and normal; each group gets a camera that sees about what its reflected rays
see; the scene is drawn from there once, and every ray is marched through that depth image. The camera only decides
which surfaces are recorded. Nothing is precomputed: the scene may change with every picture.
Source: specification 03 (image-space reflections by clustered depth images), algorithms 6 and 7.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from torchrender.buffers import RayHits, ReflectionLayer, ReflectionState, VisibilityBuffer
from torchrender.checks import check_choice, check_range
from torchrender.clock import StepClock
from torchrender.effects.reflections.cluster_cameras import AIMS, CENTRES, ClusterCameras, build_cluster_cameras
from torchrender.effects.reflections.cluster_images import (
    ClusterAnswer,
    cluster_camera,
    cluster_image,
    march_image,
    mirror_view,
)
from torchrender.effects.reflections.pixel_clusters import cluster_pixels
from torchrender.effects.reflections.reflectors import (
    START,
    RayShader,
    ReflectedRays,
    ReflectivePixels,
    lobe_rays,
    mean_distance,
    reflected_rays,
    reflection_layer,
)
from torchrender.errors import OptionError
from torchrender.kernels.rays.depth_march import UNKNOWN
from torchrender.rays import RayCaster
from torchrender.scene.model import Scene

SCALE_RULES = ("sqrt_share", "literal", "mean")
NEAREST_FAR_PLANE = 0.05  # scene diagonals
FADE = 0.4  # share of the far plane's distance over which glossy reflections fade
FULL_FADE_GLOSS = 0.1  # less gloss fades less, to be continuous with mirrors, which do not
_RAYS = 1 << 19  # shaded together: bounds the memory of their hits


@dataclass(frozen=True, kw_only=True)
class ClusterOptions:
    """How pixels are grouped, and how their depth images are drawn and asked.

    Raises:
        OptionError: a value outside its range; names it.
    """

    bins: tuple[int, int] = (13, 8)  # of azimuth and polar angle, for a reflector that fills the view by itself
    scale_rule: str = "sqrt_share"  # how a reflector's share of the view scales its bins
    bin_factor: float = 1.0  # factor m on the number of bins: fewer clusters are faster and miss more
    plane_share: float = 5e-4  # planes with this share of a picture are clusters of their own; inf: bins alone
    camera_share: float = 2e-4  # curved clusters with a smaller share of a picture join another one; 0: bins alone
    centre: str = "best"  # of projection: "thesis", "least_squares", or for each cluster the better one
    aim: str = "rays"  # view axis of curved clusters: mean direction of the "rays", or "normal" of the fitting plane
    image_scale: float = 1.0  # sides of the depth images of curved clusters
    depth_tolerance: float = 1e-4  # share epsilon of the depth that a ray must be behind the image
    glossy_rays: int = 8  # per glossy pixel; mirrors take one
    fade: bool = False  # glossy reflections give way to the pixel's own colour with distance, as published
    min_cluster_pixels: int = 1  # smaller clusters take what ``missing`` says
    missing: str = "environment"  # rays that no depth image answers: "environment", or "trace"
    self_reflection: str = (
        "mirror"  # concave reflectors that see themselves: "mirror" as others, or own "diffuse" colour
    )
    cull: str = "back"  # faces left out of depth images of curved clusters: "none" lets convex reflectors hide things

    def __post_init__(self) -> None:
        for number, sides in enumerate(self.bins):
            check_range(f"bins[{number}]", sides, 1, 64)
        if len(self.bins) != 2:
            raise OptionError(f"bins must be two numbers, got {self.bins}")
        check_choice("scale_rule", self.scale_rule, SCALE_RULES)
        check_choice("centre", self.centre, CENTRES)
        check_choice("aim", self.aim, AIMS)
        check_choice("missing", self.missing, ("environment", "trace"))
        check_choice("cull", self.cull, ("none", "back"))
        check_choice("self_reflection", self.self_reflection, ("mirror", "diffuse"))
        check_range("plane_share", self.plane_share, 0.0)
        check_range("camera_share", self.camera_share, 0.0, 1.0)
        check_range("bin_factor", self.bin_factor, 0.01, 16.0)
        check_range("image_scale", self.image_scale, 0.1, 4.0)
        check_range("depth_tolerance", self.depth_tolerance, 0.0, 1e-2)
        check_range("glossy_rays", self.glossy_rays, 1, 1024)
        check_range("min_cluster_pixels", self.min_cluster_pixels, 1, 1 << 20)


@dataclass(frozen=True, eq=False)
class ClusteredReflections:
    """The layer, and how it came about."""

    layer: ReflectionLayer
    cameras: ClusterCameras
    unknown: Tensor  # (N,) share of each pixel's rays that no depth image answered
    steps: int  # texels visited by all rays
    elapsed_ms: Mapping[str, float]  # clusters, cameras, depth images, marching, shading


def clustered_reflections(
    scene: Scene,
    pixels: ReflectivePixels,
    shader: RayShader,
    options: ClusterOptions | None = None,
    *,
    direct: Tensor | None = None,
    caster: Callable[[], RayCaster] | None = None,
) -> ClusteredReflections:
    """What the pixels mirror, by a depth image for each cluster of them.

    Args:
        shader: gives hits their colour, and rays without an answer a guess.
        direct: (B,H,W,3) the picture without reflections: what glossy reflections fade to; None: black.
        caster: makes the ray caster for ``missing="trace"``; called only if a ray needs it.

    Raises:
        OptionError: ``missing="trace"`` without a caster.
    """
    options = options or ClusterOptions()
    if options.missing == "trace" and caster is None:
        raise OptionError('missing="trace" needs a caster')
    own = torch.zeros(len(pixels), 3) if direct is None else direct.reshape(-1, 3).index_select(0, pixels.pixel)
    clock = StepClock()
    with clock.measure("clusters"):
        clusters = cluster_pixels(
            pixels,
            scene.diagonal,
            bins=options.bins,
            rule=options.scale_rule,
            m=options.bin_factor,
            plane_share=options.plane_share,
            camera_share=options.camera_share,
        )
    with clock.measure("cameras"):
        made = build_cluster_cameras(
            pixels,
            clusters,
            scene.diagonal,
            centre=options.centre,
            scale=options.image_scale,
            shorten=options.fade,
            aim=options.aim,
        )
    shading = _Shading(scene, pixels, shader, options, caster, own, clock)
    steps = 0
    for number in range(len(made)):
        for question in _ask(scene, pixels, made, number, options, clock):
            steps += question.answer.steps
            shading.add(question)
    shading.flush()
    known = torch.isfinite(shading.distance)
    state = torch.where(known, int(ReflectionState.DEPTH_IMAGE), int(ReflectionState.ENVIRONMENT))
    state = torch.where(known & (shading.traced > 0), int(ReflectionState.TRACED), state)
    layer = reflection_layer(pixels, shading.color, shading.distance, state, made.clusters.cluster)
    return ClusteredReflections(layer, made, shading.unknown, steps, clock.elapsed_ms)


@dataclass(frozen=True, eq=False)
class _Question:
    """The rays of one cluster, ``per_pixel`` for each of its pixels, and what they met."""

    rows: Tensor  # (M,) pixels
    per_pixel: int
    rays: ReflectedRays
    answer: ClusterAnswer
    itself: Tensor  # (M per_pixel,) bool: takes the reflector's own colour


def _ask(
    scene: Scene,
    pixels: ReflectivePixels,
    made: ClusterCameras,
    number: int,
    options: ClusterOptions,
    clock: StepClock,
) -> Iterator[_Question]:
    """Send the rays of a cluster to its depth image, not more than memory holds at a time."""
    members = made.clusters.members(number)
    part = pixels.select(members)
    known = bool(made.usable[number]) and len(members) >= options.min_cluster_pixels
    if known and bool(made.planar[number]):
        with clock.measure("depth images"):
            answer = mirror_view(scene.geometry, pixels, made, number, scene.diagonal)
        yield _Question(members, 1, reflected_rays(part), answer, torch.zeros(len(members), dtype=torch.bool))
        return
    seen = None
    if known:
        with clock.measure("depth images"):
            seen = cluster_image(scene.geometry, cluster_camera(made, number), part.position, options.cull)
    concave = options.self_reflection == "diffuse" and _is_concave(part, made, number)
    count = options.glossy_rays if bool((part.gloss > 0).any()) else 1
    for some in torch.arange(len(members)).split(max(1, _RAYS // count)):
        piece = part.select(some)
        rays = reflected_rays(piece) if count == 1 else lobe_rays(piece, count)
        with clock.measure("marching"):
            answer = _march(scene, piece, rays, seen, options)
        itself = torch.zeros(len(some) * count, dtype=torch.bool)
        if concave:
            hit = answer.hits.triangle
            own = scene.geometry.object_id[hit.clamp_min(0)] == piece.object_id.repeat_interleave(count)
            itself = (hit >= 0) & own
        yield _Question(members[some], count, rays, answer, itself)


def _march(
    scene: Scene, piece: ReflectivePixels, rays: ReflectedRays, seen: VisibilityBuffer | None, options: ClusterOptions
) -> ClusterAnswer:
    """What rays meet in a depth image; nothing is known without one."""
    total = len(rays.origin)
    if seen is None:
        return ClusterAnswer(torch.full((total,), UNKNOWN, dtype=torch.uint8), RayHits.misses(total), 0)
    count = total // len(piece)
    reach = _far_plane(piece.gloss, scene.diagonal, options).repeat_interleave(count)
    climb = (rays.direction * piece.geometric_normal.repeat_interleave(count, 0)).sum(-1)
    ends = torch.where(climb > 0, reach / climb.clamp_min(1e-9), scene.diagonal).clamp_max(scene.diagonal)
    return march_image(scene.geometry, seen, rays, (START * scene.diagonal, ends), options.depth_tolerance)


def _far_plane(gloss: Tensor, diagonal: float, options: ClusterOptions) -> Tensor:
    """Height (N,) over the reflector up to which it is reflected: the rougher, the nearer."""
    return diagonal * (1.0 - gloss * options.fade).clamp_min(NEAREST_FAR_PLANE)


def _is_concave(part: ReflectivePixels, made: ClusterCameras, number: int) -> bool:
    """Normals of a hollow surface lean towards the middle of its pixels."""
    offset = part.position - made.frame[number, 0]
    return float((offset * part.normal).sum(-1).mean()) < 0.0


class _Shading:
    """Collects the answers of clusters and gives many rays their colour at once."""

    def __init__(
        self,
        scene: Scene,
        pixels: ReflectivePixels,
        shader: RayShader,
        options: ClusterOptions,
        caster: Callable[[], RayCaster] | None,
        own: Tensor,
        clock: StepClock,
    ) -> None:
        self._clock = clock
        self._scene, self._pixels, self._shader, self._options = scene, pixels, shader, options
        self._caster, self._own = caster, own
        self._waiting: list[_Question] = []
        self._count = 0
        self.color = torch.zeros(len(pixels), 3)
        self.distance = torch.full((len(pixels),), torch.inf)
        self.unknown, self.traced = torch.zeros(len(pixels)), torch.zeros(len(pixels))

    def add(self, question: _Question) -> None:
        """Take the answer of one cluster."""
        self._waiting.append(question)
        self._count += len(question.itself)
        if self._count >= _RAYS:
            self.flush()

    def flush(self) -> None:
        """Shade everything taken so far."""
        if self._count:
            with self._clock.measure("shading"):
                self._shade()

    def _shade(self) -> None:
        waiting, self._waiting, self._count = self._waiting, [], 0
        rays = ReflectedRays(
            *(
                torch.cat([getattr(q.rays, name) for q in waiting])
                for name in ("origin", "direction", "width", "spread")
            )
        )
        hits = RayHits(
            *(torch.cat([getattr(q.answer.hits, n) for q in waiting]) for n in ("t", "triangle", "barycentric"))
        )
        unknown = torch.cat([q.answer.state for q in waiting]) == UNKNOWN
        pixel = torch.cat([q.rows.repeat_interleave(q.per_pixel) for q in waiting])
        color, hits = self._radiance(rays, hits, unknown)
        itself = torch.cat([q.itself for q in waiting])
        color = torch.where(itself[:, None], self._own[pixel], color)
        if self._options.fade:
            color = self._faded(color, rays, hits, pixel)
        begin = 0
        for q in waiting:
            part = slice(begin, begin + len(q.itself))
            begin += len(q.itself)
            self.color[q.rows] = color[part].reshape(-1, q.per_pixel, 3).mean(dim=1)
            self.distance[q.rows] = mean_distance(hits.t[part].reshape(-1, q.per_pixel))
            self.unknown[q.rows] = unknown[part].reshape(-1, q.per_pixel).float().mean(dim=1)
        if self._caster is not None and self._options.missing == "trace":
            self.traced[pixel[unknown]] = 1.0

    def _radiance(self, rays: ReflectedRays, hits: RayHits, unknown: Tensor) -> tuple[Tensor, RayHits]:
        """Colour (N,3) of rays, and hits with those that were looked for by the ray caster."""
        rows = unknown.nonzero().reshape(-1)
        if not len(rows):
            return self._shader(rays, hits), hits
        if self._options.missing == "trace" and self._caster is not None:
            start = START * self._scene.diagonal
            found = self._caster().first_hit(rays.origin[rows], rays.direction[rows], t_min=start)
            hits = RayHits(
                hits.t.index_copy(0, rows, found.t),
                hits.triangle.index_copy(0, rows, found.triangle),
                hits.barycentric.index_copy(0, rows, found.barycentric),
            )
            return self._shader(rays, hits), hits
        color = self._shader(rays, hits)
        return color.index_copy(0, rows, self._shader.surroundings(rays.origin[rows], rays.direction[rows])), hits

    def _faded(self, color: Tensor, rays: ReflectedRays, hits: RayHits, pixel: Tensor) -> Tensor:
        """Glossy colours (N,3), fading to the pixel's own towards the far plane (specification 03, section 8)."""
        gloss = self._pixels.gloss[pixel]
        if not bool((gloss > 0).any()):
            return color
        far = _far_plane(gloss, self._scene.diagonal, self._options)
        height = hits.t * (rays.direction * self._pixels.geometric_normal[pixel]).sum(-1)
        weight = ((far - height) / (FADE * far)).clamp(0.0, 1.0)
        weight = 1.0 - (gloss / FULL_FADE_GLOSS).clamp_max(1.0) * (1.0 - torch.where(hits.hit, weight, 0.0))
        return torch.lerp(self._own[pixel], color, weight.float()[:, None])
