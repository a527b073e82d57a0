"""The pass ``shadow_map``: depth as lights see it, fitted to what is seen.

Maps last while triangles, lights and what they were fitted to stand still; maps of everything, for mirrors, also while
the camera moves.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from torchrender.buffers import GBuffer, ShadowMap
from torchrender.effects.shadows.light_reach import shines
from torchrender.effects.shadows.movers import covers, with_movers
from torchrender.effects.shadows.options import ShadowOptions
from torchrender.effects.shadows.shadow_map import draw_shadow_map, light_views, render_shadow_map
from torchrender.effects.shadows.small_lights import lights_without_maps
from torchrender.effects.shadows.view_cameras import view_cameras
from torchrender.passes.contract import Amounts, OwnMeasure, Pass
from torchrender.passes.hard import LIGHTS, SMALL_SHADOW, HardEffect, Law, Outputs, Subject, difference, no_lights
from torchrender.passes.light.light_reach import LIGHT_REACH, SMALL_LIGHTS, lights_in_view
from torchrender.passes.light.standing_maps import STANDING_MAPS, Draw, Maps, Moving, StandingMaps, drawing
from torchrender.passes.light.visibility import POINT_SHADOW, lights_by_rays, visibility_error
from torchrender.passes.light.visibility import lights_in_view as in_view
from torchrender.passes.outlook import Outlook, Verdict, counted, no_shadows
from torchrender.passes.seen.gbuffer import GBUFFER
from torchrender.passes.settings import settings
from torchrender.pipeline.buffer import Buffer, Lasting, lights_of, same
from torchrender.pipeline.frame import Frame
from torchrender.pipeline.options import RenderOptions, everywhere, lasting_shadows
from torchrender.scene.camera import Cameras
from torchrender.scene.light import DirectionalLight, Light, PointLight, RectLight
from torchrender.scene.model import Scene

MOST_TEXELS = 1 << 26
"""Of all maps of everything together: where lights are many, each gets fewer, down to 128 along a side."""


def _made_with(options: RenderOptions) -> tuple[Any, ...]:
    return (options.shadows, lasting_shadows(options))


SHADOW_MAP: Buffer[tuple[ShadowMap | None, ...]] = Buffer(
    "shadow_map", tuple, lasting=Lasting(lights_of, _made_with, shared=False)
)
"""What the picture looks up: one per light of the scene, in its order; None for lights whose map nobody needs."""


def _made_of_all_with(options: RenderOptions) -> tuple[Any, ...]:
    shadow = everywhere(options)
    return (options.shadows, shadow, options.media, options.scattering.sun_texels)


SCENE_SHADOW_MAP: Buffer[tuple[ShadowMap | None, ...]] = Buffer(
    "scene_shadow_map", tuple, lasting=Lasting(lights_of, _made_of_all_with)
)
"""The same of everything, for what the eye does not see: it lasts while the camera moves."""


def applies(outlook: Outlook) -> Verdict:
    """Some light casts shadows."""
    nothing = no_shadows(outlook)
    if nothing is not None:
        return nothing
    reaching = lights_in_view(outlook)
    count = len(outlook.scene.lights) if reaching is None else reaching
    if outlook.options.shadow.coverage == "scene":
        return Verdict(True, f"{counted(count, 'light')}, of the whole scene")
    if not count and not _shown_elsewhere(outlook) and outlook.scene.geometry.see_through is None:
        return Verdict(False, "no light reaches what is seen")
    return Verdict(True, f"{counted(count, 'light')}, fitted to what is seen")


def looked_up(light: Light, options: RenderOptions) -> bool:
    """The picture itself looks the light's map up."""
    return options.area_shadows != "sampled" if isinstance(light, RectLight) else options.point_shadows == "maps"


