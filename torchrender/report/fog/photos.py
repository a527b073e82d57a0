"""Photos that the study puts fog into, and what is measured on them."""

from __future__ import annotations

import os
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from torchrender.errors import TorchRenderError
from torchrender.images.files import read_image
from torchrender.photo.fog import FogMedium, FogOptions, FogPhoto, FogPicture, Marks
from torchrender.photo.fog.depth.labels import depth_from_labels, label_map, outdoor_camera
from torchrender.photo.fog.depth.measured import (
    dense_from_points,
    depth_from_points,
    depth_from_stereo,
    read_depth,
    read_lidar,
)
from torchrender.photo.fog.estimate import estimate_haze
from torchrender.photo.fog.marks.records import CameraMark, LampMark, OutdoorMark, RegionMark, RoomMark, WindowMark
from torchrender.photo.fog.options import CONTRAST

KITTI = CameraMark(focal=721.5, center=(609.6, 172.9), height=1.65)
ROAD = (  # ground everywhere below
    RegionMark(label="vertical", polygon=((0, 0), (1242, 0), (1242, 186), (0, 186))),
    RegionMark(label="vertical", polygon=((0, 0), (260, 0), (260, 195), (0, 205)), depth=30.0),
    RegionMark(label="vertical", polygon=((260, 0), (500, 0), (500, 190), (260, 190)), depth=45.0),
    RegionMark(label="vertical", polygon=((740, 0), (900, 0), (900, 200), (740, 192)), depth=35.0),
    RegionMark(label="vertical", polygon=((900, 0), (1050, 0), (1050, 215), (900, 200)), depth=22.0),
    RegionMark(label="vertical", polygon=((1050, 0), (1242, 0), (1242, 235), (1050, 215)), depth=15.0),
)
STREET = (  # no sky: it is found
    RegionMark(label="vertical", polygon=((0, 0), (751, 0), (751, 360), (0, 360)), depth=60.0),
    RegionMark(label="vertical", polygon=((250, 180), (400, 150), (400, 355), (250, 355)), depth=35.0),
    RegionMark(label="vertical", polygon=((0, 0), (220, 60), (226, 365), (100, 385), (0, 415)), depth=14.0),
    RegionMark(label="vertical", polygon=((470, 0), (751, 0), (751, 400), (470, 375)), depth=22.0),
    RegionMark(label="vertical", polygon=((535, 320), (751, 320), (751, 470), (535, 390)), depth=8.0),
    RegionMark(label="vertical", polygon=((470, 225), (535, 225), (535, 375), (470, 365)), depth=13.0),
)
ROOM = Marks(
    width=640, height=480, camera=CameraMark(focal=525.0, height=0.44),
    room=RoomMark(corners={"back_left_floor": (260, 329), "back_right_floor": (900, 366),
                           "front_left_floor": (-200, 508),
                           "back_left_ceiling": (258, -270)}),
    windows=(WindowMark(polygon=((0, -100), (178, -60), (178, 362), (0, 430)),
                        lit=((360, 600), (420, 395), (250, 340), (20, 470)), wall="left"),),
)  # fmt: skip
LAMPS = (
    LampMark(at=(417, 100), distance=22, color=(1.0, 0.82, 0.55), strength=3.0),
    LampMark(at=(466, 209), distance=14, kind="cone", direction=(-0.2, -0.3, 1.0), strength=0.8),
    LampMark(at=(291, 211), distance=28, color=(1.0, 0.2, 0.1)),
    LampMark(at=(340, 213), distance=24, color=(1.0, 0.2, 0.1)),
)  # fmt: skip
AVENUE = (  # no sky: it is found
    RegionMark(label="vertical", polygon=((0, 0), (600, 0), (600, 214), (0, 214)), depth=110.0),
    RegionMark(label="vertical", polygon=((465, 0), (600, 0), (600, 280), (465, 215)), depth=18.0),
    RegionMark(label="vertical", polygon=((0, 140), (60, 140), (60, 226), (0, 226)), depth=35.0),
)


@dataclass(frozen=True, eq=False)
class Subject:
    """A photo with what tells its depth."""

    name: str
    source: str  # what its depth comes from
    photo: Tensor
    marks: Marks
    medium: FogMedium
    depth: Tensor | None = None
    options: FogOptions = field(default_factory=FogOptions)


def data_folder() -> Path:
    """Where photos are looked for."""
    return Path(os.environ.get("TORCHRENDER_DATA", "../shared/data"))


def subjects() -> list[Subject]:
    """All photos whose files are there."""
    folder = data_folder()
    made = []
    for make in (_street, _road, _lamps, _room, _room_depth, _stereo):
        try:
            made.append(make(folder))
        except TorchRenderError as error:
            warnings.warn(f"left out: {error}", stacklevel=2)
    return made


def _street(folder: Path) -> Subject:
    photo = read_image(folder / "photos" / "leuvenA.jpg")
    marks = Marks(camera=CameraMark(horizon=335.0), regions=STREET)
    return Subject("street", "labels", photo, marks, FogMedium.of(visibility=80.0))


def _lidar(folder: Path) -> tuple[Tensor, Tensor, Tensor]:
    kitti = folder / "fog" / "kitti"
    photo = read_image(kitti / "image_2" / "000001.png")
    points, projection = read_lidar(kitti / "velodyne" / "000001.bin", kitti / "calib" / "000001.txt")
    sparse = depth_from_points(points, projection, photo.shape[1], photo.shape[0])
    return photo, sparse, dense_from_points(sparse)


