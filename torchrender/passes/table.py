"""The passes of a picture: one record each. A new effect is one record here and one module in ``effects``.

A pass asks for buffers by name (``needs``: it cannot run without; ``uses``: it takes them where they exist), makes one,
says whether it applies and why, and has a knob with settings from fast to exact and a reference. Where several passes
make the same buffer, the first that applies makes it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from torchrender.effects.reflections.reuse_options import ReuseOptions
from torchrender.errors import InputError
from torchrender.passes import load as work
from torchrender.passes import outlook as reasons
from torchrender.passes import resolve as steps
from torchrender.passes.knobs import Knob, Setting
from torchrender.passes.load import Load
from torchrender.passes.outlook import Outlook, Verdict
from torchrender.pipeline.frame import Frame


@dataclass(frozen=True, kw_only=True)
class Pass:
    """One step of a picture."""

    name: str
    makes: str  # name of the buffer
    needs: tuple[str, ...] = ()
    uses: tuple[str, ...] = ()
    applies: Callable[[Outlook], Verdict]
    run: Callable[[Frame], Any]
    knob: Knob
    work: Callable[[Load, Setting], tuple[float, ...]]  # amounts that its time is a weighted sum of
    one_cost: bool = False  # the weights are the same for all settings: these only change the amounts
    hidden_by: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Its settings do not show where each of these passes, if it runs, is at one of these settings."""
    summary: str  # one line for readers


def _knob(
    name: str,
    settings: dict[str, dict[str, Any]],
    reference: tuple[str, dict[str, Any]] | None = None,
    context: dict[str, Any] | None = None,
) -> Knob:
    made = tuple(Setting(key, changes) for key, changes in settings.items())
    return Knob(name, made, made[-1] if reference is None else Setting(*reference), Setting("context", context or {}))


def _clustered(bin_factor: float, scale: float, missing: str) -> dict[str, Any]:
    return {
        "reflections": "clustered",
        "reflection.bin_factor": bin_factor,
        "reflection.image_scale": scale,
        "reflection.missing": missing,
    }


PASSES: tuple[Pass, ...] = (
    Pass(
        name="gbuffer",
        makes="gbuffer",
        applies=reasons.gbuffer,
        run=steps.draw_gbuffer,
        work=work.gbuffer,
        one_cost=True,
        summary="rasterises what every pixel sees; its knob is the number of rendered pixels, which all others follow",
        knob=_knob(
            "samples per pixel and side",
            {f"{factor:g}": {"supersample": factor} for factor in (0.25, 0.35, 0.5, 0.7, 1.0, 2.0)},
        ),
    ),
    Pass(
        name="shadow_map",
        makes="shadow_maps",
        needs=("gbuffer",),
        applies=reasons.shadow_map,
        run=steps.draw_shadow_maps,
        work=work.shadow_map,
        one_cost=True,
        hidden_by={"point_shadow": ("traced",), "soft_shadow": ("4 x 4", "8 x 8", "16 x 16")},
        summary="depth as lights see it",
        knob=_knob(
            "texels of a map's side",
            {str(size): {"shadow.size": size} for size in (256, 512, 1024, 2048)},
            ("4096", {"shadow.size": 4096}),
        ),
    ),
    Pass(
        name="point_shadow",
        makes="point_shadows",
        needs=("gbuffer",),
        uses=("shadow_maps",),
        applies=reasons.point_shadow,
        run=steps.find_point_shadows,
        work=work.point_shadow,
        summary="hard shadows of lights without area",
        knob=_knob(
            "look-up",
            {
                "nearest": {"point_shadows": "maps", "shadow.filter": "none"},
                "bilinear": {"point_shadows": "maps", "shadow.filter": "bilinear"},
                "traced": {"point_shadows": "traced", "shadow.filter": "bilinear"},
            },
        ),
    ),
    Pass(
        name="soft_shadow",
        makes="area_shadows",
        needs=("gbuffer",),
        uses=("shadow_maps",),
        applies=reasons.soft_shadow,
        run=steps.find_area_shadows,
        work=work.soft_shadow,
        summary="shadows of rectangular lights",
        knob=_knob(
            "way, light samples",
            {
                "hard": {"area_shadows": "hard"},
                "pcss": {"area_shadows": "pcss"},
                "4 x 4": {"area_shadows": "sampled", "soft_shadow.light_samples": 4},
                "8 x 8": {"area_shadows": "sampled", "soft_shadow.light_samples": 8},
                "16 x 16": {"area_shadows": "sampled", "soft_shadow.light_samples": 16},
            },
        ),
    ),
    Pass(
        name="direct_light",
        makes="direct",
        needs=("gbuffer",),
        uses=("point_shadows", "area_shadows"),
        applies=reasons.direct_light,
        run=steps.light_directly,
        work=work.direct_light,
        summary="light that arrives without detour",
        knob=_knob("irradiance of rectangles", {name: {"area_light": name} for name in ("centre", "polygon")}),
    ),
    Pass(
        name="reflection_reuse",
        makes="reflection_layer",
        needs=("gbuffer", "direct"),
        uses=("shadow_maps",),
        applies=reasons.reflection_reuse,
        run=steps.mirror_again,
        work=work.reflection_reuse,
        summary="mirrors of a sequence out of those of a key frame",
        knob=_knob(
            "what is good enough",
            {
                "loose": {"reuse": ReuseOptions(contrast=0.3, ratio=0.9, key_frame_threshold=0.5)},
                "usual": {"reuse": ReuseOptions()},
                "off": {"reuse": None},
            },
        ),
    ),
    Pass(
        name="reflections",
        makes="reflection_layer",
        needs=("gbuffer", "direct"),
        uses=("shadow_maps",),
        applies=reasons.reflections,
        run=steps.mirror,
        work=work.reflections,
        summary="what mirrors show",
        knob=_knob(
            "way",
            {
                "environment": {"reflections": "environment"},
                "few clusters": _clustered(0.25, 0.5, "environment"),
                "clusters": _clustered(1.0, 1.0, "environment"),
                "clusters, rest traced": _clustered(1.0, 1.0, "trace"),
                "traced": {"reflections": "traced"},
            },
        ),
    ),
    Pass(
        name="resolve",
        makes="picture",
        needs=("gbuffer", "direct"),
        uses=("reflection_layer",),
        applies=reasons.resolve,
        run=steps.make_picture,
        work=work.resolve,
        summary="blends reflections in and brings the picture to its size",
        knob=_knob(
            "upscaling",
            {name: {"upscaling": name} for name in ("nearest", "bilinear", "joint")},
            context={"supersample": 0.5},
        ),
    ),
)


def find_pass(name: str) -> Pass:
    """The pass of that name.

    Raises:
        InputError: there is none; the message lists those there are.
    """
    for step in PASSES:
        if step.name == name:
            return step
    raise InputError(f"there is no pass {name!r}; known passes: {', '.join(p.name for p in PASSES)}")
