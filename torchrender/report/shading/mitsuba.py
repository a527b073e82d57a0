"""Balls of each material under each light beside Mitsuba, where it is installed.

Mitsuba's materials are other formulae: exact Fresnel terms in place of Schlick's, one bounce between microfacets, light
that turns back within a varnish. What of that our model adds by purpose is taken out where it can be, and said.
"""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchrender.images.files import read_image
from torchrender.numerics.split_sum import directional_albedo
from torchrender.quality.metrics import psnr
from torchrender.raster import rasterize
from torchrender.scene.camera import Cameras
from torchrender.scene.environment import Environment
from torchrender.scene.light import DirectionalLight, Light, PointLight, RectLight
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.scene.shapes import sphere
from torchrender.shade import shade

STEPS = 64
"""Directions that an albedo is the mean over."""
SKY_SAMPLES = 4
"""Times as many under environments, whose lamps are small."""
HALVED = 20.0 * math.log10(2.0)
"""Decibels by which the mean of two pictures has less noise than their difference."""
SIDE, FINER = 64, 4
"""Pixels a side, and how many of ours fall on each of them."""

GOLD = {"eta": (0.143, 0.375, 1.442), "k": (3.983, 2.386, 1.603)}
IOR = 1.5
TRIED = (0.4, 0.8)
"""Base colours within a varnish that tell how much of its diffuse light turns back."""


@dataclass(frozen=True)
class Ball:
    """One material in both programs."""

    name: str
    ours: Material
    theirs: Mapping[str, Any]
    base: float | None = None  # colour that a varnished one shows from outside

    @property
    def is_smooth(self) -> bool:
        """Mirrors like polished glass."""
        return self.ours.metallic is not None and self.ours.roughness == 0.0


def balls() -> tuple[Ball, ...]:
    """Metals, plastics and a plain matt one."""
    n, k = (np.array(GOLD[name]) for name in ("eta", "k"))
    gold = torch.tensor(((n - 1) ** 2 + k**2) / ((n + 1) ** 2 + k**2), dtype=torch.float32)
    made = [Ball("matt", _material(metallic=None, diffuse=0.6), _of("diffuse", reflectance=_rgb(0.6)))]
    for roughness in (0.2, 0.4, 0.6):
        ggx = {"distribution": "ggx", "alpha": roughness**2}
        metal = _of("roughconductor", eta=_rgb(*GOLD["eta"]), k=_rgb(*GOLD["k"]), **ggx)
        made.append(
            Ball(f"rough conductor, {roughness:g}", Material(metallic=1.0, roughness=roughness, diffuse=gold), metal)
        )
    for roughness in (0.2, 0.4):
        for base in (0.0, 0.5):
            ggx = {"distribution": "ggx", "alpha": roughness**2}
            varnish = _of(
                "roughplastic", diffuse_reflectance=_rgb(0.0), int_ior=IOR, ext_ior=1.0, nonlinear=True, **ggx
            )
            name = f"rough plastic, {roughness:g}, {'black' if base == 0 else 'grey'}"
            made.append(Ball(name, _material(metallic=0.0, roughness=roughness, diffuse=base), varnish, base or None))
    smooth = _of("plastic", diffuse_reflectance=_rgb(0.0), int_ior=IOR, ext_ior=1.0)
    made.append(Ball("dielectric, smooth", _material(metallic=0.0, roughness=0.0, diffuse=0.0), smooth))
    return tuple(made)


def lights(sky: Tensor | None) -> dict[str, tuple[Light | Environment, dict[str, Any]]]:
    """Lights in both programs; ``sky`` (H,W,3): an environment."""
    at, power = (3.0, 4.0, 5.0), (40.0, 50.0, 60.0)
    made: dict[str, tuple[Light | Environment, dict[str, Any]]] = {
        "point": (
            PointLight(position=torch.tensor(at), intensity=torch.tensor(power)),
            {"type": "point", "position": list(at), "intensity": _rgb(*power)},
        ),
        "parallel": (
            DirectionalLight(direction=torch.tensor((-1.0, -2.0, -2.0)), irradiance=torch.full((3,), 2.0)),
            {"type": "directional", "direction": [-1.0, -2.0, -2.0], "irradiance": _rgb(2.0)},
        ),
        "area": (
            RectLight(
                corner=torch.tensor((2.0, 2.0, 2.0)), edge_u=torch.tensor((-1.0, 1.0, 1.0)),
                edge_v=torch.tensor((0.0, 1.0, -1.0)), radiance=torch.full((3,), 6.0),
            ),
            {},
        ),
    }  # fmt: skip
    made["area"] = (made["area"][0], _rectangle(made["area"][0]))
    if sky is not None:
        made["environment"] = (Environment(radiance=sky), {"type": "envmap", "pixels": sky.numpy()})
    return made


