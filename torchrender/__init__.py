"""torchrender: complex scenes approximated by depth images, every effect computed in image space on those.

The public names below are imported on first use, so that ``import torchrender`` itself is quick.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from torchrender.buffers import GBuffer, VisibilityBuffer
    from torchrender.effects.shadow_map import ShadowOptions
    from torchrender.errors import TorchRenderError
    from torchrender.image import Image
    from torchrender.raster import rasterize, rasterize_depth
    from torchrender.renderer import RenderOptions, render
    from torchrender.scene.camera import Cameras
    from torchrender.scene.environment import Environment
    from torchrender.scene.info import scene_info
    from torchrender.scene.light import DirectionalLight, PointLight, RectLight, SpotLight
    from torchrender.scene.load import load
    from torchrender.scene.material import Material
    from torchrender.scene.medium import Medium
    from torchrender.scene.mesh import Mesh
    from torchrender.scene.model import Scene

__version__ = "0.1.0"

__all__ = [
    "Cameras",
    "DirectionalLight",
    "Environment",
    "GBuffer",
    "Image",
    "Material",
    "Medium",
    "Mesh",
    "PointLight",
    "RectLight",
    "RenderOptions",
    "Scene",
    "ShadowOptions",
    "SpotLight",
    "TorchRenderError",
    "VisibilityBuffer",
    "__version__",
    "load",
    "rasterize",
    "rasterize_depth",
    "render",
    "scene_info",
]

_HOME = {
    "Cameras": "torchrender.scene.camera",
    "DirectionalLight": "torchrender.scene.light",
    "Environment": "torchrender.scene.environment",
    "GBuffer": "torchrender.buffers",
    "Image": "torchrender.image",
    "Material": "torchrender.scene.material",
    "Medium": "torchrender.scene.medium",
    "Mesh": "torchrender.scene.mesh",
    "PointLight": "torchrender.scene.light",
    "RectLight": "torchrender.scene.light",
    "RenderOptions": "torchrender.renderer",
    "Scene": "torchrender.scene.model",
    "ShadowOptions": "torchrender.effects.shadow_map",
    "SpotLight": "torchrender.scene.light",
    "TorchRenderError": "torchrender.errors",
    "VisibilityBuffer": "torchrender.buffers",
    "load": "torchrender.scene.load",
    "rasterize": "torchrender.raster",
    "rasterize_depth": "torchrender.raster",
    "render": "torchrender.renderer",
    "scene_info": "torchrender.scene.info",
}


def __getattr__(name: str) -> object:
    home = _HOME.get(name)
    if home is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(home), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
