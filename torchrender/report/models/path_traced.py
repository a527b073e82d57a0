"""A scene as Mitsuba's path tracer sees it: an outside reading of materials, textures and light.

Meshes, textures and cameras are handed over as they are; surfaces become Mitsuba's ``principled`` ones, which are not
glTF's to the last percent (another diffuse term, another sheen, a dimmer coat): features count, not pixels.
"""

from __future__ import annotations

import importlib.util
import math
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchrender.scene.camera import Cameras
from torchrender.scene.light import DirectionalLight, Light, PointLight, RectLight, SpotLight
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene

DEPTH = 12
"""Of paths: panes take two each."""


def available() -> bool:
    """Whether Mitsuba is installed."""
    return importlib.util.find_spec("mitsuba") is not None


def path_traced(scene: Scene, camera: Cameras, samples: int) -> Tensor:
    """(H,W,3) radiance of one camera's picture."""
    import mitsuba as mi

    mi.set_variant("scalar_rgb")  # the other variants bring a compiler that does not get on with ours
    mi.set_log_level(mi.LogLevel.Error)
    with TemporaryDirectory() as folder:
        world = _World(mi, scene, Path(folder)).all_of(camera)
        image = np.array(mi.render(mi.load_dict(world), spp=samples, seed=1))
    return torch.from_numpy(image[..., :3].astype(np.float32))


@dataclass(frozen=True)
class _World:
    """One scene in Mitsuba's words."""

    mi: Any
    scene: Scene
    folder: Path

    def all_of(self, camera: Cameras) -> dict[str, Any]:
        """Everything, seen by a camera."""
        mi = self.mi
        pose = torch.linalg.inv(camera.camera_from_world[0]).numpy() @ np.diag([-1.0, -1.0, 1.0, 1.0])
        height = 2.0 * math.degrees(math.atan(camera.height / 2.0 / float(camera.intrinsics[0, 1, 1])))
        film = {
            "type": "hdrfilm", "width": camera.width, "height": camera.height, "pixel_format": "rgb",
            "rfilter": {"type": "box"},
        }  # fmt: skip
        made: dict[str, Any] = {
            "type": "scene",
            "integrator": {"type": "volpath", "max_depth": DEPTH},  # the one whose shadow rays pass holes
            "sensor": {
                "type": "perspective", "fov": height, "fov_axis": "y", "to_world": mi.ScalarTransform4f(pose),
                "near_clip": float(camera.near[0]), "far_clip": 1e5, "film": film,
            },
        }  # fmt: skip
        for number, mesh in enumerate(self.scene.meshes):
            if len(mesh.faces):
                made[f"mesh{number}"] = self._mesh(number, mesh)
        for number, light in enumerate(self.scene.lights):
            made[f"light{number}"] = self._light(light)
        sky = self.scene.environment
        if sky is not None:
            turn = mi.ScalarTransform4f().rotate([0, 1, 0], 180)  # the middle column looks along -z here
            picture = (sky.radiance if sky.shown is None else sky.shown) * sky.intensity
            made["sky"] = {"type": "envmap", "bitmap": mi.Bitmap(_packed(picture)), "to_world": turn}
        elif bool((self.scene.ambient > 0).any()):
            made["sky"] = {"type": "constant", "radiance": _rgb(self.scene.ambient)}
        return made

    def _mesh(self, number: int, mesh: Mesh) -> dict[str, Any]:
        file = self.folder / f"{number}.ply"
        _write_ply(file, mesh)
        material = self.scene.materials[mesh.material]
        made: dict[str, Any] = {"type": "ply", "filename": str(file), "face_normals": mesh.normals is None}
        surface = self._surface(material, mesh)
        if material.unlit:
            made["emitter"] = {"type": "area", "radiance": self._color(material, "diffuse", mesh)}
        elif bool((material.emission > 0).any()):
            made["emitter"] = {"type": "area", "radiance": self._color(material, "emission", mesh)}
        return {**made, "bsdf": surface}

    def _surface(self, material: Material, mesh: Mesh) -> dict[str, Any]:
        if material.unlit:
            return {"type": "diffuse", "reflectance": _rgb(torch.zeros(3))}
        if not material.is_physical:
            inner = {"type": "diffuse", "reflectance": self._color(material, "diffuse", mesh)}
        else:
            inner = self._principled(material, mesh)
        if material.normal_texture is not None:
            bump = (material.normal_texture[..., :3] - 0.5) * torch.tensor(
                [material.normal_scale, material.normal_scale, 1.0]
            ) + 0.5
            inner = {"type": "normalmap", "normalmap": self._picture(material, "normal_texture", bump), "bsdf": inner}
        if material.double_sided and material.transmission == 0.0:
            inner = {"type": "twosided", "bsdf": inner}
        alpha = _alpha(material)
        if alpha is None:
            return inner
        opacity = alpha if isinstance(alpha, float) else self._picture(material, "diffuse_texture", alpha)
        return {"type": "mask", "opacity": opacity, "bsdf": inner}

    def _principled(self, material: Material, mesh: Mesh) -> dict[str, Any]:
        thin = material.transmission > 0.0
        made: dict[str, Any] = {
            "type": "principledthin" if thin else "principled",
            "base_color": self._color(material, "diffuse", mesh),
            "roughness": self._factor(material, "metallic_roughness_texture", 1, material.roughness),
            "eta": 1.0 + 1e-3
            if material.f0 == 0.0
            else (1.0 + math.sqrt(material.f0)) / (1.0 - math.sqrt(material.f0)),
        }
        if thin:
            made["spec_trans"] = self._factor(material, "transmission_texture", 0, material.transmission)
        else:
            made["metallic"] = self._factor(material, "metallic_roughness_texture", 2, material.metallic or 0.0)
            made["clearcoat"] = self._factor(material, "clearcoat_texture", 0, material.clearcoat)
            made["clearcoat_gloss"] = 1.0 - material.clearcoat_roughness
        made["sheen"] = float(material.sheen_color.max())
        return made

    def _color(self, material: Material, name: str, mesh: Mesh) -> dict[str, Any]:
        factor, texture = getattr(material, name), getattr(material, f"{name}_texture")
        if texture is not None:
            return self._picture(material, f"{name}_texture", texture[..., :3] * factor)
        if name == "diffuse" and mesh.colors is not None:
            return {"type": "mesh_attribute", "name": "vertex_color"}
        return _rgb(factor)

    def _factor(self, material: Material, name: str, channel: int, factor: float) -> Any:
        texture = getattr(material, name)
        if texture is None:
            return factor
        return self._picture(material, name, texture[..., channel : channel + 1].expand(-1, -1, 3) * factor)

    def _picture(self, material: Material, name: str, picture: Tensor) -> dict[str, Any]:
        """Rows go up from v = 0 there."""
        sampler = material.sampler(name)
        lay = np.eye(3)
        lay[:2] = sampler.transform.numpy()
        return {
            "type": "bitmap", "bitmap": self.mi.Bitmap(_packed(picture.flip(0))), "raw": True,
            "wrap_mode": sampler.wrap_u, "to_uv": self.mi.ScalarTransform3f(lay),
            "filter_type": "nearest" if sampler.filter == "nearest" else "bilinear",
        }  # fmt: skip

    def _light(self, light: Light) -> dict[str, Any]:
        mi = self.mi
        if isinstance(light, PointLight):
            return {"type": "point", "position": light.position.tolist(), "intensity": _rgb(light.intensity)}
        if isinstance(light, DirectionalLight):
            way = light.direction.tolist()
            return {"type": "directional", "direction": way, "irradiance": _rgb(light.irradiance)}
        if isinstance(light, SpotLight):
            place, along = light.position.double(), light.direction.double()
            up = [0.0, 1.0, 0.0] if abs(float(along[1])) < 0.9 else [1.0, 0.0, 0.0]
            look = mi.ScalarTransform4f().look_at(origin=place.tolist(), target=(place + along).tolist(), up=up)
            return {
                "type": "spot", "to_world": look, "intensity": _rgb(light.intensity),
                "cutoff_angle": light.outer_deg, "beam_width": light.inner_deg,
            }  # fmt: skip
        return self._rectangle(light)

    def _rectangle(self, light: RectLight) -> dict[str, Any]:
        u, v = light.edge_u.double().numpy(), light.edge_v.double().numpy()
        matrix = np.eye(4)
        matrix[:3, 0], matrix[:3, 1], matrix[:3, 2] = u / 2, v / 2, np.cross(u, v)
        matrix[:3, 3] = light.corner.double().numpy() + (u + v) / 2
        emitter = {"type": "area", "radiance": _rgb(light.radiance)}
        return {"type": "rectangle", "to_world": self.mi.ScalarTransform4f(matrix), "emitter": emitter}


