"""Whole files of every kind that is read, small enough that every byte counts."""

from __future__ import annotations

import io
import json
import struct
from typing import Any

import numpy as np
from PIL import Image

from torchrender.report.fuzz.coded import coded

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)


def seeds() -> dict[str, tuple[str, bytes]]:
    """Suffix and content of each file, by name."""
    found = {
        "glb": (".glb", glb(_plain())),
        "glb moving": (".glb", glb(_moving())),
        "gltf": (".gltf", _gltf()),
        "obj": (".obj", OBJ),
        "mtl": (".mtl", MTL),
        "ply text": (".ply", _ply("ascii")),
        "ply little": (".ply", _ply("binary_little_endian")),
        "ply big": (".ply", _ply("binary_big_endian")),
        "ply mixed": (".ply", _mixed()),
        "ply gaussian": (".ply", _gaussians()),
        "stl text": (".stl", STL),
        "stl binary": (".stl", b" " * 80 + struct.pack("<I", 2) + _facet(0) + _facet(0x801F)),
        "toml": (".toml", TOML),
        "png": (".png", picture("PNG")),
        "jpg": (".jpg", picture("JPEG")),
        "webp": (".webp", picture("WEBP")),
        "bmp": (".bmp", picture("BMP")),
        "tga": (".tga", picture("TGA")),
        "hdr": (".hdr", _radiance()),
    }
    return found | _compressed() | coded()


OBJ = (
    b"mtllib a.mtl\no left\nv 0 0 0\nv 1 0 0 0.5 0.5 1\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 1\nvn 0 0 1\nusemtl red\ns 1\n"
    b"f 1/1/1 2/2/1 3/1/1 4/2/1\ng b\ns off\nf -4//-1 -3//-1 \\\n-2//-1\nl 1 2\n"
)
MTL = (
    b"newmtl red\nKd 0.8 0.1 0\nKs 0.5 0.5 0.5\nNs 98\nillum 2\nd 0.5\nmap_Kd -s 2 2 2 -o 0.1 0 0 a.png\n"
    b"bump -bm 0.5 a.png\n"
)
STL = (
    b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1e0 0\nendloop\nendfacet\n"
    b"endsolid a\nsolid b\nfacet normal 0 0 1\nouter loop\nvertex 0 0 1\nvertex 1 0 1\nvertex 0 1 1\nendloop\n"
    b"endfacet\n"
)
TOML = (
    b"name = 'a'\n[[geometry]]\nshape = 'box'\nsize = [1, 2, 3]\ntranslate = [1, 0, 0]\n[[material]]\nname = 'm'\n"
    b"diffuse = 0.5\n[[light]]\ntype = 'spot'\nposition = [1, 2, 3]\ntarget = [0, 0, 0]\n[environment]\ncolor = 0.5\n"
)


def picture(kind: str) -> bytes:
    """A small picture."""
    codes = np.random.default_rng(0).integers(0, 255, (6, 5, 3)).astype(np.uint8)
    file = io.BytesIO()
    Image.fromarray(codes).save(file, kind)
    return file.getvalue()


def _facet(attribute: int) -> bytes:
    return struct.pack("<12fH", 0, 0, 1, *SQUARE[:3].reshape(-1), attribute)


def _mixed() -> bytes:
    """Polygons of different sizes, and a strip, packed."""
    head = b"ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
    head += (
        b"property float z\nelement face 2\nproperty list uchar int vertex_indices\nproperty uchar flags\nend_header\n"
    )
    return head + SQUARE.tobytes() + struct.pack("<B4iBB3iB", 4, 0, 1, 2, 3, 7, 3, 0, 1, 2, 7)


def _gaussians() -> bytes:
    names = ["x", "y", "z", *(f"f_dc_{k}" for k in range(3)), "opacity"]
    names += [*(f"scale_{k}" for k in range(3)), *(f"rot_{k}" for k in range(4))]
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 4\n"
    head += "".join(f"property float {n}\n" for n in names) + "end_header\n"
    return head.encode() + np.concatenate([SQUARE, np.full((4, len(names) - 3), 0.5)], axis=1).astype("<f4").tobytes()