def beside_mitsuba(folder: Path | None, samples: int, names: tuple[str, ...] = ()) -> dict[str, Any]:
    """Mean ratio and PSNR of each ball under each light; ``folder``: of environment maps; ``names``: balls, () all."""
    if importlib.util.find_spec("mitsuba") is None:
        return {"missing": "Mitsuba is not installed (`pip install mitsuba`): not compared"}
    import mitsuba as mi

    mi.set_variant("scalar_rgb")  # the other variants bring a compiler that does not get on with ours
    mi.set_log_level(mi.LogLevel.Error)
    sky = None if folder is None else read_image(folder / "museum.exr")[..., :3].contiguous()
    rows = []
    for ball in (_varnished(mi, one) for one in balls()):
        for light, (ours, theirs) in lights(sky).items():
            if (names and ball.name not in names) or (ball.is_smooth and light != "environment"):
                continue  # a mirror shows no points
            few = light in ("point", "parallel")  # next to no noise
            count = max(samples // 16, 4) if few else (samples * SKY_SAMPLES if light == "environment" else samples)
            halves = [_theirs(mi, ball, theirs, count // 2, seed) for seed in (1, 2)]
            wanted = (halves[0] + halves[1]) / 2.0
            found, once, inside = _ours(ball, ours)
            rows.append({"ball": ball.name, "light": light, **_compared(found, wanted, inside)})
            rows[-1]["noise"] = _compared(halves[0], halves[1], inside)["psnr"] + HALVED
            rows[-1]["once"] = _compared(once, wanted, inside)
    return {"version": mi.__version__, "samples": samples, "rows": rows}


def _varnished(mi: Any, ball: Ball) -> Ball:
    """The same ball with the colour below Mitsuba's varnish that shows the wanted one from outside, along the normal.

    There the light that leaves is ``K w / (1 - F w)`` of the colour ``w``: two colours tell ``K``, and the share ``F``
    that turns back, which depends on roughness.
    """
    if ball.base is None:
        return ball
    dark = _albedo(mi, ball.theirs)
    first, second = (_albedo(mi, {**ball.theirs, "diffuse_reflectance": _rgb(w)}) - dark for w in TRIED)
    ratio = first / second * TRIED[1] / TRIED[0]
    back = (1.0 - ratio) / (TRIED[1] - TRIED[0] * ratio)
    through = first * (1.0 - back * TRIED[0]) / TRIED[0]
    wanted = ball.base * (1.0 - ((IOR - 1.0) / (IOR + 1.0)) ** 2)
    return replace(ball, theirs={**ball.theirs, "diffuse_reflectance": _rgb(wanted / (through + wanted * back))})


def _albedo(mi: Any, material: Mapping[str, Any]) -> float:
    """Share of even light that a material sends along its normal; exact for what varies slowly with direction."""
    bsdf, seen = mi.load_dict(dict(material)), mi.SurfaceInteraction3f()
    seen.wi = mi.ScalarVector3f(0.0, 0.0, 1.0)
    total = 0.0
    for k in range(STEPS):
        cosine = math.sqrt((k + 0.5) / STEPS)  # as many steps where the cosine weighs more
        toward = mi.ScalarVector3f(math.sqrt(1.0 - cosine * cosine), 0.0, cosine)
        total += bsdf.eval(mi.BSDFContext(), seen, toward)[0] / cosine
    return total * math.pi / STEPS


def _material(diffuse: float, **more: Any) -> Material:
    return Material(diffuse=torch.full((3,), diffuse), ior=IOR, **more)


def _rgb(*value: float) -> dict[str, Any]:
    return {"type": "rgb", "value": list(value) if len(value) > 1 else [value[0]] * 3}


def _of(kind: str, **rest: Any) -> dict[str, Any]:
    return {"type": kind, **rest}


def _compared(found: Tensor, wanted: Tensor, inside: Tensor) -> dict[str, float]:
    """Ratio of means over the ball, PSNR against the brightest pixel."""
    a, b = found[inside], wanted[inside]
    peak = float(b.max())
    return {
        "ratio": float(a.mean() / b.mean()),
        "psnr": float(psnr(found[None], wanted[None], mask=inside[None], peak=peak)),
        "mean": float(b.mean()),
    }


def _ours(ball: Ball, light: Light | Environment) -> tuple[Tensor, Tensor, Tensor]:
    """Radiance (S,S,3), the same with one bounce between microfacets, and pixels that lie wholly on the ball."""
    scene = Scene(meshes=(smooth_ball(),), materials=(ball.ours,))
    if isinstance(light, Environment):
        scene = replace(scene, environment=light)
    else:
        scene = replace(scene, lights=(light,))
    camera = Cameras.look_at([0.0, 0.0, 6.0], [0.0, 0.0, 0.0], width=SIDE * FINER, height=SIDE * FINER, fov_deg=20.0)
    gbuffer = rasterize(scene, camera)
    image = shade(scene, gbuffer, background=(0.0, 0.0, 0.0))[0]
    once = image
    if ball.ours.metallic == 1.0:
        toward = torch.nn.functional.normalize(camera.eye[0] - gbuffer.position[0], dim=-1).float()
        facing = (gbuffer.normal[0] * toward).sum(-1).clamp(1e-4, 1.0)
        a, b, _, _ = directional_albedo(facing, torch.full_like(facing, ball.ours.roughness))
        once = image / (1.0 + ball.ours.diffuse * (1.0 / (a + b) - 1.0)[..., None])
        once = torch.where(gbuffer.covered[0][..., None], once, 0.0)
    return _coarse(image), _coarse(once), _coarse(gbuffer.covered[0].float()[..., None])[..., 0] > 0.999


@cache
def smooth_ball() -> Mesh:
    """A ball of radius one with exact normals."""
    fine = sphere(segments=256)
    return replace(fine, normals=torch.nn.functional.normalize(fine.vertices, dim=-1))


def _coarse(image: Tensor) -> Tensor:
    return image.reshape(SIDE, FINER, SIDE, FINER, -1).mean(dim=(1, 3))


def _theirs(mi: Any, ball: Ball, light: dict[str, Any], samples: int, seed: int = 1) -> Tensor:
    light = dict(light)
    if "pixels" in light:
        turn = mi.ScalarTransform4f().rotate([0, 1, 0], 180)  # the middle column looks along -z here
        light = {"type": "envmap", "bitmap": mi.Bitmap(light["pixels"]), "to_world": turn}

    if "matrix" in light:
        light["to_world"] = mi.ScalarTransform4f(light.pop("matrix"))
    film = {"type": "hdrfilm", "width": SIDE, "height": SIDE, "rfilter": {"type": "box"}, "pixel_format": "rgb"}
    look = mi.ScalarTransform4f().look_at(origin=[0, 0, 6], target=[0, 0, 0], up=[0, 1, 0])
    sensor = {"type": "perspective", "fov": 20.0, "fov_axis": "y", "to_world": look, "film": film}
    world = {
        "type": "scene", "integrator": {"type": "direct", "hide_emitters": True}, "sensor": sensor,
        "ball": {"type": "sphere", "bsdf": dict(ball.theirs)}, "light": light,
    }  # fmt: skip
    image = np.array(mi.render(mi.load_dict(world), spp=samples, seed=seed))
    return torch.from_numpy(image[..., :3].astype(np.float32))


def _rectangle(light: Light | Environment) -> dict[str, Any]:
    assert isinstance(light, RectLight)
    u, v = light.edge_u.double().numpy(), light.edge_v.double().numpy()
    matrix = np.eye(4)
    across = np.cross(u, v)
    matrix[:3, 0], matrix[:3, 1], matrix[:3, 2] = u / 2, v / 2, across / math.sqrt(across @ across)
    matrix[:3, 3] = light.corner.numpy() + (u + v) / 2
    emitter = {"type": "area", "radiance": _rgb(*light.radiance.tolist())}
    return {"type": "rectangle", "matrix": matrix, "emitter": emitter}
