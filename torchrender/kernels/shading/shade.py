"""All tiles of an image, or of hits as an image of one row, from what is seen to radiance."""

from __future__ import annotations

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed
from torchrender.kernels.compile import kernel
from torchrender.kernels.shading.gather import face, face_further, gather, gather_further, place
from torchrender.kernels.shading.layers import add_coat, add_coat_sky, add_sheen
from torchrender.kernels.shading.lights import rectangle, small_light
from torchrender.kernels.shading.lobes import (
    add_metallic,
    add_phong,
    begin_metallic,
    look_up,
    mix,
    write,
    write_mirrors,
)
from torchrender.kernels.shading.maps import bend, constants, finish, textures
from torchrender.kernels.shading.records import METALLIC, PHONG, RECT, SLOT, SLOTS, SPAN, Work
from torchrender.kernels.shading.simd import ONE, ZERO, f4
from torchrender.kernels.shading.sky import background, diffuse, mirrored

LX, NX, SX, RO, CC, CK, VS = (SLOT[n] for n in ("LX", "NX", "SX", "RO", "CC", "CK", "VS"))


@kernel()
def some(s, n, slot):
    """Any pixel has more than zero there."""
    most = ZERO
    for i in range(n):
        most = max(most, s[slot + i])
    return most > ZERO


@kernel()
def keep_replaced(s, n, pix, out):
    """The mirrored environment, before its slots are used for lights."""
    for i in range(n):
        for c in range(3):
            out.replaced[pix[i], c] = s[LX + c * SPAN + i]


@kernel()
def keep_surface(s, n, pix, out):
    """Shading normals and roughness, for whoever follows what the pixels mirror."""
    for i in range(n):
        p = pix[i]
        for c in range(3):
            out.surface[p, c] = s[NX + c * SPAN + i]
        out.surface[p, 3] = s[RO + i]


@kernel()
def surfaces(samples, view, packed, looks, work, n, bits):
    """What the materials of gathered pixels are, point by point."""
    s, pix, mat, _, _ = work
    if packed.further.shape[0] > 0 or packed.tangent_row.shape[0] > 0:
        gather_further(samples, packed, s, n, pix)
    if samples.position.shape[0] == 0:
        place(s, n, view)
    face(s, n)
    if packed.further.shape[0] > 0:
        face_further(s, n)
    physical = bits & (1 << METALLIC) > 0
    constants(s, n, mat, looks, physical)
    textures(s, n, mat, looks)
    finish(s, n, mat, looks, physical)
    if bits & 8 > 0 and packed.tangent_row.shape[0] > 0:
        bend(s, n, mat, looks)


@kernel()
def arrive(s, n, pix, number, reach):
    """Light ``number`` at the pixels; False if none of them sees it."""
    lights, shadow = reach.lights, reach.shadow
    if shadow.shape[0] > 0:
        most = ZERO
        for i in range(n):
            f = shadow[number, pix[i]]
            s[VS + i] = f
            most = max(most, f)
        if most == ZERO:
            return False
    else:
        for i in range(n):
            s[VS + i] = ONE
    if lights[number, 0] == f4(RECT):
        rectangle(s, n, lights[number])
    else:
        small_light(s, n, lights[number])
    return True


@kernel()
def tile(box, seen, packed, looks, sky, reach, out, work):
    """One tile; ``seen`` = what is seen, and its camera."""
    samples, view = seen
    s, pix, mat, empty, _ = work
    n, e, bits = gather(box, samples, view, packed, looks, work)
    if e > 0 and samples.position.shape[0] == 0 and out.radiance.shape[0] > 0:
        background(s, e, empty, view, sky, out.radiance)
    if n == 0:
        return
    surfaces(samples, view, packed, looks, work, n, bits)
    if out.surface.shape[0] > 0:
        keep_surface(s, n, pix, out)
        if out.radiance.shape[0] == 0:
            return
    diffuse(s, n, pix, sky, reach)
    phong, metallic, shiny = bits & (1 << PHONG) > 0, bits & (1 << METALLIC) > 0, bits & 16 > 0
    coated = cloth = False
    if metallic:
        look_up(s, n, mat, looks, sky, bits & 32 > 0)
        mix(s, n)
        mirrored(s, n, sky, NX, RO)
        begin_metallic(s, n, mat, looks)
        if out.replaced.shape[0] > 0:
            keep_replaced(s, n, pix, out)
        coated, cloth = some(s, n, CC), bits & 32 > 0
        if coated:
            mirrored(s, n, sky, SX, CK)
            add_coat_sky(s, n, sky)
    for number in range(reach.lights.shape[0]):
        if not arrive(s, n, pix, number, reach):
            continue
        light = reach.lights[number]
        if metallic:
            add_metallic(s, n, sky, light)
            if cloth:
                add_sheen(s, n, mat, looks, light)
            if coated:
                add_coat(s, n, light)
        if phong:
            add_phong(s, n, light, shiny)
    if out.replaced.shape[0] > 0:
        write_mirrors(s, n, pix, mat, looks, out)
    write(s, n, bits, pix, mat, looks, out)


@kernel(parallel=True)
def shade(samples, view, packed, looks, sky, reach, out, how):
    """Light of all samples into ``out``; ``how`` = (columns and rows of a tile, workers).

    A light that no pixel of a tile sees is skipped there.
    """
    triangle = samples.triangle
    height, width = triangle.shape
    columns, rows, workers = how
    across = (width + columns - 1) // columns
    tiles = across * ((height + rows - 1) // rows)
    for worker in prange(workers):
        s = np.zeros(SLOTS * SPAN, np.float32)
        pix, mat, empty = np.zeros(SPAN, np.uint32), np.zeros(SPAN, np.uint32), np.zeros(SPAN, np.uint32)
        near = np.zeros(4 * SPAN, np.uint32)
        seen, soup, look = (borrowed(samples), borrowed(view)), borrowed(packed), borrowed(looks)
        around, light, target = borrowed(sky), borrowed(reach), borrowed(out)
        work = Work(borrowed(s), borrowed(pix), borrowed(mat), borrowed(empty), borrowed(near))
        for k in range(np.int64(worker), tiles, workers):
            x0, y0 = k % across * columns, k // across * rows
            box = (x0, min(x0 + columns, width), y0, min(y0 + rows, height))
            tile(box, seen, soup, look, around, light, target, work)
