"""Walkthroughs in files: a zip of arrays and textures with a version, ``.trw``."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch

from torchrender.checks import check_class
from torchrender.errors import SceneFileError, TorchRenderError
from torchrender.images.files import write_atomically
from torchrender.scene.camera import Cameras
from torchrender.walkthrough.frames.record import Array
from torchrender.walkthrough.model import PlanePatch, PointModel, Walkthrough, no_points
from torchrender.walkthrough.view_colors import ViewColors

SUFFIX = ".trw"
FORMAT, VERSION = "torchrender walkthrough", 1
MAX_BYTES = 2**33
"""Of all members together, as they declare it."""

MAX_HEADER = 2**24
MAX_TEXELS = 2**28
_VIEW = {"residual": (np.int8, 4), "inverse_depth": (np.uint16, 3), "unit": (np.float64, 1), "lens": (np.float64, 2),
         "pose": (np.float64, 3)}  # fmt: skip
_POINTS = {"position": 3, "normal": 3, "color": 3, "log_density": 0, "object_id": 0}
_TYPES = {
    "position": np.float32,
    "normal": np.int8,
    "color": np.uint8,
    "log_density": np.float32,
    "object_id": np.int32,
}


def write_walkthrough(path: str | Path, walkthrough: Walkthrough) -> int:
    """Write a ``.trw`` file, whole or not at all; returns its bytes. Positions are kept as float32 about their middle,
    normals as 8-bit numbers, textures as lossless PNG.

    Raises:
        SceneFileError: another suffix, or the file cannot be written.
    """
    check_class("path", path, str, Path)
    path = Path(path)
    if path.suffix.lower() != SUFFIX:
        raise SceneFileError(path, f"walkthroughs are written to {SUFFIX}")

    def write(temporary: Path) -> None:
        with zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED, compresslevel=4) as archive:
            archive.writestr("header.json", json.dumps(_header(walkthrough)))
            for name, value in _arrays(walkthrough).items():
                with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                    np.lib.format.write_array(member, np.ascontiguousarray(value), allow_pickle=False)
            for n, patch in enumerate(walkthrough.planes):
                flags = [cv2.IMWRITE_PNG_COMPRESSION, 4]
                data = cv2.imencode(".png", np.ascontiguousarray(patch.texture[..., [2, 1, 0, 3]]), flags)[1]
                archive.writestr(zipfile.ZipInfo(f"texture{n}.png"), data.tobytes())

    write_atomically(path, write)
    return path.stat().st_size


def _header(walkthrough: Walkthrough) -> dict[str, Any]:
    camera = walkthrough.cameras
    return {
        "format": FORMAT,
        "version": VERSION,
        "name": walkthrough.name,
        "report": dict(walkthrough.report),
        "world_from_input": walkthrough.world_from_input.tolist(),
        "view_colors": walkthrough.view_colors is not None,
        "camera_size": None if camera is None else [camera.width, camera.height],
        "planes": [
            {
                "plane": p.plane,
                "step": p.step,
                "raw_corners": p.raw_corners,
                "size": list(p.texture.shape[:2]),
                "frame": np.stack([p.normal, p.origin, p.across, p.down]).tolist(),
                "solid": p.solid.tolist(),
                "corners": p.corners.tolist(),
                "triangles": p.triangles.tolist(),
            }
            for p in walkthrough.planes
        ],
    }


def _arrays(walkthrough: Walkthrough) -> dict[str, Array]:
    p = walkthrough.points
    origin = 0.5 * (p.position.min(0) + p.position.max(0)) if len(p) else np.zeros(3)
    found: dict[str, Array] = {
        "origin": origin,
        "position": (p.position - origin).astype(np.float32),
        "normal": np.rint(p.normal * 127).astype(np.int8),
        "color": p.color,
        "log_density": p.log_density,
        "object_id": p.object_id,
        "nodes": p.nodes,
        "links": p.links,
        "roots": p.roots,
    }
    if walkthrough.view_colors is not None:
        found |= {f"view_{n}": getattr(walkthrough.view_colors, n) for n in _VIEW}
    if walkthrough.cameras is not None:
        found["camera_pose"] = walkthrough.cameras.camera_from_world.numpy()
        found["camera_lens"] = walkthrough.cameras.intrinsics.numpy()
        found["camera_near"] = walkthrough.cameras.near.numpy()
    return found


def read_walkthrough(path: str | Path) -> Walkthrough:
    """Read a ``.trw`` file.

    Raises:
        SceneFileError: missing, damaged, of another version, or larger than it may be; says what is wrong.
    """
    check_class("path", path, str, Path)
    path = Path(path)
    if not path.is_file():
        raise SceneFileError(path, "no such file")
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            total = sum(m.file_size for m in members)
            if total > MAX_BYTES or len(members) > 200_000:
                raise SceneFileError(path, f"declares {total} bytes in {len(members)} parts, the limit is {MAX_BYTES}")
            return _read(path, archive)
    except TorchRenderError as error:
        raise error if isinstance(error, SceneFileError) else SceneFileError(path, str(error)) from error
    except (zipfile.BadZipFile, OSError, EOFError, NotImplementedError, RuntimeError) as error:
        raise SceneFileError(path, f"damaged or no walkthrough ({error})") from error
    except (
        ValueError,
        KeyError,
        TypeError,
        IndexError,
        AttributeError,
        OverflowError,
        RecursionError,
        MemoryError,
    ) as error:
        raise SceneFileError(path, f"damaged ({type(error).__name__}: {error})") from error
    except Exception as error:
        if type(error).__module__ in ("zlib", "cv2", "cv2.error"):
            raise SceneFileError(path, f"damaged ({error})") from error
        raise


def _read(path: Path, archive: zipfile.ZipFile) -> Walkthrough:
    if archive.getinfo("header.json").file_size > MAX_HEADER:
        raise SceneFileError(path, "its header is too large")
    header = json.loads(archive.read("header.json"))
    if header.get("format") != FORMAT:
        raise SceneFileError(path, "is no walkthrough")
    if header.get("version") != VERSION:
        raise SceneFileError(path, f"has version {header.get('version')!r}, this program reads {VERSION}")
    planes = tuple(_plane(path, archive, n, entry) for n, entry in enumerate(header["planes"]))
    points = _points(path, archive)
    cameras = None
    if header["camera_size"] is not None:
        width, height = (int(v) for v in header["camera_size"])
        pose, lens, near = (_array(path, archive, f"camera_{n}") for n in ("pose", "lens", "near"))
        cameras = Cameras(
            torch.from_numpy(pose),
            torch.from_numpy(lens),
            width,
            height,
            torch.from_numpy(near),
            torch.full((len(pose),), torch.inf, dtype=torch.float64),
        )
    colors = _view_colors(path, archive) if header["view_colors"] else None
    world = torch.tensor(header["world_from_input"], dtype=torch.float64)
    if world.shape != (4, 4) or not bool(torch.isfinite(world).all()) or not isinstance(header["report"], dict):
        raise SceneFileError(path, "damaged header")
    name = str(header["name"])
    return Walkthrough(
        planes=planes,
        points=points,
        cameras=cameras,
        view_colors=colors,
        world_from_input=world,
        report=header["report"],
        name=name,
    )


def _view_colors(path: Path, archive: zipfile.ZipFile) -> ViewColors:
    found = {n: _array(path, archive, f"view_{n}") for n in _VIEW}
    for name, (kind, dims) in _VIEW.items():
        value = found[name]
        if value.dtype != kind or value.ndim != dims or not np.isfinite(value).all():
            raise SceneFileError(path, f"has {value.dtype} {value.shape}", key=f"view_{name}")
    n, h, w = found["inverse_depth"].shape
    wanted = {"residual": (n, h, w, 3), "unit": (n,), "lens": (n, 4), "pose": (n, 4, 4)}
    if not n or any(found[name].shape != shape for name, shape in wanted.items()):
        raise SceneFileError(path, "shapes do not fit one another", key="view_residual")
    if np.abs(np.linalg.det(found["pose"])).min() < 1e-6:
        raise SceneFileError(path, "poses cannot be inverted", key="view_pose")
    return ViewColors(**found)


def _plane(path: Path, archive: zipfile.ZipFile, number: int, entry: dict[str, Any]) -> PlanePatch:
    key = f"planes[{number}]"
    height, width = (int(v) for v in entry["size"])
    if not 0 < height * width <= MAX_TEXELS or height < 1 or height > 2**15 or width > 2**15:
        raise SceneFileError(path, f"a texture of {width}x{height}", key=key)
    data = archive.read(f"texture{number}.png")
    # The size that the picture itself declares, before it is decoded.
    if len(data) < 26 or data[:4] != b"\x89PNG" or (
        int.from_bytes(data[16:20], "big"), int.from_bytes(data[20:24], "big")) != (width, height):  # fmt: skip
        raise SceneFileError(path, "its texture has another size", key=key)
    codes = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if codes is None or codes.dtype != np.uint8 or codes.shape != (height, width, 4):
        raise SceneFileError(path, "its texture is damaged", key=key)
    frame = _finite(path, key, np.array(entry["frame"], np.float64), (4, 3))
    corners = _finite(path, key, np.array(entry["corners"], np.float64).reshape(-1, 2), None)
    triangles = np.array(entry["triangles"], np.int64).reshape(-1, 3)
    step = float(entry["step"])
    if triangles.size and not 0 <= triangles.min() <= triangles.max() < len(corners):
        raise SceneFileError(path, "triangles name corners that do not exist", key=key)
    axes = frame[[0, 2, 3]]
    if not 0 < step < 1e30 or np.abs(axes @ axes.T - np.eye(3)).max() > 1e-6:
        raise SceneFileError(path, "its axes are not orthonormal", key=key)
    return PlanePatch(
        normal=frame[0],
        origin=frame[1],
        across=frame[2],
        down=frame[3],
        step=step,
        plane=int(entry["plane"]),
        texture=np.ascontiguousarray(codes[..., [2, 1, 0, 3]]),
        corners=corners,
        triangles=triangles,
        raw_corners=int(entry["raw_corners"]),
        solid=_finite(path, key, np.array(entry["solid"], np.float64), (4,)),
    )


def _finite(path: Path, key: str, value: Array, shape: tuple[int, ...] | None) -> Array:
    if (shape is not None and value.shape != shape) or not np.isfinite(value).all():
        raise SceneFileError(path, "numbers are missing or not finite", key=key)
    return value


def _array(path: Path, archive: zipfile.ZipFile, name: str) -> Array:
    info = archive.getinfo(f"{name}.npy")
    with archive.open(info) as member:
        version = np.lib.format.read_magic(member)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = read(member)
    if dtype.hasobject or int(np.prod(shape, dtype=np.float64)) * dtype.itemsize > info.file_size:
        raise SceneFileError(path, "declares more than it holds", key=name)
    with archive.open(info) as member:
        return np.asarray(np.lib.format.read_array(member, allow_pickle=False))


def _points(path: Path, archive: zipfile.ZipFile) -> PointModel:
    found: dict[str, Array] = {}
    for name, width in _POINTS.items():
        value = _array(path, archive, name)
        if value.dtype != _TYPES[name] or value.ndim != (2 if width else 1) or (width and value.shape[1] != width):
            raise SceneFileError(path, f"has {value.dtype} {value.shape}", key=name)
        if len(value) != len(found.get("position", value)) or not np.isfinite(value).all():
            raise SceneFileError(path, "is incomplete or not finite", key=name)
        found[name] = value
    count = len(found["position"])
    if not count:
        return no_points()
    nodes, links, roots = (_array(path, archive, n) for n in ("nodes", "links", "roots"))
    nodes, links, roots = nodes.astype(np.float64), links.astype(np.int64), roots.astype(np.int64)
    _check_tree(path, nodes, links, roots, count)
    origin = _finite(path, "origin", _array(path, archive, "origin").astype(np.float64), (3,))
    normal = found["normal"].astype(np.float32)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-6)
    return PointModel(
        position=found["position"].astype(np.float64) + origin,
        normal=normal,
        color=found["color"],
        log_density=found["log_density"],
        object_id=found["object_id"],
        nodes=nodes,
        links=links,
        roots=roots,
    )


def _check_tree(path: Path, nodes: Array, links: Array, roots: Array, count: int) -> None:
    """Children stand behind their parents, so that walks end; runs lie within the points."""
    if nodes.ndim != 2 or nodes.shape[1] != 15 or links.shape != (len(nodes), 4) or roots.ndim != 1:
        raise SceneFileError(path, "the tree has a wrong shape", key="nodes")
    inner = links[:, 2] != links[:, 3]
    own = np.arange(len(nodes))
    good = (links[:, 0] >= 0) & (links[:, 0] <= links[:, 1]) & (links[:, 1] <= count)
    good &= ~inner | ((links[:, 2] > own) & (links[:, 3] == links[:, 2] + 2) & (links[:, 3] <= len(nodes)))
    children = np.concatenate([links[inner, 2], links[inner, 2] + 1, roots])
    once = len(children) == len(np.unique(children)) == len(nodes) and bool(good.all())
    if not once or not np.isfinite(nodes).all() or children.min() < 0 or children.max() >= len(nodes):
        raise SceneFileError(path, "the tree does not hold together", key="links")