def _ply(order: str) -> bytes:
    mark = ">" if "big" in order else "<"
    head = f"ply\nformat {order} 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    head += "property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 2\n"
    head += "property list uchar int vertex_indices\nend_header\n"
    if order == "ascii":
        rows = "".join(f"{x} {y} {z} 255 128 0\n" for x, y, z in SQUARE) + "4 0 1 2 3\n3 0 1 2\n"
        return (head + rows).encode()
    body = b"".join(struct.pack(mark + "3f3B", *p, 255, 128, 0) for p in SQUARE)
    return head.encode() + body + struct.pack(mark + "B4i", 4, 0, 1, 2, 3) + struct.pack(mark + "B3i", 3, 0, 1, 2)


def _radiance() -> bytes:
    codes = np.random.default_rng(1).integers(0, 255, (4, 5, 4)).astype(np.uint8)
    return b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 5\n" + codes.tobytes()


class _Binary:
    """Views and accessors of a glTF file in the making."""

    def __init__(self) -> None:
        self.data = b""
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def view(self, data: bytes) -> int:
        self.views.append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)})
        self.data += data + b"\0" * (-len(data) % 4)
        return len(self.views) - 1

    def accessor(self, values: Any, kind: str, code: int = 5126, dtype: str = "<f4") -> int:
        array = np.asarray(values, dtype)
        entry = {"bufferView": self.view(array.tobytes()), "componentType": code, "count": len(array), "type": kind}
        self.accessors.append(entry)
        return len(self.accessors) - 1

    def document(self, **parts: Any) -> dict[str, Any]:
        buffers = [{"byteLength": len(self.data)}]
        return {
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "buffers": buffers,
            "bufferViews": self.views, "accessors": self.accessors, **parts,
        }  # fmt: skip


