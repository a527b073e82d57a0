"""The same scene, textured and lit, drawn by OpenGL in software (VTK on Mesa's llvmpipe), where VTK is installed."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

import numpy as np

from torchrender.report.shading.subject import Subject


def available() -> bool:
    """VTK is there."""
    try:
        importlib.import_module("vtkmodules.all")
    except ImportError:
        return False
    return True


def drawer(one: Subject) -> tuple[Callable[[], None], str]:
    """Draws a picture, with one light at the eye; and the name of the renderer."""
    vtk: Any = importlib.import_module("vtkmodules.all")
    side = one.seen.triangle.shape[1]
    window, renderer = vtk.vtkRenderWindow(), vtk.vtkRenderer()
    window.SetOffScreenRendering(1)
    window.SetMultiSamples(0)
    window.SetSize(side, side)
    window.AddRenderer(renderer)
    for number in range(len(one.scene.materials)):
        actor = _actor(vtk, one, number)
        if actor is not None:
            renderer.AddActor(actor)
    camera, view = renderer.GetActiveCamera(), one.seen.cameras
    eye, forward = view.eye[0], view.forward[0]
    camera.SetPosition(*eye.tolist())
    camera.SetFocalPoint(*(eye + forward).tolist())
    camera.SetViewUp(*(-view.rotation[0, 1]).tolist())
    camera.SetViewAngle(float(2.0 * np.degrees(np.arctan(side / 2 / float(view.intrinsics[0, 1, 1])))))
    renderer.ResetCameraClippingRange()

    def draw() -> None:
        camera.Azimuth(1e-4)  # so that nothing is taken from the last picture
        window.Render()
        window.WaitForCompletion()

    draw()
    told = [line for line in window.ReportCapabilities().splitlines() if "renderer string" in line]
    return draw, told[0].split(":", 1)[1].strip() if told else "OpenGL"


def _actor(vtk: Any, one: Subject, number: int) -> Any:
    """The triangles of one material."""
    support: Any = importlib.import_module("vtkmodules.util.numpy_support")
    geometry, material = one.scene.geometry, one.scene.materials[number]
    faces = geometry.faces[geometry.material == number].long()
    if not len(faces):
        return None
    used, corner = faces.reshape(-1).unique(return_inverse=True)
    mesh, points, cells = vtk.vtkPolyData(), vtk.vtkPoints(), vtk.vtkCellArray()
    points.SetData(support.numpy_to_vtk(geometry.vertices[used].float().numpy(), deep=True))
    offsets = np.arange(0, 3 * len(faces) + 1, 3)
    cells.SetData(
        support.numpy_to_vtkIdTypeArray(offsets, deep=True), support.numpy_to_vtkIdTypeArray(corner.numpy(), deep=True)
    )
    mesh.SetPoints(points)
    mesh.SetPolys(cells)
    if geometry.normals is not None:
        mesh.GetPointData().SetNormals(support.numpy_to_vtk(geometry.normals[used].numpy(), deep=True))
    mapper, actor = vtk.vtkPolyDataMapper(), vtk.vtkActor()
    mapper.SetInputData(mesh)
    actor.SetMapper(mapper)
    actor.GetProperty().SetColor(*material.diffuse.clamp(0, 1).tolist())
    if geometry.uv is not None and material.diffuse_texture is not None:
        mesh.GetPointData().SetTCoords(support.numpy_to_vtk(geometry.uv[used].numpy(), deep=True))
        height, width, _ = material.diffuse_texture.shape
        image, texture = vtk.vtkImageData(), vtk.vtkTexture()
        image.SetDimensions(width, height, 1)
        colors = (
            (material.diffuse_texture[..., :3].flip(0).clamp(0, 1) * 255).byte().reshape(-1, 3).contiguous().numpy()
        )
        image.GetPointData().SetScalars(support.numpy_to_vtk(colors, deep=True))
        texture.SetInputData(image)
        texture.SetMipmap(True)
        texture.InterpolateOn()
        texture.RepeatOn()
        actor.SetTexture(texture)
    return actor
