"""The pass ``enhancement``: shape made easier to read. Nothing but a wish calls for it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from torchrender.buffers import GBuffer
from torchrender.effects.enhancement.curvature import MeshCurvature
from torchrender.effects.enhancement.enhance import enhanced, enhancement
from torchrender.effects.enhancement.gradient import Gloss, Lighting, mesh_normal_gradient
from torchrender.effects.enhancement.options import EnhanceOptions
from torchrender.effects.enhancement.surface_image import SurfaceImage, curvature_of
from torchrender.passes.contract import Amounts, Buffers, Pass
from torchrender.passes.hard import HardEffect, Law, Outputs, Subject
from torchrender.passes.light.direct_light import lights_visibility
from torchrender.passes.light.pane_shadow import PANE_SHADOW
from torchrender.passes.light.visibility import POINT_SHADOW, SOFT_SHADOW
from torchrender.passes.outlook import Outlook, Verdict
from torchrender.passes.picture.mesh_curvature import MESH_CURVATURE
from torchrender.passes.seen.gbuffer import GBUFFER
from torchrender.pipeline.buffer import Buffer, Layer, Order
from torchrender.pipeline.frame import Frame
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.scene.model import Scene
from torchrender.shade import diffuse_color, shade


@dataclass(frozen=True, eq=False)
class Enhancement:
    """What is added to a picture."""

    size: Tensor  # (B,H,W,3) size of the gradient of its radiance
    options: EnhanceOptions


def blend(scene: Scene, gbuffer: GBuffer, radiance: Tensor, value: Enhancement) -> Tensor:
    """The enhanced picture (B,H,W,3); what no surface covers stays as it is."""
    del scene
    return enhanced(radiance, value.size, SurfaceImage.of(gbuffer), value.options)


ENHANCEMENT = Buffer("enhancement", Enhancement, layer=Layer(Order.ENHANCEMENT, blend))


def applies(outlook: Outlook) -> Verdict:
    """Somebody asked for it."""
    wish = outlook.options.enhance
    if wish is None:
        return Verdict(False, "no enhancement was asked for")
    if not wish.gradient_weight:
        return Verdict(True, "a weight of 0: the picture is only scaled")
    return Verdict(True, f"gradients by {wish.gradient_weight:g}, the plain picture by {wish.plain_weight:g}")


def asks(outlook: Outlook) -> Buffers:
    """Curvature of the mesh, unless that of the picture is wished for."""
    wish = outlook.options.enhance
    return () if wish is None or wish.source == "picture" else (MESH_CURVATURE,)


def run(frame: Frame) -> Enhancement:
    """Gradients of the direct light."""
    options = frame.options.enhance or EnhanceOptions()
    visibility = lights_visibility(frame)
    return Enhancement(of_scene(frame.scene, frame[GBUFFER], frame.get(MESH_CURVATURE), visibility, options), options)


def of_scene(
    scene: Scene,
    gbuffer: GBuffer,
    curvature: MeshCurvature | None,
    visibility: Tensor | None,
    options: EnhanceOptions,
) -> Tensor:
    """Size (B,H,W,3) of the gradient of a scene's direct light.

    ``curvature`` is that of the mesh; None: the picture's own. Vertices without normals say nothing: there it is the
    picture's own unless the options want the mesh's.
    """
    surface = SurfaceImage.of(gbuffer)
    bent = seen_curvature(surface, gbuffer, scene, curvature, options)
    lighting = Lighting(scene.lights, visibility, scene.environment)
    albedo = diffuse_color(scene, gbuffer)
    gloss = normals = None
    if "specular" in options.terms:
        table = scene.material_table
        gloss = Gloss(table.highlight[gbuffer.material], table.shininess[gbuffer.material], albedo)
    if options.curvature == "full":
        normals = mesh_normal_gradient(surface, scene.geometry, gbuffer.triangle, gbuffer.barycentric)
    return enhancement(surface, bent, lighting, options, gloss=gloss, normals=normals) * albedo


def seen_curvature(
    surface: SurfaceImage, gbuffer: GBuffer, scene: Scene, mesh: MeshCurvature | None, options: EnhanceOptions
) -> Tensor:
    """(B,H,W) ``k / beta``: of the mesh where its vertices have normals, else of the picture, as the options say."""
    if mesh is None:
        return surface.curvature(options.limit, centred=options.centred)
    found = curvature_of(gbuffer, scene.geometry, mesh)
    if options.source == "mesh":
        return found
    flat = gbuffer.covered & ~mesh.smooth_faces(scene.geometry)[gbuffer.triangle.clamp_min(0)]
    return (
        torch.where(flat, surface.curvature(options.limit, centred=options.centred), found)
        if bool(flat.any())
        else found
    )


def amounts(outlook: Outlook) -> Amounts:
    """Once; pixels; pixels times lights."""
    return (1.0, outlook.pixels, outlook.pixels * len(outlook.scene.lights))


def over_hits(options: RenderOptions, history: RenderHistory) -> RenderOptions:
    """What mirrors show is left plain: it has no place in the picture of its own."""
    del history
    return replace(options, enhance=None)


def _of_subject(subject: Subject) -> Outputs:
    options = EnhanceOptions(source="picture")
    direct = shade(subject.scene, subject.gbuffer)
    size = of_scene(subject.scene, subject.gbuffer, None, None, options)
    return {"radiance": enhanced(direct, size, SurfaceImage.of(subject.gbuffer), options)}


def _nothing_changes_without_weight(subject: Subject, outputs: Outputs) -> float:
    direct = shade(subject.scene, subject.gbuffer)
    plain = EnhanceOptions(plain_weight=1.0, gradient_weight=0.0)
    covered = subject.gbuffer.covered
    same = enhanced(direct, outputs["radiance"], SurfaceImage.of(subject.gbuffer), plain)
    outside = (outputs["radiance"] - direct)[~covered]
    return max(float((same - direct).abs().max()), float(outside.abs().max()) if outside.numel() else 0.0)


HARD = HardEffect(
    name="enhancement",
    modules=("effects.enhancement.enhance", "effects.enhancement.gradient", "effects.enhancement.surface_image"),
    run=_of_subject,
    bounds=lambda subject: {"radiance": (0.0, 40.0 * subject.radiance_limit)},  # grazing faces: by 1 / 0.05
    law=Law(
        text="without weight the picture stays, and the background always: largest difference",
        deviation=_nothing_changes_without_weight,
        limit=0.0,
    ),
    rounding=0.05,  # silhouettes, where curvature is left out, move with vertices
    twins=0.05,
)

PASS = Pass(
    name="enhancement",
    summary="adds the gradient of the shading, so that shape reads better",
    makes=ENHANCEMENT,
    needs=(GBUFFER,),
    uses=(POINT_SHADOW, SOFT_SHADOW, PANE_SHADOW),
    asks=asks,
    applies=applies,
    run=run,
    amounts=amounts,
    over_hits=over_hits,
    hard=(HARD,),
)
