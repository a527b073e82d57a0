"""What a picture gives no gradient to is refused by name, not answered by a zero."""

from __future__ import annotations

from collections.abc import Sequence

from torchrender.checks import check_no_gradient
from torchrender.pipeline.options import RenderOptions
from torchrender.scene.light import check_place
from torchrender.scene.material import FIXED, Material
from torchrender.scene.model import Scene
from torchrender.scene.triangles import check_fixed

HELD = (*FIXED, "transmission_texture")
"""Of materials."""
TURNED = ("normal_texture", "metallic_roughness_texture")
"""Of materials that mirror: they decide where rays go."""
MEDIUM = ("low", "high", "absorption", "scattering", "emission", "density")


def check_gradients(function: str, scene: Scene, options: RenderOptions) -> None:
    """Refuse what asks for a gradient and would get none: meshes, numbers of materials, media, places of lights.

    Raises:
        GradientError: names the function and the input.
    """
    check_fixed(function, scene)
    check_no_gradient(function, **{"options.background": options.background})
    mirrors = options.reflections != "off"
    for number, material in enumerate(scene.materials):
        check_no_gradient(function, **_named(material, HELD))
        if mirrors and _asks(material) and bool(scene.material_table.is_reflector[number]):
            check_no_gradient(f"{function} with reflections (there is reflections='off')", **_named(material, TURNED))
    for medium in scene.media:
        for name in MEDIUM:
            check_no_gradient(function, **{f"{name} of medium {medium.name!r}": getattr(medium, name, None)})
    for light in scene.lights:
        check_place(function, light, moves=not options.shadows)


def _asks(material: Material) -> bool:
    turned = (getattr(material, name) for name in TURNED)
    return any(texture is not None and texture.requires_grad for texture in turned)


def _named(material: Material, names: Sequence[str]) -> dict[str, object]:
    return {f"{name} of material {material.name!r}": getattr(material, name) for name in names}