def _road(folder: Path) -> Subject:
    photo, _, dense = _lidar(folder)
    return Subject("road", "LiDAR", photo, Marks(camera=KITTI), FogMedium.of(visibility=100.0), dense)


def _lamps(folder: Path) -> Subject:
    photo = read_image(folder / "fog" / "waymo_tr01-22-14-1-FRONT.jpg")
    marks = Marks(camera=CameraMark(horizon=205.0, height=1.9), regions=AVENUE, lamps=LAMPS,
                  outdoor=OutdoorMark(far=150.0))  # fmt: skip
    return Subject("lamps", "labels", photo, marks, FogMedium.of(visibility=150.0, asymmetry=0.5))


def _room(folder: Path) -> Subject:
    photo = read_image(folder / "rgbd" / "livingroom1" / "color" / "00000.jpg")
    medium = FogMedium.of(scattering=0.25, asymmetry=0.3)
    return Subject("room with a shaft", "room box", photo, ROOM, medium, options=FogOptions(shaft_gain=2.0))


def _room_depth(folder: Path) -> Subject:
    base = _room(folder)
    depth = read_depth(folder / "rgbd" / "livingroom1" / "depth" / "00000.png")
    return Subject("the same, RGB-D", "RGB-D", base.photo, ROOM, base.medium, depth, base.options)


def _stereo(folder: Path) -> Subject:
    left, right = (read_image(folder / "photos" / f"motorcycle_{side}.png") for side in ("left", "right"))
    depth = depth_from_stereo(left, right, focal=994.978, baseline=0.193001, offset=31.086)
    return Subject("motorcycle", "stereo", left, Marks(camera=CameraMark(focal=994.978)),
                   FogMedium.of(scattering=0.3), depth)  # fmt: skip


def foggy(subject: Subject) -> tuple[FogPicture, dict[str, Any]]:
    """The picture, and times of the first medium and of another."""
    begin, cpu_begin = time.perf_counter(), time.process_time()
    photo = FogPhoto(subject.photo, subject.marks, subject.options, depth=subject.depth)
    picture = photo.foggy(subject.medium)
    middle, cpu_middle = time.perf_counter(), time.process_time()
    photo.foggy(FogMedium.of(scattering=subject.medium.scattering * 1.3, asymmetry=subject.medium.asymmetry))
    return picture, {
        "name": subject.name, "depth": subject.source, "size": f"{subject.photo.shape[1]}x{subject.photo.shape[0]}",
        "first_ms": 1e3 * (middle - begin), "again_ms": 1e3 * (time.perf_counter() - middle),
        "first_cpu_ms": 1e3 * (cpu_middle - cpu_begin), "again_cpu_ms": 1e3 * (time.process_time() - cpu_middle),
        "T": float(picture.transmittance.mean()), "V": float(picture.scattered.mean()),
    }  # fmt: skip


def labels_beside_lidar(visibility: float = 100.0) -> dict[str, float]:
    """Mean difference of T to the eye by labels and by LiDAR, where the scanner has points."""
    photo, sparse, _ = _lidar(data_folder())
    h, w = photo.shape[:2]
    marks = Marks(camera=KITTI, regions=ROAD)
    camera = outdoor_camera(marks, w, h)
    labelled = depth_from_labels(label_map(marks, w, h), marks, camera)
    known = torch.isfinite(sparse)
    stretch = camera.rays()[1][0].norm(dim=-1)
    kappa = CONTRAST / visibility
    own, true = (torch.exp(-kappa * d.double() * stretch) for d in (labelled.depth, sparse))
    return {"mean": float((own - true).abs()[known].mean()), "points": int(known.sum())}


def recovered(subject: Subject, visibilities: tuple[float, ...] = (60.0, 150.0, 400.0)) -> list[dict[str, float]]:
    """Extinction and airlight that are found again in composites of a photo."""
    rows = []
    for visibility in visibilities:
        photo = FogPhoto(subject.photo, subject.marks, FogOptions(loss="none"), depth=subject.depth)
        scene = photo.outdoors
        assert scene is not None
        picture = photo.foggy(FogMedium.of(visibility=visibility))
        haze = estimate_haze(picture.composite[..., :3], scene.length, sky=scene.sky > 0)
        airlight = scene.light.sky / 2
        rows.append({
            "visibility": visibility, "kappa": CONTRAST / visibility, "found": haze.extinction,
            "kappa_error": abs(haze.extinction * visibility / CONTRAST - 1),
            "airlight_error": float((haze.airlight / airlight - 1).abs().max()),
        })  # fmt: skip
    return rows


def fade_measure() -> Callable[[Tensor], float] | None:
    """Fog density FADE of an encoded picture (H,W,3) in [0,1], by the package fade-python; None if it is not there."""
    try:
        fade_array = import_module("pyfade").fade_array
    except ImportError:
        return None

    def measure(picture: Tensor) -> float:
        result = fade_array((picture.clamp(0.0, 1.0) * 255).round().byte().numpy())
        return float(result[0] if isinstance(result, tuple) else getattr(result, "fade", result))

    return measure
