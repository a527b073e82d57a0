"""Light left by bits beside its slow twin: loops over texels, and whole transforms."""

from __future__ import annotations

import math

import numpy as np
import torch

from torchrender.effects.sky_shadows.light import cosines, prepare_light
from torchrender.effects.sky_shadows.options import SkyLightOptions
from torchrender.effects.sky_shadows.shade import bits_of_words, caps_of
from torchrender.effects.sky_shadows.tables import bin_radii, code_wavelets
from torchrender.kernels.sky_shadows.light import (
    HALF,
    SKIP,
    Samples,
    count_blocks,
    gather,
    hidden_words,
    stored_normals,
    texel_index,
)
from torchrender.kernels.sky_shadows.resample import texel_means, weigh_blocks
from torchrender.numerics.wavelets.haar import transform
from torchrender.scene.sky.cube_map import solid_angles, texel_directions, texel_of


def twin_bits(position: np.ndarray, normal: np.ndarray, spheres: np.ndarray, own: int, solid: int) -> np.ndarray:
    """One sphere, one texel after the other, with the table's directions and radii."""
    texels = texel_directions(32).reshape(-1, 3)
    hidden = np.zeros(6144, bool)
    for s, (*centre, radius, body) in enumerate(spheres):
        towards = np.array(centre) - position
        distance = np.linalg.norm(towards)
        mine = own >= 0 and body == spheres[own, 4]
        if s == own or radius <= 0 or (distance <= radius and (solid == SKIP or mine)):
            continue
        size = min(radius / distance, 1.0)
        if normal @ towards / distance <= -size:
            continue
        axis = texels[int(texel_of(torch.from_numpy(towards / distance), 32))].numpy()
        binned = float(bin_radii(32)[min(int(size * 32), 31)])
        hidden |= texels.numpy() @ axis >= math.sqrt(1 - binned**2)
    return hidden.reshape(6, 32, 32)


def test_hidden_texels_are_those_of_every_sphere() -> None:
    rng = np.random.default_rng(2)
    position = rng.normal(size=(40, 3)) * 0.4
    normal = rng.normal(size=(40, 3)).astype(np.float32)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    bodies = np.arange(9)[:, None] % 4
    spheres = np.concatenate([rng.normal(size=(9, 3)), rng.random((9, 1)) * 0.9, bodies], axis=1)
    own = rng.integers(-1, 9, 40).astype(np.int32)
    solid = np.where(rng.random(40) < 0.5, SKIP, HALF).astype(np.int32)
    words = np.empty((40, 96), np.int64)
    hidden_words(
        Samples(position, normal, own, solid, np.zeros((40, 3), np.float32)), spheres, caps_of(SkyLightOptions()), words
    )
    found = bits_of_words(torch.from_numpy(words)).numpy()
    for i in range(40):
        wanted = twin_bits(position[i], normal[i].astype(float), spheres, own[i], solid[i])
        assert (found[i] != wanted).sum() <= 2, i  # centres on the edge of a cap


def test_counts_are_ones_of_codes() -> None:
    words = np.random.default_rng(3).integers(-(1 << 62), 1 << 62, 96)
    words[:3] = -1, 0, np.int64(-(1 << 63))
    counts = np.empty(384, np.int32)
    count_blocks(words, counts)
    assert counts.tolist() == [int(code).bit_count() for code in words.view(np.uint16)]


def test_a_direction_finds_its_texel() -> None:
    """Ties go to the first axis."""
    rng = np.random.default_rng(4)
    directions = np.concatenate([rng.normal(size=(500, 3)), list(np.ndindex(3, 3, 3)) - np.ones(3)])
    directions = directions[np.abs(directions).max(axis=1) > 0]
    wanted = texel_of(torch.from_numpy(directions), 32)
    assert [texel_index(*d, 0.0, 0.0) for d in directions] == wanted.tolist()


