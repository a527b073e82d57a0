"""All tiles of an image, or of hits as an image of one row, from what is seen to radiance."""

from __future__ import annotations

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed, foresee, keep
from torchrender.kernels.compile import kernel
from torchrender.kernels.shading.records import METALLIC, MOST_KINDS, PHONG, RECT, SLOT, SLOTS, SPAN, Work
from torchrender.kernels.shading.simd import ONE, ZERO, f4
from torchrender.kernels.stages import run

NX, NY, NZ, SX, SY, SZ, CC, VS = (SLOT[n] for n in ("NX", "NY", "NZ", "SX", "SY", "SZ", "CC", "VS"))

LINE = 8
"""Numbers of 64 bits in a line of the cache."""


@kernel(counted=False)
def some(s, n, slot):
    """Any pixel has more than zero there."""
    most = ZERO
    for i in range(n):
        most = max(most, s[slot + i])
    return most > ZERO


@kernel(counted=False)
def arrives(s, n, pix, number, reach):
    """Share of light ``number`` that arrives at the pixels, into VS; False if none of them sees it."""
    shadow = reach.shadow
    row = reach.rows[number] if shadow.shape[0] > 0 else np.int64(-1)
    if row < 0:
        for i in range(n):
            s[VS + i] = ONE
        return True
    most = ZERO
    for i in range(n):
        f = shadow[row, pix[i]]
        s[VS + i] = f
        most = max(most, f)
    return most > ZERO


@kernel(counted=False)
def smooth(s, n):
    """Normals of the smooth surface, in place of the weights in its triangles: maps bend the others."""
    for i in range(n):
        s[SX + i], s[SY + i], s[SZ + i] = s[NX + i], s[NY + i], s[NZ + i]


