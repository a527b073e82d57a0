"""The stages of shading, see :mod:`torchrender.kernels.stages`: what one after the other is done to a tile's pixels.

Each takes the scratch of the tile and the count ``n`` of its pixels, and leaves what it finds in the scratch.
"""

from __future__ import annotations

from torchrender.kernels.shading.gather import face, gather, gather_further, place
from torchrender.kernels.shading.layers import add_coat, add_coat_sky, add_sheen, share_of_coat
from torchrender.kernels.shading.lights import rectangle as one_rectangle
from torchrender.kernels.shading.lights import small_light as one_small_light
from torchrender.kernels.shading.lobes import (
    add_metallic,
    add_phong,
    begin_metallic,
    look_up,
    mix,
    write_mirrors,
)
from torchrender.kernels.shading.lobes import write as write_light
from torchrender.kernels.shading.maps import bend as bend_normals
from torchrender.kernels.shading.maps import constants, finish
from torchrender.kernels.shading.maps import textures as all_textures
from torchrender.kernels.shading.records import METALLIC, SLOT, SPAN
from torchrender.kernels.shading.rectangles import add_coat_rectangle, add_metallic_rectangle, lay
from torchrender.kernels.shading.sky import background as far_away
from torchrender.kernels.shading.sky import diffuse, lean, mirrored
from torchrender.kernels.stages import stage

LX, NX, SX, RO, CK = (SLOT[n] for n in ("LX", "NX", "SX", "RO", "CK"))
CLOTH = 32
"""Bit of :func:`gather`: some material has sheen."""


@stage()
def surfaces(box, samples, view, packed, looks, work):
    """What the covered pixels are, textures apart; how many there are."""
    n, e, bits = gather(box, samples, view, packed, looks, work)
    work.found[0], work.found[1], work.found[2] = n, e, bits
    if n > 0:
        if samples.position.shape[0] == 0:
            place(work.s, n, view)
        face(work.s, n)
        constants(work, n, looks, bits & (1 << METALLIC) > 0)


@stage("further")
def further(packed, work, n):
    """Second texture coordinates and tangents."""
    gather_further(packed, work, n)


@stage("textures")
def textures(looks, work, n):
    """All textures."""
    all_textures(work, n, looks)


@stage("further")
def bend(looks, work, n):
    """Normal maps."""
    bend_normals(work, n, looks)


@stage("maps")
def surface(out, work, n):
    """Shading normals and roughness, for whoever follows what the pixels mirror."""
    s = work.s
    for i in range(n):
        p = work.pix[i]
        for c in range(3):
            out.surface[p, c] = s[NX + c * SPAN + i]
        out.surface[p, 3] = s[RO + i]


@stage()
def ambient(looks, sky, reach, work, n, bits):
    """Diffuse light from all around."""
    finish(work, n, looks, bits & (1 << METALLIC) > 0)
    diffuse(work.s, n, work.pix, sky, reach)


@stage("environment")
def background(view, sky, work, e, radiance):
    """The environment behind empty pixels."""
    far_away(work.s, e, work.empty, view, sky, radiance)


@stage()
def small_light(work, n, light):
    """What one light brings that is no rectangle."""
    one_small_light(work.s, n, light)


@stage("rectangles")
def rectangle(work, n, light):
    """What one rectangle brings."""
    one_rectangle(work.s, n, light)


@stage("phong")
def phong(work, n, light, shiny):
    """One light on Phong materials."""
    add_phong(work.s, n, light, shiny)


@stage("metallic")
def metallic(looks, sky, out, work, n, bits):
    """Metallic-roughness before its lights: what all around brings, emission."""
    s = work.s
    look_up(work, n, looks, sky, bits & CLOTH > 0)
    mix(s, n)
    lean(s, n, sky.lobes, RO)
    mirrored(s, n, sky, NX)
    begin_metallic(work, n, looks, bits & CLOTH > 0)
    if out.replaced.shape[0] > 0:  # before its slots are used for lights
        for i in range(n):
            for c in range(3):
                out.replaced[work.pix[i], c] = s[LX + c * SPAN + i]


@stage("metallic")
def metallic_light(sky, work, n, light):
    """One light on metallic-roughness."""
    add_metallic(work.s, n, sky, light)


@stage("rectangles")
def lobes(sky, work, n):
    """How lobes lie that rectangles fill."""
    lay(work.s, n, sky.cosines, NX, RO)


@stage("rectangles")
def metallic_rectangle(sky, work, n, light):
    """One rectangle on metallic-roughness."""
    add_metallic_rectangle(work.s, n, sky, light)


@stage("layers")
def sheen_light(looks, work, n, light):
    """One light on sheen."""
    add_sheen(work.s, n, work.mat, looks, light)


@stage("layers")
def coat(sky, work, n):
    """What clear coats mirror of the light from all around."""
    share_of_coat(work.s, n, sky)
    lean(work.s, n, sky.lobes, CK)
    mirrored(work.s, n, sky, SX)
    add_coat_sky(work.s, n)


@stage("layers")
def coat_light(work, n, light):
    """One light on clear coats."""
    add_coat(work.s, n, light)


@stage("layers")
def coat_rectangle(sky, work, n, light):
    """One rectangle on clear coats."""
    add_coat_rectangle(work.s, n, sky, light)


@stage()
def write(looks, out, work, n, bits):
    """Radiance into the image."""
    write_light(work, n, bits, looks, out)


@stage("mirrors")
def mirrors(looks, out, work, n):
    """What mirrors change."""
    write_mirrors(work.s, n, work.pix, work.mat, looks, out)
