"""What a picture gives no gradient to is refused by name, not answered by a zero."""

from __future__ import annotations

from torchrender.checks import check_no_gradient
from torchrender.pipeline.options import RenderOptions
from torchrender.scene.light import check_place
from torchrender.scene.material import FIXED
from torchrender.scene.model import Scene
from torchrender.scene.triangles import check_fixed

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
        check_place(function, light, moves=not options.shadows)
