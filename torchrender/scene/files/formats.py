"""What is read of which files, by which library: the table that ``docs/formats.md`` is made from.

``python -m torchrender.scene.files.formats`` prints the page.
"""

from __future__ import annotations

import sys
from typing import NamedTuple

from torchrender.scene.files.gltf.extensions import COMPRESSION, SILENT, SUPPORTED


class Format(NamedTuple):
    """One kind of file."""

    suffixes: tuple[str, ...]
    library: str  # what reads the bytes
    read: str
    not_used: str


FORMATS = (
    Format(
        (".glb", ".gltf"),
        "own; DracoPy for Draco streams, a kernel for meshopt streams, Pillow and OpenCV for pictures",
        "glTF 2.0: nodes, instances, all modes of triangles, metallic-roughness and specular-glossiness materials with "
        "all textures, samplers and two sets of coordinates, variants, vertex colours with opacity, tangents, cameras, "
        "punctual lights, skins, morph targets, animations of every interpolation, sparse and quantised accessors, "
        "several scenes; points through `load_points`; media in `extras.media` of a scene",
        "lines, a third set of texture coordinates, extensions that are not listed below",
    ),
    Format(
        (".obj",),
        "own; mapbox_earcut for concave polygons",
        "polygons of any size and shape, relative indices, continued lines, UTF-8 and UTF-16, vertex colours, objects, "
        "groups, smoothing groups, several MTL files",
        "lines, points, free-form curves and surfaces",
    ),
    Format(
        (".mtl",),
        "own",
        "Kd, Ks, Ke, Ns, Ni, d, Tr, illum, Pr, Pm, Pc, Pcr, Ps, map_Kd, map_Ks, map_Ke, map_d, map_Pr, map_Pm, norm, "
        "map_Bump; options -o, -s, -clamp, -mm, -bm, -imfchan; xyz colours",
        "Ka (ambient light is reflected as any other), Tf, map_Ns, disp, decal, refl, aniso, spectral colours, d -halo",
    ),
    Format(
        (".ply",),
        "own; mapbox_earcut for concave polygons",
        "text and both binary orders, lists of any type, polygons of mixed sizes, strips, normals, colours and "
        "coordinates under their usual names and in every type, colours of faces, coordinates of corners, TextureFile; "
        "points with radii and opacity; 3D Gaussians",
        "other elements and columns, higher harmonics of 3D Gaussians",
    ),
    Format(
        (".stl",),
        "own",
        "text and binary, several solids, colours of VisCAM and Magics, bytes behind the last facet",
        "normals of facets (they follow from the corners)",
    ),
    Format((".toml",), "tomllib", "scene files of this package", ""),
    Format((".trw", ".trp"), "own", "walkthroughs and compressed points of this package", ""),
    Format((".npz",), "own", "voxels of this package, by `torchrender.read_voxels` alone: no command draws them", ""),
    Format(
        (".npy", ".vol"), "NumPy, own", "densities of media", "the box of a .vol file; of several channels the mean"
    ),
    Format(
        (".png", ".jpg", ".jpeg", ".webp", ".bmp", ".tga"),
        "Pillow; OpenCV for 16-bit PNG",
        "8 and 16 bits, palettes, transparency, orientation tags",
        "animations, colour profiles",
    ),
    Format((".ktx2",), "opengl_basisu (extra `ktx`)", "ETC1S and UASTC of Basis Universal", "mip levels, cube maps"),
    Format((".hdr", ".pic"), "OpenCV", "Radiance RGBE in all eight orientations", "XYZE colours: an error"),
    Format(
        (".exr",),
        "OpenEXR",
        "half and float, scan lines and tiles, luminance and chroma, the first part of several",
        "further parts and layers, deep data",
    ),
)

_HEAD = """# Formats

What is read of which files. This page is made by `python -m torchrender.scene.files.formats`.

Whatever a file holds beyond this is named: in `Scene.report`, in a warning (`torchrender.errors.NotUsedWarning`), in
one line of `torchrender render` and `torchrender info`, and in the service's answer to an upload. What was mended is
named alike (`RepairedWarning`).

| files | read by | what is read | what is not used |
|---|---|---|---|
"""


def page() -> str:
    """The page in Markdown."""
    rows = [
        f"| {', '.join(f'`{s}`' for s in f.suffixes)} | {f.library} | {f.read} | {f.not_used or '–'} |" for f in FORMATS
    ]
    groups = {
        "Materials, lights and placement": sorted(SUPPORTED - COMPRESSION),
        "Compression": sorted(COMPRESSION),
        "Descriptions, which no picture shows": sorted(SILENT),
    }
    lists = [f"- {title}: {', '.join(f'`{n}`' for n in names)}" for title, names in groups.items()]
    return _HEAD + "\n".join(rows) + "\n\n## Extensions of glTF\n\n" + "\n".join(lists) + "\n"


if __name__ == "__main__":
    sys.stdout.write(page())