def run(frame: Frame) -> tuple[Maps, Maps, StandingMaps]:
    """The maps of the picture, those of everything, and what of them the next picture needs if something moves."""
    scene, options = frame.scene, frame.options
    seen = options.shadow.coverage == "view" and isinstance(frame[GBUFFER], GBuffer)
    picture, mirrors = bool(frame.askers(SHADOW_MAP)), bool(frame.askers(SCENE_SHADOW_MAP))
    wanted = lights_in_picture(frame) if picture else set()
    whole = _of_everything(scene, options) if mirrors else set()
    moving = Moving.of(frame)
    draw = drawing(frame, moving)
    everything = _drawn(frame, SCENE_SHADOW_MAP, whole if seen else whole | wanted, None, draw)
    own = _drawn(frame, SHADOW_MAP, wanted, frame[GBUFFER], draw) if seen else everything
    kept = moving.standing() if moving is not None else StandingMaps(scene.meshes, own, everything)
    return own, everything, kept


def _of_everything(scene: Scene, options: RenderOptions) -> set[int]:
    """Numbers of the lights whose maps of everything are looked up.

    Hits ask many small lights, and sampled ones with an area, by rays; what floats looks all lights up.
    """
    found = _at_most(scene, options)
    if options.area_shadows != "sampled" or (options.media and scene.media):
        return found
    return {n for n in found if not isinstance(scene.lights[n], RectLight)}


def _at_most(scene: Scene, options: RenderOptions) -> set[int]:
    """The same by this pass's own settings, which alone decide its price."""
    shining = {n for n, light in enumerate(scene.lights) if shines(light)}
    if options.media and scene.media:
        return shining
    return shining - lights_without_maps(scene.lights, lasting_shadows(options))


def lights_in_picture(frame: Frame) -> set[int]:
    """Numbers of the lights whose maps the picture looks up."""
    lights = {**in_view(frame, area=False), **in_view(frame, area=True)}
    return {n for n, light in lights.items() if looked_up(light, frame.options)} - lights_by_rays(frame)


def _drawn(
    frame: Frame, buffer: Buffer[Maps], wanted: set[int], seen: GBuffer | None, draw: Draw
) -> tuple[ShadowMap | None, ...]:
    """The maps of these lights: those of an earlier picture where they still fit, and new ones."""
    scene, earlier = frame.scene, frame.earlier(buffer)
    made = list(earlier or [None] * len(scene.lights))
    sight: tuple[Any, ...] = ()
    drawn = range(len(made)) if frame.options.shadow.coverage == "scene" else _of_everything(scene, frame.options)
    shared = _shared_out(lasting_shadows(frame.options), [scene.lights[n] for n in drawn]).size
    for number in sorted(wanted):
        light, kept = scene.lights[number], made[number]
        # With the border that penumbrae need, so that the same map serves both kinds of look-up.
        how = lasting_shadows(frame.options)
        how = replace(how, filter="pcss", soft=None) if isinstance(light, RectLight) else how
        if seen is None:
            how = replace(how, size=_finer(light, scene, frame.options, shared))
            made[number] = kept or draw("everything", number, (light_views(scene.geometry, light, how), None), how)
            continue
        sight = sight or _sight(scene, seen)
        if kept is not None and kept.fitted_to is not None and same(kept.fitted_to, sight):
            continue
        cameras, starts = view_cameras(scene, light, seen, how)
        if kept is None or kept.starts != starts or not covers(kept.cameras, cameras):
            made[number] = replace(draw("picture", number, (cameras, starts), how), fitted_to=sight)
    changed = earlier is None or any(a is not b for a, b in zip(made, earlier, strict=True))
    return tuple(made) if earlier is None or changed else earlier


def _sight(scene: Scene, seen: GBuffer) -> tuple[Any, ...]:
    """What the views of lights are fitted to, of one scene: where the eye stands, how far it sees, and materials."""
    eye = seen.cameras
    return (*_place(eye), eye.intrinsics, eye.width, eye.height, seen.depth, scene.materials)