def glb(made: tuple[dict[str, Any], bytes]) -> bytes:
    """A GLB file of a document and its buffer."""
    text = json.dumps(made[0], separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    data = made[1] + b"\0" * (-len(made[1]) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(data), 0x004E4942) + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def _plain() -> tuple[dict[str, Any], bytes]:
    binary = _Binary()
    attributes = {
        "POSITION": binary.accessor(SQUARE, "VEC3"),
        "TEXCOORD_0": binary.accessor(SQUARE[:, :2], "VEC2"),
        "COLOR_0": binary.accessor(np.ones((4, 4)), "VEC4"),
    }
    primitive = {"attributes": attributes, "indices": binary.accessor([0, 1, 2, 3], "SCALAR", 5123, "<u2"), "mode": 5}
    view = binary.view(picture("PNG"))
    clear = {"clearcoatFactor": 0.5, "clearcoatTexture": {"index": 0}}
    moved = {"KHR_texture_transform": {"scale": [2, 2], "rotation": 0.5}}
    material = {
        "pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "extensions": moved}, "metallicFactor": 0.5},
        "normalTexture": {"index": 0}, "alphaMode": "MASK", "extensions": {"KHR_materials_clearcoat": clear},
    }  # fmt: skip
    lights = {"lights": [{"type": "spot", "intensity": 3, "spot": {"outerConeAngle": 0.5}}]}
    node = {
        "mesh": 0, "camera": 0, "rotation": [0, 0, 0.7, 0.7], "scale": [1, 2, -1],
        "extensions": {
            "KHR_lights_punctual": {"light": 0},
            "EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": binary.accessor(SQUARE[:2], "VEC3")}},
        },
    }  # fmt: skip
    document = binary.document(
        nodes=[node], meshes=[{"primitives": [primitive | {"material": 0}]}], materials=[material],
        images=[{"bufferView": view}], textures=[{"source": 0, "sampler": 0}], samplers=[{"wrapS": 33071}],
        cameras=[{"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}}],
        extensions={"KHR_lights_punctual": lights},
    )  # fmt: skip
    return document, binary.data


def _moving() -> tuple[dict[str, Any], bytes]:
    binary = _Binary()
    attributes = {
        "POSITION": binary.accessor(SQUARE, "VEC3"),
        "JOINTS_0": binary.accessor([[0, 1, 0, 0]] * 4, "VEC4", 5121, "u1"),
        "WEIGHTS_0": binary.accessor([[0.5, 0.5, 0, 0]] * 4, "VEC4"),
    }
    targets = [{"POSITION": binary.accessor(SQUARE, "VEC3")}]
    times = binary.accessor([0.0, 1.0], "SCALAR")
    samplers = [
        {"input": times, "output": binary.accessor([[0, 0, 0, 1], [0, 0, 1, 0]], "VEC4")},
        {"input": times, "output": binary.accessor([0.0, 1.0], "SCALAR"), "interpolation": "STEP"},
        {"input": times, "output": binary.accessor(np.ones((6, 3)), "VEC3"), "interpolation": "CUBICSPLINE"},
    ]
    paths = ((1, "rotation"), (0, "weights"), (2, "translation"))
    channels = [{"sampler": k, "target": {"node": n, "path": p}} for k, (n, p) in enumerate(paths)]
    bind = binary.accessor(np.tile(np.eye(4).reshape(-1), (2, 1)), "MAT4")
    document = binary.document(
        nodes=[{"mesh": 0, "skin": 0, "weights": [0.5], "children": [1]}, {"children": [2]}, {}],
        meshes=[{"primitives": [{"attributes": attributes, "targets": targets}]}],
        skins=[{"joints": [1, 2], "inverseBindMatrices": bind}],
        animations=[{"channels": channels, "samplers": samplers}],
    )
    return document, binary.data


def _gltf() -> bytes:
    import base64

    document, data = _moving()
    document["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    return json.dumps(document).encode()


def _compressed() -> dict[str, tuple[str, bytes]]:
    """GLB files with streams of Draco and meshopt."""
    import DracoPy

    faces = np.array([[0, 1, 2], [0, 2, 3]], np.uint32)
    binary = _Binary()
    view = binary.view(DracoPy.encode(SQUARE, faces))
    position = {"componentType": 5126, "count": 4, "type": "VEC3"}
    indices = {"componentType": 5125, "count": 6, "type": "SCALAR"}
    stream = {"bufferView": view, "attributes": {"POSITION": 0}}
    primitive = {"attributes": {"POSITION": 0}, "indices": 1, "extensions": {"KHR_draco_mesh_compression": stream}}
    draco = binary.document(
        nodes=[{"mesh": 0}], meshes=[{"primitives": [primitive]}], extensionsUsed=["KHR_draco_mesh_compression"]
    )
    draco["accessors"] = [position, indices]
    packed = _Binary()
    # One block of four vertices, every byte as it is; then the first vertex for the differences to start from.
    planes = b"".join(b"\x03" + _differences(SQUARE.view(np.uint8)[:, k]) for k in range(12))
    packed.view(b"\xa0" + planes + bytes(20) + SQUARE[0].tobytes())
    size = packed.views[0]["byteLength"]
    entry = {"buffer": 0, "byteOffset": 0, "byteLength": size, "byteStride": 12, "mode": "ATTRIBUTES", "count": 4}
    packed.views[0] |= {"byteLength": 48, "extensions": {"EXT_meshopt_compression": entry}}
    packed.accessors.append({"bufferView": 0, **position})
    shape = {"attributes": {"POSITION": 0}, "indices": packed.accessor([0, 1, 2, 0, 2, 3], "SCALAR", 5123, "<u2")}
    meshopt = packed.document(nodes=[{"mesh": 0}], meshes=[{"primitives": [shape]}])
    return {"glb draco": (".glb", glb((draco, binary.data))), "glb meshopt": (".glb", glb((meshopt, packed.data)))}


def _differences(column: np.ndarray[Any, Any]) -> bytes:
    steps = np.diff(column.astype(np.int64), prepend=int(column[0]))
    signed = (steps + 128) % 256 - 128
    codes = np.where(signed >= 0, 2 * signed, -2 * signed - 1)
    return bytes(codes.tolist()).ljust(16, b"\0")
