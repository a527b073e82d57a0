"""What users would pick instead of the rasteriser: open3d's primary rays and software OpenGL. Measured, not needed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from torchrender.scene.camera import Cameras
from torchrender.scene.mesh import Geometry

_VERTEX = """
#version 330
uniform mat4 clip_from_world;
in vec3 position;
void main() { gl_Position = clip_from_world * vec4(position, 1.0); }
"""
_FRAGMENT = """
#version 330
out int triangle;
void main() { triangle = gl_PrimitiveID; }
"""


def open3d_rays(geometry: Geometry, camera: Cameras, threads: int) -> tuple[Callable[[], Any], Callable[[], Any]] | str:
    """(build, cast) for one camera's primary rays through ``RaycastingScene``, or why it cannot run."""
    try:
        import open3d
    except (ImportError, OSError) as error:
        return f"open3d is not usable here: {error}"
    vertices = geometry.vertices.numpy().astype(np.float32)
    faces = geometry.faces.numpy().astype(np.uint32)
    origins, directions = (a.reshape(-1, 3).numpy().astype(np.float32) for a in camera.rays())
    rays = open3d.core.Tensor.from_numpy(np.concatenate([origins, directions], axis=1))
    one = open3d.core.Tensor.from_numpy(np.array([[0, 0, 0, 0, 0, 1]], np.float32))

    def build() -> Any:
        scene = open3d.t.geometry.RaycastingScene(nthreads=threads)
        scene.add_triangles(vertices, faces)
        scene.cast_rays(one)  # the tree is built on first use
        return scene

    built = build()
    return build, lambda: built.cast_rays(rays, nthreads=threads)


def opengl_raster(geometry: Geometry, camera: Cameras) -> tuple[Callable[[], Any], str] | str:
    """(draw and read back id and depth, renderer name) through EGL, or why it cannot run."""
    try:
        import moderngl

        context = moderngl.create_context(standalone=True, backend="egl")
    except Exception as error:  # moderngl raises plain Exception where no EGL driver is found
        return f"software OpenGL is not usable here: {error}"
    size = (camera.width, camera.height)
    program = context.program(vertex_shader=_VERTEX, fragment_shader=_FRAGMENT)
    program["clip_from_world"].write(np.ascontiguousarray(_clip_from_world(camera).T, np.float32).tobytes())
    positions = context.buffer(geometry.vertices.numpy().astype(np.float32).tobytes())
    indices = context.buffer(geometry.faces.numpy().astype(np.int32).tobytes())
    mesh = context.vertex_array(program, [(positions, "3f", "position")], indices)
    ids = context.texture(size, 1, dtype="i4")
    depth = context.depth_texture(size)
    target = context.framebuffer([ids], depth)
    id_buffer, depth_buffer = bytearray(4 * size[0] * size[1]), bytearray(4 * size[0] * size[1])

    def draw() -> tuple[bytearray, bytearray]:
        target.use()
        context.enable(moderngl.DEPTH_TEST)
        target.clear(depth=1.0)
        mesh.render()
        ids.read_into(id_buffer)
        depth.read_into(depth_buffer)
        return id_buffer, depth_buffer

    return draw, str(context.info["GL_RENDERER"])


def _clip_from_world(camera: Cameras) -> np.ndarray[Any, Any]:
    """OpenGL clip coordinates of a perspective camera; a far plane at infinity is drawn at 1e4 near planes."""
    k = camera.intrinsics[0].numpy()
    width, height, near = camera.width, camera.height, float(camera.near[0])
    far = min(float(camera.far[0]), 1e4 * near)
    projection = np.array(
        [
            [2 * k[0, 0] / width, 0, 2 * k[0, 2] / width - 1, 0],
            [0, -2 * k[1, 1] / height, 1 - 2 * k[1, 2] / height, 0],
            [0, 0, (far + near) / (far - near), -2 * far * near / (far - near)],
            [0, 0, 1, 0],
        ]
    )
    matrix: np.ndarray[Any, Any] = projection @ camera.camera_from_world[0].numpy()
    return matrix
