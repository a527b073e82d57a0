"""torchrender: complex scenes approximated by depth images, every effect computed in image space on those.

    import torchrender as tr

    scene = tr.load("living_room")         # or a .glb, .gltf, .obj, .ply, .stl or .toml file
    image = tr.render(scene, width=640, height=480)
    image.save("room.png")                 # .exr: radiance, depth, normals, ids; .npz: everything
    print(image.plan)                      # what ran, why, and what it took

Scenes      tr.load, tr.Scene, tr.Mesh.box, tr.Mesh.sphere, tr.Material, tr.RectLight; scene.replace, scene.moved
Cameras     tr.Cameras.look_at, .from_opencv, .from_opengl, .from_gltf, .from_colmap; tr.CameraPath
Pictures    tr.render, tr.RenderOptions, tr.plan, tr.write_film; budgets: tr.render(..., budget_ms=200)
Geometry    tr.rasterize, tr.RayCaster, tr.visibility, tr.flow, tr.held_surface
Depth       tr.sample_depth_images, tr.reconstruct_hybrid, tr.reproject
Voxels      tr.voxelize_solid, tr.voxelize_surface, tr.collide, tr.render_volume
Points      tr.load_points, tr.render_points, tr.pack_points
Viewing     tr.show: a scene of the running program in a browser or notebook, with updates and picks
Photos      tr.style_scene, torchrender.photo.fog, tr.load_rgbd, tr.build_walkthrough

Images are (B,H,W) or (B,H,W,C), float32, linear light; cameras look along +z with y down, worlds have y up; a pixel
that sees nothing has depth +inf and id -1. help(tr.NAME) tells the rest; so do the pages in docs/ (make docs).
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from torchrender.buffers import DepthImages, GBuffer, ReflectionLayer, VisibilityBuffer
    from torchrender.depth.correspondence import Flow, flow, visibility
    from torchrender.depth.options import SamplingOptions
    from torchrender.depth.sample import sample_depth_images, sample_offset_images
    from torchrender.effects.enhancement.curvature import vertex_curvature
    from torchrender.effects.enhancement.enhance import enhance_picture
    from torchrender.effects.enhancement.options import EnhanceOptions
    from torchrender.effects.reflections.clustered import ClusterOptions, clustered_reflections
    from torchrender.effects.reflections.reflectors import blend_reflections, reflective_pixels
    from torchrender.effects.reflections.reuse_options import ReuseOptions
    from torchrender.effects.reflections.traced import TraceOptions, trace_reflections
    from torchrender.effects.shadows.occluders import OccluderOptions, approximate_occluders
    from torchrender.effects.shadows.shadow_map import ShadowOptions
    from torchrender.effects.shadows.soft_shadow import SoftShadowOptions, soft_shadow
    from torchrender.errors import TorchRenderError
    from torchrender.image import Image
    from torchrender.images.film import write_film
    from torchrender.photo.style.options import FitOptions, SearchOptions, StyleOptions
    from torchrender.photo.style.session import Style
    from torchrender.photo.style.sheet import contact_sheet
    from torchrender.photo.style.transfer import style_scene
    from torchrender.pipeline.history import RenderHistory
    from torchrender.pipeline.options import RenderOptions
    from torchrender.planning.plan import Plan
    from torchrender.planning.planner import plan
    from torchrender.points.cloud import PointCloud
    from torchrender.points.draw import render_points
    from torchrender.points.file import open_points, write_points
    from torchrender.points.load import load_points
    from torchrender.points.options import SplatOptions
    from torchrender.points.pack import PackOptions, pack_points
    from torchrender.points.tree import build_patches
    from torchrender.raster import rasterize, rasterize_depth
    from torchrender.rays import RayCaster
    from torchrender.reconstruct.hybrid import reconstruct_hybrid
    from torchrender.reconstruct.reproject import ReprojectOptions, reproject
    from torchrender.renderer import render
    from torchrender.scene.camera import Cameras
    from torchrender.scene.cameras.path import CameraPath, built_in_path, load_path
    from torchrender.scene.environment import Environment
    from torchrender.scene.files.scene_write import write_scene
    from torchrender.scene.info import scene_info
    from torchrender.scene.light import DirectionalLight, PointLight, RectLight, SpotLight
    from torchrender.scene.load import load
    from torchrender.scene.material import Material
    from torchrender.scene.medium import Medium
    from torchrender.scene.mesh import Mesh
    from torchrender.scene.model import Scene
    from torchrender.shading.held_surface import HeldSurface, held_surface
    from torchrender.viewer import show
    from torchrender.voxels.attributes import voxelize_attributes, voxelize_scene
    from torchrender.voxels.collision import CollisionOptions, collide
    from torchrender.voxels.file import read_voxels, write_voxels
    from torchrender.voxels.functions import voxelize_implicit, voxelize_parametric
    from torchrender.voxels.grid import VoxelGrid, Voxels, make_grid
    from torchrender.voxels.mesh import voxel_mesh
    from torchrender.voxels.solid import SolidOptions, voxelize_solid
    from torchrender.voxels.surface import SurfaceOptions, voxelize_surface
    from torchrender.voxels.volume import render_volume
    from torchrender.walkthrough.build import build_walkthrough
    from torchrender.walkthrough.draw import draw_walkthrough
    from torchrender.walkthrough.file import read_walkthrough, write_walkthrough
    from torchrender.walkthrough.frames.layouts import load_rgbd
    from torchrender.walkthrough.frames.record import RgbdSequence
    from torchrender.walkthrough.model import Walkthrough
    from torchrender.walkthrough.options import DrawOptions, WalkthroughOptions
    from torchrender.walkthrough.review.next_view import next_views

__version__ = "0.1.0"

__all__ = [
    "CameraPath",
    "Cameras",
    "ClusterOptions",
    "CollisionOptions",
    "DepthImages",
    "DirectionalLight",
    "DrawOptions",
    "EnhanceOptions",
    "Environment",
    "FitOptions",
    "Flow",
    "GBuffer",
    "HeldSurface",
    "Image",
    "Material",
    "Medium",
    "Mesh",
    "OccluderOptions",
    "PackOptions",
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
    "RgbdSequence",
    "SamplingOptions",
    "Scene",
    "SearchOptions",
    "ShadowOptions",
    "SoftShadowOptions",
    "SolidOptions",
    "SplatOptions",
    "SpotLight",
    "Style",
    "StyleOptions",
    "SurfaceOptions",
    "TorchRenderError",
    "TraceOptions",
    "VisibilityBuffer",
    "VoxelGrid",
    "Voxels",
    "Walkthrough",
    "WalkthroughOptions",
    "__version__",
    "approximate_occluders",
    "blend_reflections",
    "build_patches",
    "build_walkthrough",
    "built_in_path",
    "clustered_reflections",
    "collide",
    "contact_sheet",
    "draw_walkthrough",
    "enhance_picture",
    "flow",
    "held_surface",
    "load",
    "load_path",
    "load_points",
    "load_rgbd",
    "make_grid",
    "next_views",
    "open_points",
    "pack_points",
    "plan",
    "rasterize",
    "rasterize_depth",
    "read_voxels",
    "read_walkthrough",
    "reconstruct_hybrid",
    "reflective_pixels",
    "render",
    "render_points",
    "render_volume",
    "reproject",
    "sample_depth_images",
    "sample_offset_images",
    "scene_info",
    "show",
    "soft_shadow",
    "style_scene",
    "trace_reflections",
    "vertex_curvature",
    "visibility",
    "voxel_mesh",
    "voxelize_attributes",
    "voxelize_implicit",
    "voxelize_parametric",
    "voxelize_scene",
    "voxelize_solid",
    "voxelize_surface",
    "write_film",
    "write_points",
    "write_scene",
    "write_voxels",
    "write_walkthrough",
]

_HOME = {
    "DrawOptions": "torchrender.walkthrough.options",
    "RgbdSequence": "torchrender.walkthrough.frames.record",
    "Walkthrough": "torchrender.walkthrough.model",
    "WalkthroughOptions": "torchrender.walkthrough.options",
    "build_walkthrough": "torchrender.walkthrough.build",
    "draw_walkthrough": "torchrender.walkthrough.draw",
    "load_rgbd": "torchrender.walkthrough.frames.layouts",
    "next_views": "torchrender.walkthrough.review.next_view",
    "read_walkthrough": "torchrender.walkthrough.file",
    "write_walkthrough": "torchrender.walkthrough.file",
    "CameraPath": "torchrender.scene.cameras.path",
    "Cameras": "torchrender.scene.camera",
    "ClusterOptions": "torchrender.effects.reflections.clustered",
    "CollisionOptions": "torchrender.voxels.collision",
    "DepthImages": "torchrender.buffers",
    "DirectionalLight": "torchrender.scene.light",
    "Environment": "torchrender.scene.environment",
    "FitOptions": "torchrender.photo.style.options",
    "Flow": "torchrender.depth.correspondence",
    "flow": "torchrender.depth.correspondence",
    "visibility": "torchrender.depth.correspondence",
    "GBuffer": "torchrender.buffers",
    "HeldSurface": "torchrender.shading.held_surface",
    "held_surface": "torchrender.shading.held_surface",
    "Image": "torchrender.image",
    "Material": "torchrender.scene.material",
    "Medium": "torchrender.scene.medium",
    "Mesh": "torchrender.scene.mesh",
    "OccluderOptions": "torchrender.effects.shadows.occluders",
    "PointCloud": "torchrender.points.cloud",
    "PointLight": "torchrender.scene.light",
    "RayCaster": "torchrender.rays",
    "RectLight": "torchrender.scene.light",
    "ReflectionLayer": "torchrender.buffers",
    "RenderHistory": "torchrender.pipeline.history",
    "Plan": "torchrender.planning.plan",
    "RenderOptions": "torchrender.pipeline.options",
    "EnhanceOptions": "torchrender.effects.enhancement.options",
    "enhance_picture": "torchrender.effects.enhancement.enhance",
    "vertex_curvature": "torchrender.effects.enhancement.curvature",
    "ReprojectOptions": "torchrender.reconstruct.reproject",
    "ReuseOptions": "torchrender.effects.reflections.reuse_options",
    "SamplingOptions": "torchrender.depth.options",
    "Scene": "torchrender.scene.model",
    "SearchOptions": "torchrender.photo.style.options",
    "ShadowOptions": "torchrender.effects.shadows.shadow_map",
    "SoftShadowOptions": "torchrender.effects.shadows.soft_shadow",
    "SolidOptions": "torchrender.voxels.solid",
    "PackOptions": "torchrender.points.pack",
    "SplatOptions": "torchrender.points.options",
    "SpotLight": "torchrender.scene.light",
    "Style": "torchrender.photo.style.session",
    "StyleOptions": "torchrender.photo.style.options",
    "SurfaceOptions": "torchrender.voxels.surface",
    "TorchRenderError": "torchrender.errors",
    "TraceOptions": "torchrender.effects.reflections.traced",
    "VisibilityBuffer": "torchrender.buffers",
    "VoxelGrid": "torchrender.voxels.grid",
    "Voxels": "torchrender.voxels.grid",
    "approximate_occluders": "torchrender.effects.shadows.occluders",
    "blend_reflections": "torchrender.effects.reflections.reflectors",
    "build_patches": "torchrender.points.tree",
    "built_in_path": "torchrender.scene.cameras.path",
    "clustered_reflections": "torchrender.effects.reflections.clustered",
    "collide": "torchrender.voxels.collision",
    "contact_sheet": "torchrender.photo.style.sheet",
    "load": "torchrender.scene.load",
    "load_path": "torchrender.scene.cameras.path",
    "load_points": "torchrender.points.load",
    "make_grid": "torchrender.voxels.grid",
    "open_points": "torchrender.points.file",
    "rasterize": "torchrender.raster",
    "rasterize_depth": "torchrender.raster",
    "read_voxels": "torchrender.voxels.file",
    "reconstruct_hybrid": "torchrender.reconstruct.hybrid",
    "reflective_pixels": "torchrender.effects.reflections.reflectors",
    "plan": "torchrender.planning.planner",
    "render": "torchrender.renderer",
    "pack_points": "torchrender.points.pack",
    "render_points": "torchrender.points.draw",
    "render_volume": "torchrender.voxels.volume",
    "reproject": "torchrender.reconstruct.reproject",
    "sample_depth_images": "torchrender.depth.sample",
    "sample_offset_images": "torchrender.depth.sample",
    "scene_info": "torchrender.scene.info",
    "show": "torchrender.viewer",
    "soft_shadow": "torchrender.effects.shadows.soft_shadow",
    "style_scene": "torchrender.photo.style.transfer",
    "trace_reflections": "torchrender.effects.reflections.traced",
    "voxel_mesh": "torchrender.voxels.mesh",
    "voxelize_attributes": "torchrender.voxels.attributes",
    "voxelize_implicit": "torchrender.voxels.functions",
    "voxelize_parametric": "torchrender.voxels.functions",
    "voxelize_scene": "torchrender.voxels.attributes",
    "voxelize_solid": "torchrender.voxels.solid",
    "voxelize_surface": "torchrender.voxels.surface",
    "write_film": "torchrender.images.film",
    "write_points": "torchrender.points.file",
    "write_scene": "torchrender.scene.files.scene_write",
    "write_voxels": "torchrender.voxels.file",
}


def __getattr__(name: str) -> object:
    home = _HOME.get(name)
    if home is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(home), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