def test_light_left_is_the_sum_over_wavelets() -> None:
    """The twin transforms whole images and keeps the light's terms: coarse levels, chosen fine ones."""
    generator = torch.Generator().manual_seed(5)
    light = prepare_light(torch.rand(6, 32, 32, 3, generator=generator).double() ** 8, SkyLightOptions(terms=300))
    bits = np.random.default_rng(5).integers(0, 2, 6144).astype(bool).reshape(6, 32, 32)
    bits[0] = True
    bits[1, :16] = False
    order = bits.reshape(6, 8, 4, 8, 4).swapaxes(2, 3).reshape(384, 16)
    words = (order @ (1 << np.arange(15, -1, -1))).astype(np.uint16).view(np.int64)
    normal = torch.tensor([0.3, 0.8, -0.2], dtype=torch.float64)
    normal /= normal.norm()
    index, weight = np.zeros(4, np.int64), np.zeros(4)
    number = stored_normals(*normal.tolist(), 8, index, weight)
    assert number == 4 and abs(weight.sum() - 1) < 1e-12
    out = np.zeros(8)
    codes, counts = words.view(np.uint16), np.zeros(384, np.int32)
    gather(words, codes, counts, light.record, code_wavelets(), (index, weight, number), out)
    from torchrender.effects.sky_shadows.light import stored_normals as stored

    facing = (cosines(stored(8, True)[torch.from_numpy(index)]) * torch.from_numpy(weight)[:, None, None, None]).sum(0)
    seen, sky, cosine = transform(torch.from_numpy(~bits).double()), light.haar, transform(facing)
    blocks = torch.from_numpy(~bits).double().reshape(6, 8, 4, 8, 4).mean((2, 4))
    coarse = blocks.repeat_interleave(4, 1).repeat_interleave(4, 2)
    wanted = torch.einsum("fij,fij,fijc->c", coarse, facing, light.texels) / 1024
    for face, square, kind, fine in light.kept.tolist():
        if fine:
            value = sky.wavelets[:, face, square, kind] * seen.wavelets[face, square, kind]
            wanted += value * cosine.means[face, square]
    np.testing.assert_allclose(out[:3], wanted.numpy(), rtol=2e-6)
    whole = torch.einsum("fij,fijc->c", facing, light.texels) / 1024
    np.testing.assert_allclose(out[4:7], whole.numpy(), rtol=2e-6)
    even = torch.einsum("fij,fij,ij->", coarse, facing, solid_angles(32))
    np.testing.assert_allclose(out[[3, 7]], [float(even), 1.0], rtol=1e-5)


def test_blocks_are_weighed_by_cosines() -> None:
    rng = np.random.default_rng(9)
    cosine, light = rng.random((5, 384, 16)).astype(np.float32), rng.random((384, 16, 4)).astype(np.float32)
    out = np.empty((5, 384, 4), np.float32)
    weigh_blocks(cosine, light, out)
    wanted = np.zeros((5, 384, 4))
    for n, b, t in np.ndindex(5, 384, 16):
        wanted[n, b] += float(cosine[n, b, t]) * light[b, t]
    np.testing.assert_allclose(out, wanted, rtol=1e-5)


def test_means_of_a_picture_over_texels() -> None:
    """The twin looks up one place after the other."""
    rng = np.random.default_rng(6)
    picture = rng.random((5, 8, 3)).astype(np.float32)
    azimuth, height = rng.random((3, 4)).astype(np.float32) - 0.5, rng.random((3, 4)).astype(np.float32)
    out = np.empty((3, 3))
    texel_means(picture, azimuth, height, 0.25, out)
    for t in range(3):
        total = np.zeros(3)
        for k in range(4):
            x, y = (float(azimuth[t, k]) + 0.75) * 8 - 0.5, float(height[t, k]) * 5 - 0.5
            i, j = math.floor(x), math.floor(y)
            for dj, wj in ((0, 1 - (y - j)), (1, y - j)):
                for di, wi in ((0, 1 - (x - i)), (1, x - i)):
                    total += wi * wj * picture[min(max(j + dj, 0), 4), (i + di) % 8]
        np.testing.assert_allclose(out[t], total / 4, rtol=1e-6)
