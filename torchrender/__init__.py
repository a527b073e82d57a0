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
    from torchrender.effects.splat import render_points
    from torchrender.effects.traced_reflection import TraceOptions, trace_reflections
    from torchrender.effects.voxel_volume import render_volume
    from torchrender.errors import TorchRenderError
    from torchrender.geometry.light_occluders import OccluderOptions, approximate_occluders
    from torchrender.geometry.point_cloud import PointCloud
    from torchrender.geometry.point_file import open_points, write_points
    from torchrender.geometry.point_load import load_points
    from torchrender.geometry.point_options import SplatOptions
    from torchrender.geometry.point_tree import build_patches
    from torchrender.geometry.reconstruct import reconstruct_hybrid
    from torchrender.geometry.voxel_attributes import voxelize_attributes, voxelize_scene
    from torchrender.geometry.voxel_collision import CollisionOptions, collide
    from torchrender.geometry.voxel_file import read_voxels, write_voxels
    from torchrender.geometry.voxel_functions import voxelize_implicit, voxelize_parametric
    from torchrender.geometry.voxel_grid import VoxelGrid, Voxels, make_grid
    from torchrender.geometry.voxel_mesh import voxel_mesh
    from torchrender.geometry.voxel_solid import SolidOptions, voxelize_solid
    from torchrender.geometry.voxelize import SurfaceOptions, voxelize_surface
    from torchrender.history import RenderHistory
    from torchrender.image import Image
    from torchrender.options import RenderOptions
    from torchrender.planner import plan
    from torchrender.plans import Plan
    from torchrender.raster import rasterize, rasterize_depth
    from torchrender.rays import RayCaster
    from torchrender.reflection.reflectors import blend_reflections, reflective_pixels
    from torchrender.reflection.reuse_options import ReuseOptions
    from torchrender.renderer import render
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
    "CollisionOptions",
    "DepthImages",
    "DirectionalLight",
    "Environment",
    "GBuffer",
    "Image",
    "Material",
    "Medium",
    "Mesh",
    "OccluderOptions",
    "Plan",
    "PointCloud",
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
    "SolidOptions",
    "SplatOptions",
    "SpotLight",
    "SurfaceOptions",
    "TorchRenderError",
    "TraceOptions",
    "VisibilityBuffer",
    "VoxelGrid",
    "Voxels",
    "__version__",
    "approximate_occluders",
    "blend_reflections",
    "build_patches",
    "built_in_path",
    "clustered_reflections",
    "collide",
    "load",
    "load_path",
    "load_points",
    "make_grid",
    "open_points",
    "plan",
    "rasterize",
    "rasterize_depth",
    "read_voxels",
    "reconstruct_hybrid",
    "reflective_pixels",
    "render",
    "render_points",
    "render_volume",
    "reproject",
    "sample_depth_images",
    "sample_offset_images",
    "scene_info",
    "soft_shadow",
    "trace_reflections",
    "voxel_mesh",
    "voxelize_attributes",
    "voxelize_implicit",
    "voxelize_parametric",
    "voxelize_scene",
    "voxelize_solid",
    "voxelize_surface",
    "write_points",
    "write_voxels",
]

_HOME = {
    "CameraPath": "torchrender.scene.camera_path",
    "Cameras": "torchrender.scene.camera",
    "ClusterOptions": "torchrender.effects.clustered_reflection",
    "CollisionOptions": "torchrender.geometry.voxel_collision",
    "DepthImages": "torchrender.buffers",
    "DirectionalLight": "torchrender.scene.light",
    "Environment": "torchrender.scene.environment",
    "GBuffer": "torchrender.buffers",
    "Image": "torchrender.image",
    "Material": "torchrender.scene.material",
    "Medium": "torchrender.scene.medium",
    "Mesh": "torchrender.scene.mesh",
    "OccluderOptions": "torchrender.geometry.light_occluders",
    "PointCloud": "torchrender.geometry.point_cloud",
    "PointLight": "torchrender.scene.light",
    "RayCaster": "torchrender.rays",
    "RectLight": "torchrender.scene.light",
    "ReflectionLayer": "torchrender.buffers",
    "RenderHistory": "torchrender.history",
    "Plan": "torchrender.plans",
    "RenderOptions": "torchrender.options",
    "ReprojectOptions": "torchrender.reprojection",
    "ReuseOptions": "torchrender.reflection.reuse_options",
    "SamplingOptions": "torchrender.depth.options",
    "Scene": "torchrender.scene.model",
    "ShadowOptions": "torchrender.effects.shadow_map",
    "SoftShadowOptions": "torchrender.effects.soft_shadow",
    "SolidOptions": "torchrender.geometry.voxel_solid",
    "SplatOptions": "torchrender.geometry.point_options",
    "SpotLight": "torchrender.scene.light",
    "SurfaceOptions": "torchrender.geometry.voxelize",
    "TorchRenderError": "torchrender.errors",
    "TraceOptions": "torchrender.effects.traced_reflection",
    "VisibilityBuffer": "torchrender.buffers",
    "VoxelGrid": "torchrender.geometry.voxel_grid",
    "Voxels": "torchrender.geometry.voxel_grid",
    "approximate_occluders": "torchrender.geometry.light_occluders",
    "blend_reflections": "torchrender.reflection.reflectors",
    "build_patches": "torchrender.geometry.point_tree",
    "built_in_path": "torchrender.scene.camera_path",
    "clustered_reflections": "torchrender.effects.clustered_reflection",
    "collide": "torchrender.geometry.voxel_collision",
    "load": "torchrender.scene.load",
    "load_path": "torchrender.scene.camera_path",
    "load_points": "torchrender.geometry.point_load",
    "make_grid": "torchrender.geometry.voxel_grid",
    "open_points": "torchrender.geometry.point_file",
    "rasterize": "torchrender.raster",
    "rasterize_depth": "torchrender.raster",
    "read_voxels": "torchrender.geometry.voxel_file",
    "reconstruct_hybrid": "torchrender.geometry.reconstruct",
    "reflective_pixels": "torchrender.reflection.reflectors",
    "plan": "torchrender.planner",
    "render": "torchrender.renderer",
    "render_points": "torchrender.effects.splat",
    "render_volume": "torchrender.effects.voxel_volume",
    "reproject": "torchrender.reprojection",
    "sample_depth_images": "torchrender.depth.sample",
    "sample_offset_images": "torchrender.depth.sample",
    "scene_info": "torchrender.scene.info",
    "soft_shadow": "torchrender.effects.soft_shadow",
    "trace_reflections": "torchrender.effects.traced_reflection",
    "voxel_mesh": "torchrender.geometry.voxel_mesh",
    "voxelize_attributes": "torchrender.geometry.voxel_attributes",
    "voxelize_implicit": "torchrender.geometry.voxel_functions",
    "voxelize_parametric": "torchrender.geometry.voxel_functions",
    "voxelize_scene": "torchrender.geometry.voxel_attributes",
    "voxelize_solid": "torchrender.geometry.voxel_solid",
    "voxelize_surface": "torchrender.geometry.voxelize",
    "write_points": "torchrender.geometry.point_file",
    "write_voxels": "torchrender.geometry.voxel_file",
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