def _alpha(material: Material) -> float | Tensor | None:
    """Opacity: a number, or (H,W,3); None where all is solid."""
    if not material.blend and material.alpha_cutoff is None:
        return None
    texture = material.diffuse_texture
    if texture is None or texture.shape[-1] < 4:
        return material.opacity if material.blend else float(material.opacity >= (material.alpha_cutoff or 0.0))
    alpha = texture[..., 3:4] * material.opacity
    if material.alpha_cutoff is not None:
        alpha = (alpha >= material.alpha_cutoff).float()
    return alpha.expand(-1, -1, 3)


def _packed(picture: Tensor) -> np.ndarray:
    return np.ascontiguousarray(picture.detach().float().numpy())


def _rgb(value: Tensor) -> dict[str, Any]:
    return {"type": "rgb", "value": [float(v) for v in value]}


def _write_ply(file: Path, mesh: Mesh) -> None:
    columns = [mesh.vertices.float()]
    names = ["x", "y", "z"]
    if mesh.normals is not None:
        columns.append(mesh.normals.float())
        names += ["nx", "ny", "nz"]
    if mesh.uv is not None:
        columns.append(mesh.uv.float())
        names += ["u", "v"]
    if mesh.colors is not None:
        columns.append(mesh.colors.float())
        names += ["r", "g", "b"]
    vertices = np.ascontiguousarray(torch.cat(columns, dim=1).numpy().astype("<f4"))
    faces = np.empty(len(mesh.faces), [("n", "u1"), ("v", "<i4", 3)])
    faces["n"] = 3
    faces["v"] = mesh.faces.numpy()
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    head += [f"property float {name}" for name in names]
    head += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""]
    file.write_bytes("\n".join(head).encode() + vertices.tobytes() + faces.tobytes())
