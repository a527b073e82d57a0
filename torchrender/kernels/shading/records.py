"""What the shading kernel reads and writes, and the scratch of one tile."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

SPAN = 512
"""Pixels per tile at most: their scratch stays in the cache of a core, and calls of stages weigh little."""
TILE = (128, 4)
"""Columns and rows of a tile."""
MOST_KINDS = 16
"""Materials of a tile that its pixels are told apart by; where there are more, each pixel looks up its own."""

IRRADIANCE_SIDE = 64
"""Texels per side of the octahedral map of irradiance, without its edge."""

_SLOTS = (
    # position; normal as bent, smooth and of the triangle; direction to the eye
    "PX PY PZ NX NY NZ SX SY SZ GX GY GZ EX EY EZ "
    # texture coordinates and log2 of footprints, twice; tangent
    "U V LV U1 V1 L1 TX TY TZ TW "
    # what textures multiply, see CHANNEL
    "BR BG BB OR OG OB HR HG HB HA OC RO ME QX QY QZ CC CK TM "
    # sums of diffuse and mirrored light; the light at hand; exponent
    "DR DG DB SR SG SB AM VS LX LY LZ SH "
    # of metallic-roughness, see lobes
    "FR FG FB FH KR KG KB AB WR WG WB MR MG MB LO HI HC HD IN NV SL CL TH NE YR YG YB "
    # where tables are read: first entry, shares of the next column and row
    "TA TU TV "
    # light for the diffuse part; share of a lobe that a rectangle fills, and how the lobe lies
    "MA FL LA LB LC LD LE"
).split()
SLOT = {name: number * SPAN for number, name in enumerate(_SLOTS)}
SLOTS = len(_SLOTS)

CHANNEL = {
    "diffuse_texture": "BR BG BB", "emission_texture": "OR OG OB", "specular_texture": "HR HG HB HA",
    "occlusion_texture": "OC", "metallic_roughness_texture": "- RO ME", "normal_texture": "QX QY QZ",
    "clearcoat_texture": "CC CK", "transmission_texture": "TM",
}  # fmt: skip
"""Where the channels of each texture go."""

PHONG, METALLIC, UNLIT = 0, 1, 2
POINT, PARALLEL, RECT, CENTRE = 0, 1, 2, 3
"""Kinds of light; the last is a rectangle taken as a small light."""

LEVELS = 40
"""Column of the first level in a row of :attr:`Looks.groups`."""


class View(NamedTuple):
    """The camera of an image."""

    numbers: np.ndarray  # (20,) float32: ray matrix 9, eye from the origin 3, forward 3, pixel size, 1: orthographic
    origin: np.ndarray  # (3,) float64 world space, what positions are counted from


class Samples(NamedTuple):
    """What is seen: an image, or hits of rays as an image of one row, which bring their place and direction."""

    depth: np.ndarray  # (H,W) float32 camera z; of hits not read
    triangle: np.ndarray  # (H,W) int64, -1 for nothing
    weights: np.ndarray  # (H,W,2) float32
    position: np.ndarray  # (N,3) float64 of hits, no rows for an image
    to_eye: np.ndarray  # (N,3) float32
    width: np.ndarray  # (N,) float64 of the ray


class Packed(NamedTuple):
    """Triangles as the kernel reads them: few cache lines for each."""

    corners: np.ndarray  # (V,8) float32 normal, colour, uv
    planes: np.ndarray  # (F,4) float32 unit normal, uv per length
    ids: np.ndarray  # (F,4) uint32 corners, material
    further: np.ndarray  # (V,4) float32 second uv, opacity; no rows where no mesh has any
    density: np.ndarray  # (F,) float32 second uv per length
    tangent_row: np.ndarray  # (F,) int32; no rows where nothing has a normal map
    tangents: np.ndarray  # (T,3,4) float32


class Looks(NamedTuple):
    """Materials and textures."""

    numbers: np.ndarray  # (M,32) float32, see MATERIAL
    groups_of: (
        np.ndarray
    )  # (M,4) int32 first and one past last group, kind, 1: normal map + 2: Phong highlight + 4: sheen
    groups: np.ndarray  # (G,LEVELS+3K) int64: levels, wraps, filter, uv set, channels, plain?, codes, slots; per level
    transforms: np.ndarray  # (G,8) float32: transform 6, log2 of the longer side in texels
    texels: np.ndarray  # (X,) float32, followed by three more numbers that may be read, as the next two
    codes: np.ndarray  # (Y,) uint8 finest levels of textures that are kept so
    coarser: np.ndarray  # (Z,) uint16 their other levels, in units of 1/65535
    tables: np.ndarray  # (512,) float32 what a code is, as a share and in linear light


class Sky(NamedTuple):
    """Light from all around."""

    ambient: np.ndarray  # (3,) float32
    irradiance: np.ndarray  # (T,3) float32 octahedral, over pi; no rows without an environment; as texels
    mirrored: np.ndarray  # (T,3) float32 octahedral maps; as texels
    levels: np.ndarray  # (K,2) int64 first texel and side
    albedo: np.ndarray  # (S,S,4) float32 directional albedo
    mean: np.ndarray  # (S,4) float32
    sheen: np.ndarray  # (S,S,1) float32
    lobes: np.ndarray  # (S,S,12) float32, see sky_lobes
    cosines: np.ndarray  # (S,S,8) float32 linearly transformed cosines, 0
    radiance: np.ndarray  # (H,W,3) float32 background; 1 x 1: the same everywhere
    turn: np.ndarray  # (2,) float32: turn of the background, its intensity


class Reach(NamedTuple):
    """What of the light arrives."""

    lights: np.ndarray  # (L,32) float32, see LIGHT
    shadow: np.ndarray  # (K,N) float32; no rows: all
    rows: np.ndarray  # (L,) int64 row of a light in shadow, -1: all of it arrives
    around: np.ndarray  # (N,) float32; no rows: all
    bent: np.ndarray  # (N,3) float32; no rows: the normal
    starts: np.ndarray  # (T+1,) int64 where the list of each block of pixels begins; one row: all lights everywhere
    listed: np.ndarray  # (K,) int32 lights of the lists


class Out(NamedTuple):
    """Flat images; all but the first may have no rows."""

    radiance: np.ndarray  # (N,3)
    replaced: np.ndarray  # (N,3)
    mirrored: np.ndarray  # (N,3)
    surface: np.ndarray  # (N,4) shading normal with its map, roughness


class Stages(NamedTuple):
    """Addresses of the stages, see :mod:`parts`, 0 where no pixel needs one; and how an image is split."""

    columns: int  # of a tile
    rows: int
    workers: int
    side: int  # pixels of the blocks that lights are listed for
    surfaces: int
    further: int
    textures: int
    bend: int
    surface: int
    ambient: int
    background: int
    small_light: int
    rectangle: int
    phong: int
    metallic: int
    metallic_light: int
    lobes: int
    metallic_rectangle: int
    sheen_light: int
    coat: int
    coat_light: int
    coat_rectangle: int
    write: int
    mirrors: int


MATERIAL = {
    "diffuse": 0, "emission": 3, "tint": 6, "degree": 9, "shininess": 10, "lobe": 11, "metallic": 12, "roughness": 13,
    "dielectric": 14, "weight": 15, "coat": 16, "coat_roughness": 17, "sheen": 18, "sheen_roughness": 21,
    "transmission": 22, "normal_scale": 23, "occlusion": 24, "slowed": 25, "excess": 26,
}  # fmt: skip
"""First column of each in :attr:`Looks.numbers`."""

LIGHT = {
    "kind": 0, "place": 1, "axis": 4, "color": 7, "cone": 10, "slope": 11, "normal": 12, "offset": 15, "corners": 16,
    "nearest": 28, "area": 29, "fade": 30,
}  # fmt: skip
"""First column of each in :attr:`Reach.lights`; ``fade`` is one over the squared range, ``cone``
one minus the cosine of the outer half angle."""


class Work(NamedTuple):
    """Scratch of one tile."""

    s: np.ndarray  # (SLOTS * SPAN,) float32
    pix: np.ndarray  # (SPAN,) uint32 place of each covered pixel in the flat image
    mat: np.ndarray  # (SPAN,) uint32 material, a part of near
    empty: np.ndarray  # (SPAN,) uint32 place of each empty pixel
    near: np.ndarray  # (5 * SPAN,) uint32 triangle, its three corners, and again the material
    found: np.ndarray  # (4,) int64 covered pixels, empty ones, bits of their materials, how many kinds has
    lit: np.ndarray  # (L,) bool lights that may reach the tile
    runs: np.ndarray  # (SPAN + 1,) uint32 where pixels begin that follow one another and share a triangle, and the end
    kinds: np.ndarray  # (MOST_KINDS,) uint32 materials of the tile in rising order