@kernel(counted=False)
def bring(box, samples, out):
    """Have what a tile of an image reads and writes fetched from memory: a few short pieces of each of many rows are
    nothing that processors foresee by themselves.
    """
    x0, x1, y0, y1 = box
    width = samples.triangle.shape[1]
    triangle = samples.triangle.reshape(samples.triangle.size)
    weights, depth = samples.weights.reshape(samples.weights.size), samples.depth.reshape(samples.depth.size)
    for y in range(y0, y1):
        for x in range(y * width + x0, y * width + x1, LINE):
            foresee(triangle, np.uintp(x))
            foresee(weights, np.uintp(2 * x))
        for x in range(y * width + x0, y * width + x1, 2 * LINE):
            foresee(depth, np.uintp(x))
        if out.radiance.shape[0] > 0:
            for x in range(y * width + x0, y * width + x1, LINE // 2):
                foresee(out.radiance, np.uintp(x))


@kernel(counted=False)
def find_lit(box, across, side, reach, lit):
    """Which lights are listed for any of the blocks of ``side`` pixels, ``across`` in a row, that the tile lies in."""
    x0, x1, y0, y1 = box
    for k in range(lit.shape[0]):
        lit[k] = False
    for j in range(y0 // side, (y1 - 1) // side + 1):
        for i in range(x0 // side, (x1 - 1) // side + 1):
            block = j * across + i
            for k in range(reach.starts[block], reach.starts[block + 1]):
                lit[reach.listed[k]] = True


@kernel(counted=False)
def tile(box, seen, looks, sky, reach, out, work, stages):
    """One tile; ``seen`` = what is seen, its camera, its triangles."""
    samples, view, packed = seen
    s, pix = work.s, work.pix
    run(stages.surfaces, (box, samples, view, packed, looks, work))
    n, e, bits = work.found[0], work.found[1], work.found[2]
    if e > 0 and samples.position.shape[0] == 0 and out.radiance.shape[0] > 0:
        if stages.background != 0:
            run(stages.background, (view, sky, work, e, out.radiance))
        else:
            for i in range(e):
                for c in range(3):
                    out.radiance[work.empty[i], c] = sky.radiance[0, 0, c] * sky.turn[1]
    if n == 0:
        return
    if stages.further != 0:
        run(stages.further, (packed, work, n))
    smooth(s, n)
    if stages.textures != 0:
        run(stages.textures, (looks, work, n))
    if bits & 8 > 0 and packed.tangent_row.shape[0] > 0:
        run(stages.bend, (looks, work, n))
    if out.surface.shape[0] > 0:
        run(stages.surface, (out, work, n))
        if out.radiance.shape[0] == 0:
            return
    run(stages.ambient, (looks, sky, reach, work, n, bits))
    phong, metallic, shiny = bits & (1 << PHONG) > 0, bits & (1 << METALLIC) > 0, bits & 16 > 0
    coated = cloth = False
    if metallic:
        run(stages.metallic, (looks, sky, out, work, n, bits))
        coated, cloth = some(s, n, CC), bits & 32 > 0
        if coated:
            run(stages.coat, (sky, work, n))
    laid = False
    for number in range(reach.lights.shape[0]):
        if not work.lit[number] or not arrives(s, n, pix, number, reach):
            continue
        light = reach.lights[number]
        wide = light[0] == f4(RECT)
        if wide:
            run(stages.rectangle, (work, n, light))
        else:
            run(stages.small_light, (work, n, light))
        if metallic:
            if wide:
                if not laid:
                    run(stages.lobes, (sky, work, n))
                    laid = True
                run(stages.metallic_rectangle, (sky, work, n, light))
                if coated:
                    run(stages.coat_rectangle, (sky, work, n, light))
            else:
                run(stages.metallic_light, (sky, work, n, light))
                if coated:
                    run(stages.coat_light, (work, n, light))
            if cloth:
                run(stages.sheen_light, (looks, work, n, light))
        if phong:
            run(stages.phong, (work, n, light, shiny))
    if out.replaced.shape[0] > 0:
        run(stages.mirrors, (looks, out, work, n))
    run(stages.write, (looks, out, work, n, bits))


@kernel(parallel=True)
def shade(samples, view, packed, looks, sky, reach, out, stages):
    """Light of all samples into ``out``. A light that no pixel of a tile sees is skipped there."""
    triangle = samples.triangle
    height, width = triangle.shape
    columns, rows, workers, side = stages.columns, stages.rows, stages.workers, stages.side
    across = (width + columns - 1) // columns
    tiles = across * ((height + rows - 1) // rows)
    blocks = (width + side - 1) // side
    for worker in prange(workers):
        s = np.zeros(SLOTS * SPAN, np.float32)
        pix, empty = np.zeros(SPAN, np.uint32), np.zeros(SPAN, np.uint32)
        near, runs = np.zeros(5 * SPAN, np.uint32), np.zeros(SPAN + 1, np.uint32)
        kinds, mat = np.zeros(MOST_KINDS, np.uint32), near[4 * SPAN :]
        found, lit = np.zeros(4, np.int64), np.ones(reach.lights.shape[0], np.bool_)
        shown, look = (borrowed(samples), borrowed(view), borrowed(packed)), borrowed(looks)
        around, light, target = borrowed(sky), borrowed(reach), borrowed(out)
        parts = (borrowed(s), borrowed(pix), borrowed(mat), borrowed(empty), borrowed(near))
        work = Work(*parts, borrowed(found), borrowed(lit), borrowed(runs), borrowed(kinds))
        for k in range(np.int64(worker), tiles, workers):
            x0, y0 = k % across * columns, k // across * rows
            box = (x0, min(x0 + columns, width), y0, min(y0 + rows, height))
            if light.starts.shape[0] > 1:
                find_lit(box, blocks, side, light, work.lit)
            if shown[0].position.shape[0] == 0 and k + workers < tiles:
                x0, y0 = (k + workers) % across * columns, (k + workers) // across * rows
                following = (x0, min(x0 + columns, width), y0, min(y0 + rows, height))
                bring(following, shown[0], target)
            tile(box, shown, look, around, light, target, work, stages)
        keep((s, pix, mat, empty, near, found, lit, runs, kinds))
