"""The pass ``transparency``: surfaces that show what lies behind, layer by layer."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from torchrender.buffers import GBuffer, RayHits
from torchrender.effects.reflections.reflectors import RayShader, ReflectedRays
from torchrender.effects.transparency.before import panes_before
from torchrender.effects.transparency.layers import DARK, LayerShader, Transparency, deepest_layers, transparency
from torchrender.errors import ViewWarning
from torchrender.passes.contract import Amounts, Pass
from torchrender.passes.hard import VIEW, HardEffect, Law, Outputs, Subject, displayed, mean_over
from torchrender.passes.mirrors.hit_shader import HIT_SHADER
from torchrender.passes.outlook import Outlook, Verdict, counted
from torchrender.passes.picture.scattering import SCATTERING, veil_of
from torchrender.passes.seen.gbuffer import GBUFFER
from torchrender.passes.settings import settings
from torchrender.pipeline.buffer import Buffer, Layer, Order
from torchrender.pipeline.doubts import say
from torchrender.pipeline.frame import Frame
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.raster import rasterize_visibility
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene


def _before(scene: Scene, gbuffer: GBuffer, radiance: Tensor, value: Transparency) -> Tensor:
    """Panes lie before everything solid."""
    del scene, gbuffer
    return radiance * value.passing + value.radiance


TRANSPARENCY = Buffer("transparency", Transparency, layer=Layer(Order.TRANSPARENCY, _before))


def _depth(scene: Scene, cameras: Cameras) -> int:
    return deepest_layers(scene, cameras)


def layers_of(outlook: Outlook) -> int:
    """Surfaces before each other that the picture needs."""
    return min(outlook.fact(_depth), outlook.options.transparent_layers)


def applies(outlook: Outlook) -> Verdict:
    """Something shows what lies behind, and the eye looks through it."""
    if outlook.options.transparency == "off":
        return Verdict(False, "transparency is turned off")
    if outlook.scene.geometry.see_through is None:
        return Verdict(False, "nothing shows what lies behind")
    if outlook.samples is not None:
        return Verdict(False, "what rays hit is shown without what lies before it")
    needed = layers_of(outlook)
    if not needed:
        return Verdict(False, "nothing that shows what lies behind is in view")
    return Verdict(True, f"up to {counted(needed, 'layer')} before each other")


def run(frame: Frame) -> Transparency:
    """Layers by peeling or by rays, in the light of the picture, each seen through the media before it."""
    options, gbuffer, hazed = frame.options, frame[GBUFFER], frame.get(SCATTERING)
    found = transparency(
        frame.scene,
        gbuffer,
        layer_shader(frame[HIT_SHADER]),
        layers=options.transparent_layers,
        traced=options.transparency == "traced",
        veil=None if hazed is None else veil_of(frame, gbuffer.cameras, hazed),
    )
    _say_cut(frame, found)
    return found


def _say_cut(frame: Frame, found: Transparency) -> None:
    """Say where more layers lie behind the last one that counts, unless fewer count to save time."""
    most = frame.options.transparent_layers
    full = (found.layers >= most) & (found.passing.amax(-1) > DARK)
    if most < RenderOptions().transparent_layers or not bool(full.any()):
        return
    if deepest_layers(frame.scene, frame[GBUFFER].cameras, most=most + 1) > most:
        told = f"{frame.scene.name}: more than {most} see-through surfaces before each other; those behind are left out"
        say([(ViewWarning, f"{told}: raise transparent_layers")])


def layer_shader(shader: RayShader) -> LayerShader:
    """The shader of hits, for rays of the eye."""

    def shade(origins: Tensor, directions: Tensor, width: Tensor, hits: RayHits) -> Tensor:
        return shader(ReflectedRays(origins, directions, width, torch.zeros_like(width)), hits)

    return shade


def amounts(outlook: Outlook) -> Amounts:
    """Once; pixels of all layers, peeled; the same, traced."""
    work = outlook.pixels * layers_of(outlook) if outlook.scene.geometry.see_through is not None else 0.0
    traced = outlook.options.transparency == "traced"
    return (1.0, 0.0 if traced else work, work if traced else 0.0)


def _paned(subject: Subject) -> Scene:
    """The scene with every material half transparent."""
    half = tuple(replace(m, blend=True, alpha_cutoff=None, opacity=0.5) for m in subject.scene.materials)
    return replace(subject.scene, materials=half)


def _flat(origins: Tensor, directions: Tensor, width: Tensor, hits: RayHits) -> Tensor:
    del origins, directions, width
    return torch.ones(len(hits.t), 3)


def _blended(subject: Subject) -> Outputs:
    scene = _paned(subject)
    nothing = replace(
        subject.gbuffer,
        depth=torch.full_like(subject.gbuffer.depth, torch.inf),
        triangle=torch.full_like(subject.gbuffer.triangle, -1),
    )
    found = transparency(scene, nothing, _flat, layers=8)
    return {"radiance": found.radiance, "passing": found.passing}


def _nothing_lost(subject: Subject, outputs: Outputs) -> float:
    """Panes that send white before white are white."""
    del subject
    error = (displayed(outputs["radiance"] + outputs["passing"]) - 1.0).abs()
    return float(error.max()) if error.numel() else 0.0


HARD = HardEffect(
    name="transparency",
    modules=("effects.transparency.layers", "effects.transparency.passing"),
    run=_blended,
    bounds=lambda _: {"radiance": (0.0, 1.0 + 1e-5), "passing": (0.0, 1.0)},
    law=Law(
        text="white panes before white are white, however many: largest difference",
        deviation=_nothing_lost,
        limit=1e-5,
    ),
    skip=lambda subject: None if subject.scene.geometry.triangle_count else "no triangles",
)


def _told_apart(subject: Subject) -> Outputs:
    nothing = rasterize_visibility(Scene(meshes=()).geometry, subject.cameras)
    return {"paned": (panes_before(_paned(subject), nothing) != 0).float()}


def _where_panes_are(subject: Subject, outputs: Outputs) -> float:
    covered = rasterize_visibility(_paned(subject).geometry.panes, subject.cameras).covered
    return mean_over((outputs["paned"] - covered.float()).abs(), torch.ones_like(covered))


BEFORE = HardEffect(
    name="panes_before",
    modules=("effects.transparency.before",),
    parallel=False,
    about=VIEW,
    run=_told_apart,
    bounds=lambda _: {"paned": (0.0, 1.0)},
    law=Law(
        text="panes lie before nothing where they are seen: share of pixels", deviation=_where_panes_are, limit=0.0
    ),
    skip=lambda subject: None if subject.scene.geometry.triangle_count else "no triangles",
)


def off(options: RenderOptions, history: RenderHistory) -> RenderOptions:
    """Over what rays hit: not at all."""
    del history
    return replace(options, transparency="off")


PASS = Pass(
    name="transparency",
    summary="blends surfaces that show what lies behind, layer by layer",
    makes=TRANSPARENCY,
    needs=(GBUFFER, HIT_SHADER),
    uses=(SCATTERING,),
    applies=applies,
    run=run,
    settings=settings(
        "layers",
        {
            **{str(n): {"transparency": "peeled", "transparent_layers": n} for n in (1, 2, 4, 8)},
            "64": {"transparency": "peeled", "transparent_layers": 64},
        },
        ("rays", {"transparency": "traced", "transparent_layers": 256}),
    ),
    amounts=amounts,
    over_hits=off,
    hard=(HARD, BEFORE),
)