def _place(eye: Cameras) -> tuple[Any, ...]:
    """Where an eye stands, how far it sees and how wide, at any number of pixels."""
    wide = eye.intrinsics[:, 0, 0] / eye.width
    return (eye.camera_from_world, eye.near, eye.far, eye.orthographic, (1e6 * wide).round())


def _shared_out(options: ShadowOptions, lights: Sequence[Light]) -> ShadowOptions:
    """Maps of a size that those of all lights fit in."""
    height, width = options.shape
    count = sum(views(light) for light in lights)
    share = math.sqrt(MOST_TEXELS / max(count * height * width, 1))
    if share >= 1.0:
        return options
    return replace(options, size=(min(height, max(128, int(height * share))), min(width, max(128, int(width * share)))))


def _finer(light: Light, scene: Scene, options: RenderOptions, size: int | tuple[int, int]) -> int | tuple[int, int]:
    """Texels of a side of a sun's map of everything: shafts in media show its texels more than shadows do."""
    texels = options.scattering.sun_texels
    small = max(size if isinstance(size, tuple) else (size, size)) < texels
    return texels if isinstance(light, DirectionalLight) and options.media and scene.media and small else size


def _shown_elsewhere(outlook: Outlook) -> bool:
    if outlook.options.media and outlook.scene.media:  # what floats shows shadows of what the eye does not see
        return True
    return outlook.options.reflections != "off" and outlook.fact(_has_reflector)


def _has_reflector(scene: Scene, _: Cameras) -> bool:
    return any(material.is_reflector for material in scene.materials)


def views(light: Light) -> int:
    """Pictures that a shadow map of the light takes."""
    if isinstance(light, DirectionalLight):
        return 1
    if isinstance(light, PointLight):
        return 6
    if isinstance(light, RectLight):
        return 5
    return 1 if light.outer_deg <= 65.0 else 5


def amounts(outlook: Outlook) -> Amounts:
    """Views; their texels; their triangles. Maps that are there already cost nothing, unless they follow the eye."""
    lights, options = outlook.scene.lights, outlook.options.shadow
    reaching = lights_in_view(outlook)
    count = 0.0
    if options.coverage == "view" and not _fitted_already(outlook):
        mapped = len(lights) if reaching is None else reaching
        if options.edges == "exact" and outlook.options.point_shadows == "maps":
            mapped -= int(outlook.known.get(SMALL_LIGHTS, 0))
        share = mapped / max(len(lights), 1)
        count += share * sum(_fitted(light, options.cascades) for light in lights)
    if (options.coverage == "scene" or _shown_elsewhere(outlook)) and outlook.kept(SCENE_SHADOW_MAP) is None:
        whole = range(len(lights)) if options.coverage == "scene" else _at_most(outlook.scene, outlook.options)
        count += sum(views(lights[number]) for number in whole)
    height, width = options.shape
    return (count, count * height * width * 1e-6, count * outlook.triangles)


def did(frame: Frame, amounts: Amounts) -> Amounts:
    """Of that, the share that was drawn: a map fitted to what is seen may still fit where the eye went."""
    lights, drawn, wanted = frame.scene.lights, 0, 0
    for buffer in (SHADOW_MAP, SCENE_SHADOW_MAP):
        earlier, made = frame.earlier(buffer), frame[buffer]
        if buffer is SCENE_SHADOW_MAP and (earlier is not None or made is frame[SHADOW_MAP]):
            break  # counted by none of them, or already
        for light, before, now in zip(lights, earlier or [None] * len(lights), made, strict=True):
            count = 0 if now is None else views(light)
            wanted, drawn = wanted + count, drawn + count * (now is not before)
    return tuple(amount * drawn / max(wanted, 1) for amount in amounts)


