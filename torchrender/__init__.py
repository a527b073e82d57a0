"""torchrender: complex scenes approximated by depth images, every effect computed in image space on those.

The public names below are imported on first use, so that ``import torchrender`` itself is quick.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from torchrender.buffers import DepthImages, GBuffer, ReflectionLayer, VisibilityBuffer
    from torchrender.depth.options import SamplingOptions
    from torchrender.depth.sample import sample_depth_images, sample_offset_images
    from torchrender.effects.clustered_reflection import ClusterOptions, clustered_reflections
    from torchrender.effects.shadow_map import ShadowOptions
    from torchrender.effects.soft_shadow import SoftShadowOptions, soft_shadow
    from torchrender.effects.traced_reflection import TraceOptions, trace_reflections
    from torchrender.errors import TorchRenderError
    from torchrender.geometry.light_occluders import OccluderOptions, approximate_occluders
    from torchrender.geometry.reconstruct import reconstruct_hybrid
    from torchrender.history import RenderHistory
    from torchrender.image import Image
    from torchrender.raster import rasterize, rasterize_depth
    from torchrender.rays import RayCaster
    from torchrender.reflection.reflectors import blend_reflections, reflective_pixels
    from torchrender.reflection.reuse_options import ReuseOptions
    from torchrender.renderer import RenderOptions, render
    from torchrender.reprojection import ReprojectOptions, reproject
    from torchrender.scene.camera import Cameras
    from torchrender.scene.camera_path import CameraPath, built_in_path, load_path
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
    "CameraPath",
    "Cameras",
    "ClusterOptions",
    "DepthImages",
    "DirectionalLight",
    "Environment",
    "GBuffer",
    "Image",
    "Material",
    "Medium",
    "Mesh",
    "OccluderOptions",
    "PointLight",
    "RayCaster",
    "RectLight",
    "ReflectionLayer",
    "RenderHistory",
    "RenderOptions",
    "ReprojectOptions",
    "ReuseOptions",
    "SamplingOptions",
    "Scene",
    "ShadowOptions",
    "SoftShadowOptions",
    "SpotLight",
    "TorchRenderError",
    "TraceOptions",
    "VisibilityBuffer",
    "__version__",
    "approximate_occluders",
    "blend_reflections",
    "built_in_path",
    "clustered_reflections",
    "load",
    "load_path",
    "rasterize",
    "rasterize_depth",
    "reconstruct_hybrid",
    "reflective_pixels",
    "render",
    "reproject",
    "sample_depth_images",
    "sample_offset_images",
    "scene_info",
    "soft_shadow",
    "trace_reflections",
]

_HOME = {
    "CameraPath": "torchrender.scene.camera_path",
    "Cameras": "torchrender.scene.camera",
    "ClusterOptions": "torchrender.effects.clustered_reflection",
    "DepthImages": "torchrender.buffers",
    "DirectionalLight": "torchrender.scene.light",
    "Environment": "torchrender.scene.environment",
    "GBuffer": "torchrender.buffers",
    "Image": "torchrender.image",
    "Material": "torchrender.scene.material",
    "Medium": "torchrender.scene.medium",
    "Mesh": "torchrender.scene.mesh",
    "OccluderOptions": "torchrender.geometry.light_occluders",
    "PointLight": "torchrender.scene.light",
    "RayCaster": "torchrender.rays",
    "RectLight": "torchrender.scene.light",
    "ReflectionLayer": "torchrender.buffers",
    "RenderHistory": "torchrender.history",
    "RenderOptions": "torchrender.renderer",
    "ReprojectOptions": "torchrender.reprojection",
    "ReuseOptions": "torchrender.reflection.reuse_options",
    "SamplingOptions": "torchrender.depth.options",
    "Scene": "torchrender.scene.model",
    "ShadowOptions": "torchrender.effects.shadow_map",
    "SoftShadowOptions": "torchrender.effects.soft_shadow",
    "SpotLight": "torchrender.scene.light",
    "TorchRenderError": "torchrender.errors",
    "TraceOptions": "torchrender.effects.traced_reflection",
    "VisibilityBuffer": "torchrender.buffers",
    "approximate_occluders": "torchrender.geometry.light_occluders",
    "blend_reflections": "torchrender.reflection.reflectors",
    "built_in_path": "torchrender.scene.camera_path",
    "clustered_reflections": "torchrender.effects.clustered_reflection",
    "load": "torchrender.scene.load",
    "load_path": "torchrender.scene.camera_path",
    "rasterize": "torchrender.raster",
    "rasterize_depth": "torchrender.raster",
    "reconstruct_hybrid": "torchrender.geometry.reconstruct",
    "reflective_pixels": "torchrender.reflection.reflectors",
    "render": "torchrender.renderer",
    "reproject": "torchrender.reprojection",
    "sample_depth_images": "torchrender.depth.sample",
    "sample_offset_images": "torchrender.depth.sample",
    "scene_info": "torchrender.scene.info",
    "soft_shadow": "torchrender.effects.soft_shadow",
    "trace_reflections": "torchrender.effects.traced_reflection",
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
