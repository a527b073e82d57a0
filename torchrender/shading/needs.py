"""What a scene has that stages of the shading kernel are for: known before a picture is made, so that these are
compiled beside each other.
"""

from __future__ import annotations

from torchrender.scene.light import RectLight
from torchrender.scene.model import Scene
from torchrender.shading.looks import METALLIC_TEXTURES


def shading_needs(scene: Scene) -> set[str]:
    """Names of recorded parts, see :func:`torchrender.kernels.stages.stage`."""
    materials = scene.materials
    found = {
        "textures": any(getattr(m, name) is not None for m in materials for name in METALLIC_TEXTURES),
        "further": any(m.normal_texture is not None for m in materials) or scene.geometry.uv1 is not None,
        "environment": scene.environment is not None,
        "rectangles": any(isinstance(light, RectLight) for light in scene.lights),
        "phong": any(not m.is_physical and not m.unlit for m in materials),
        "metallic": any(m.is_physical and not m.unlit for m in materials),
        "layers": any(m.clearcoat > 0 or bool((m.sheen_color > 0).any()) for m in materials),
        "maps": any(m.normal_texture is not None or m.metallic_roughness_texture is not None for m in materials),
        "mirrors": any(m.is_reflector for m in materials),
    }
    return {f"shading.{name}" for name, needed in found.items() if needed}