def _fitted_already(outlook: Outlook) -> bool:
    """The picture's maps were drawn for an eye that still stands there."""
    maps = [one for one in outlook.kept(SHADOW_MAP) or () if one is not None and one.fitted_to is not None]
    if not maps:
        return False
    place = _place(outlook.cameras)
    return all(same((one.fitted_to or ())[: len(place)], place) for one in maps)


def _fitted(light: Light, cascades: int | None) -> int:
    """Views of a light fitted to what is seen, about: some faces of a cube are empty."""
    return views(light) if views(light) > 1 else (cascades or 2)


def _depths(subject: Subject) -> Outputs:
    scene = subject.scene
    maps = (render_shadow_map(scene, light, SMALL_SHADOW).depth for light in scene.lights)
    return {f"light {k}": depth / subject.unit for k, depth in enumerate(maps)}


def _depth_bounds(subject: Subject) -> dict[str, tuple[float, float]]:
    """Of parallel light the view's origin may lie anywhere along it."""
    lights = enumerate(subject.scene.lights)
    return {f"light {k}": (-math.inf if isinstance(one, DirectionalLight) else 0.0, math.inf) for k, one in lights}


def _texels_by_rays(subject: Subject, _: Outputs) -> float:
    found, wanted = {}, {}
    for number, light in enumerate(subject.scene.lights):
        made = render_shadow_map(subject.scene, light, SMALL_SHADOW)
        origins, directions = (v[:, ::7, ::5].reshape(-1, 3) for v in made.cameras.rays())
        rays_each = len(origins) // max(len(made.cameras), 1)
        near, far = (v.repeat_interleave(rays_each) for v in (made.cameras.near, made.cameras.far))
        t = subject.caster.first_hit(origins, directions, t_min=near, t_max=far).t
        found[f"{number}"], wanted[f"{number}"] = made.depth[:, ::7, ::5].double().reshape(-1), t
    return difference(found, wanted, 1e-4)


HARD = HardEffect(
    name="shadow_map",
    about=LIGHTS,
    modules=("effects.shadows.shadow_map",),
    run=_depths,
    bounds=_depth_bounds,
    law=Law(
        text="rays through the texel centres hit at the stored depth: share of texels where not",
        deviation=_texels_by_rays,
        limit=0.01,
    ),
    skip=no_lights,
    turns=False,
)


def _depths_with_movers(subject: Subject) -> Outputs:
    """Every other mesh moves."""
    scene = subject.scene
    still, movers = (replace(scene, meshes=scene.meshes[first::2]).geometry for first in (0, 1))
    found = {}
    for number, light in enumerate(scene.lights):
        views_of = light_views(scene.geometry, light, SMALL_SHADOW)
        made = with_movers(draw_shadow_map(still, views_of, None, SMALL_SHADOW), movers, SMALL_SHADOW.cull)
        found[f"light {number}"] = made.depth / subject.unit
    return found


MOVED = replace(
    HARD,
    name="moved_shadow_map",
    modules=("effects.shadows.movers",),
    run=_depths_with_movers,
    law=Law(
        text="maps into which what moves is drawn are those of everything: share of texels where not",
        deviation=lambda subject, found: difference(found, _depths(subject), 1e-5),
        limit=0.001,
    ),
)

PASS = Pass(
    name="shadow_map",
    summary="depth as lights see it",
    makes=SHADOW_MAP,
    also=(SCENE_SHADOW_MAP, STANDING_MAPS),
    needs=(GBUFFER,),
    uses=(LIGHT_REACH,),
    applies=applies,
    run=run,
    settings=settings(
        "texels of a map's side",
        {str(size): {"shadow.size": size} for size in (256, 512, 1024, 2048)},
        ("4096", {"shadow.size": 4096}),
    ),
    amounts=amounts,
    did=did,
    one_cost=True,
    own=OwnMeasure(title="visibility error", buffer=POINT_SHADOW, error=visibility_error(POINT_SHADOW)),
    hard=(HARD, MOVED),
)
