"""What a picture gives no gradient to is refused by name, not answered by a zero."""

from __future__ import annotations

from torchrender.checks import check_no_gradient
from torchrender.pipeline.options import RenderOptions
from torchrender.scene.light import Light
from torchrender.scene.material import FIXED
from torchrender.scene.model import Scene
from torchrender.scene.triangles import check_fixed

PLACES = ("direction", "corner", "edge_u", "edge_v")
MEDIUM = ("low", "high", "absorption", "scattering", "emission", "density")


def check_gradients(function: str, scene: Scene, options: RenderOptions) -> None:
    """Refuse what asks for a gradient and would get none: meshes, numbers of materials, media, places of lights.

    Raises:
        GradientError: names the function and the input.
    """
    check_fixed(function, scene)
    check_no_gradient(function, **{"options.background": options.background})
    for material in scene.materials:
        for name in FIXED:
            check_no_gradient(function, **{f"{name} of material {material.name!r}": getattr(material, name)})
    for medium in scene.media:
        for name in MEDIUM:
            check_no_gradient(function, **{f"{name} of medium {medium.name!r}": getattr(medium, name, None)})
    for light in scene.lights:
        check_light(function, light, moves=not options.shadows)


def check_light(function: str, light: Light, *, moves: bool) -> None:
    """Refuse gradients to where a light is; ``moves``: its position may have one, as where there are no shadows.

    Raises:
        GradientError: names the function and the light.
    """
    for name in PLACES if moves else ("position", *PLACES):
        why = f"{name} of light {light.name!r}" + (" with shadows" if name == "position" else "")
        check_no_gradient(function, **{why: getattr(light, name, None)})
