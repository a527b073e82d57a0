"""Textures that are kept as codes: tensors of their numbers to everybody, until somebody takes hold of these."""

from __future__ import annotations

import copy
import io
import pickle
from collections.abc import Callable

import numpy as np
import pytest
import torch
from torch import Tensor

from shading_scenes import as_codes, scene_of_all, views
from torchrender.errors import InputError
from torchrender.kernels.shading.records import LEVELS
from torchrender.numerics.color import linear_from_srgb
from torchrender.numerics.texels.coded import CodedTexture, codes_of, is_followed, room_for
from torchrender.numerics.texels.halving import halved
from torchrender.numerics.texture import (
    Addressing,
    build_pyramid,
    channels_of,
    halved_texture,
    pyramid_of,
    sample_texture,
    texture_pyramid,
)
from torchrender.raster import rasterize_visibility
from torchrender.scene.material import Material
from torchrender.scene.material_table import MaterialTable
from torchrender.shading.fused import send_fused
from torchrender.shading.lobes import Around
from torchrender.shading.looks import looks_of

RNG = np.random.default_rng(5)
SMALLEST_STEP = 1 / 255 / 12.92


def texture(height: int = 13, width: int = 22, channels: int = 4, colors: int = 3) -> CodedTexture:
    codes = RNG.integers(0, 256, (height, width, channels), dtype=np.uint8)
    codes[0, 0], codes[-1, -1] = 0, 255
    return CodedTexture(codes, colors)


def test_it_is_the_tensor_of_its_numbers() -> None:
    one = texture()
    shares = torch.from_numpy(one.codes.astype(np.float64)) / 255
    wanted = torch.cat([linear_from_srgb(shares[..., :3]), shares[..., 3:]], dim=-1).float()
    assert isinstance(one, Tensor) and one.dtype == torch.float32 and one.shape == (13, 22, 4)
    assert torch.equal(one.clone(), wanted) and torch.equal(torch.cat([one, one]), torch.cat([wanted, wanted]))
    assert torch.equal(one * 2.0, wanted * 2.0) and float(one.max()) == 1.0 and bool(one.mean() == wanted.mean())
    assert torch.equal(channels_of(one, 2, 4), wanted[..., 2:4])
    assert torch.equal(torch.zeros(13, 22, 4).copy_(one), wanted)
    assert one.float() is one and one.contiguous() is one and not one.requires_grad
    for other in (copy.deepcopy(one), pickle.loads(pickle.dumps(one))):
        assert codes_of(other) is not None and torch.equal(other, wanted)
    assert codes_of(one) is not None, "nothing of this made it keep its numbers"
    assert f"{one:}" == f"{wanted:}"


CHANGES: dict[str, Callable[[Tensor], object]] = {
    "in place": lambda t: t.mul_(0.5),
    "an item": lambda t: t.__setitem__((0, 0), 7.0),
    "a part of it": lambda t: t[..., 0].fill_(3.0),
    "as another shape": lambda t: t.view(-1).fill_(3.0),
    "through numpy": lambda t: t.numpy().fill(5.0),
    "as an output": lambda t: torch.add(torch.ones(13, 22, 4), 1.0, out=t),
    "by other data": lambda t: setattr(t, "data", torch.full((13, 22, 4), 2.0)),
    "by the memory of another": lambda t: t.set_(torch.full((13, 22, 4), 2.0)),
    "through what is detached": lambda t: t.detach().fill_(4.0),
    "through a shallow copy": lambda t: copy.copy(t).fill_(4.0),
    "through DLPack": lambda t: torch.from_dlpack(t).fill_(4.0),
    "a part of it in inference mode": lambda t: in_inference_mode(lambda: t[2:5].fill_(4.0)),
    "by a function in place": lambda t: torch.nn.functional.threshold(t, 0.5, 9.0, inplace=True),
    "inside vmap": lambda t: torch.vmap(lambda row: row[0].fill_(4.0))(t),
    "through a view that a function without a schema gives": lambda t: torch.broadcast_tensors(t)[0].fill_(4.0),
}


def in_inference_mode(do: Callable[[], object]) -> object:
    with torch.inference_mode():
        return do()


ASKED: dict[str, Callable[[Tensor], object]] = {
    "detached": lambda t: t.detach().requires_grad_(),
    "a parameter": lambda t: torch.nn.Parameter(t),
    "a clone": lambda t: t.clone().requires_grad_(),
    "a copy": lambda t: copy.deepcopy(t).requires_grad_(),
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_whoever_changes_it_changes_it(change: Callable[[Tensor], object]) -> None:
    one = texture()
    plain = one.clone()
    assert type(plain) is Tensor
    change(one)
    change(plain)
    assert torch.equal(one, plain) and codes_of(one) is None
    assert torch.equal(one[3:], plain[3:]) and codes_of(copy.deepcopy(one)) is None
    assert type(one) is Tensor and one.is_leaf


@pytest.mark.parametrize("ask", ASKED.values(), ids=ASKED)
def test_what_is_made_of_it_asks_for_gradients_alone(ask: Callable[[Tensor], Tensor]) -> None:
    one = texture()
    made = ask(one)
    assert made is not one and made.requires_grad and made.is_leaf and not one.requires_grad
    made.sum().backward()
    assert made.grad is not None and one.grad is None
    assert copy.deepcopy(one.requires_grad_()).is_leaf


def test_its_size_may_change() -> None:
    one = texture()
    wanted = one.clone().view(-1)[:60].view(3, 5, 4)
    assert one.resize_(3, 5, 4) is one
    assert one.shape == (3, 5, 4) and torch.equal(one, wanted) and len(one) == 3


def test_inference_mode_computes_with_it() -> None:
    one = texture()
    wanted = one.clone()
    with torch.inference_mode():
        assert torch.equal(one, wanted) and bool(one.mean() == wanted.mean()) and codes_of(one) is not None
        assert torch.equal(one[..., :3], wanted[..., :3]) and np.array_equal(one.numpy(), wanted.numpy())
        made = texture()
    assert float(made.max()) == 1.0 and not made.is_inference() and not one.is_inference()
    assert one.requires_grad_().requires_grad, "it is an ordinary tensor outside"


def test_what_is_saved_is_a_tensor_to_whoever_loads_it() -> None:
    one = texture()
    file = io.BytesIO()
    torch.save({"one": one, "again": one, "other": texture()}, file)
    file.seek(0)
    found = torch.load(file, weights_only=True)  # noqa: TID251  # tensors only
    assert type(found["one"]) is Tensor and torch.equal(found["one"], one) and found["again"] is found["one"]
    assert codes_of(one) is not None, "saving leaves it as it is"


def test_vmap_reads_it() -> None:
    one = texture()
    wanted = one.clone()
    assert torch.equal(torch.vmap(lambda row: row[0] * 2.0)(one), wanted[:, 0] * 2.0)
    assert torch.equal(one, wanted)


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_what_is_not_finite_is_named(value: float) -> None:
    """The kernel makes indices of such numbers."""
    for one in (texture(8, 8, 3), texture(8, 8, 3).clone()):
        material = Material(name="wall", diffuse_texture=one)
        one[2, 3, 1] = value
        with pytest.raises(InputError, match=r"material 'wall': diffuse_texture must be finite: 1 of 192"):
            looks_of([material], MaterialTable.of([material]))
        one.clamp_(max=1.0).nan_to_num_()
        looks_of([material], MaterialTable.of([material]))
    color = Material(name="wall", diffuse=torch.ones(3))
    color.diffuse.fill_(value)
    with pytest.raises(InputError, match="diffuse of the materials must be finite"):
        looks_of([color], MaterialTable.of([color]))


def test_gradients_reach_it() -> None:
    one = texture()
    assert one.requires_grad_(True) is one
    (one**2).sum().backward()
    assert one.grad is not None and torch.equal(one.grad, 2.0 * one.detach())
    assert codes_of(one) is None
    two = texture(8, 8, 3)
    weight = torch.ones(8, 8, 3, requires_grad=True)
    (two * weight).sum().backward()
    assert torch.equal(weight.grad, two.clone()) and codes_of(two) is not None


def test_changes_show_in_pictures() -> None:
    one = texture(8, 8, 3)
    material = Material(diffuse_texture=one)
    assert material.diffuse_texture is one and codes_of(one) is not None
    first = texture_pyramid(one)
    assert texture_pyramid(one) is first
    one[0, 0] = 1.0
    assert float(texture_pyramid(one).take(torch.tensor([0])).min()) == 1.0
    before = looks_of([material], MaterialTable.of([material]))
    one.data = torch.full((8, 8, 3), 0.25)
    assert float(texture_pyramid(one).take(torch.tensor([0])).max()) == 0.25
    assert looks_of([material], MaterialTable.of([material])).texels.max() == 0.25 < before.texels.max()


@pytest.mark.parametrize("shape", [(64, 32, 3), (13, 22, 4), (1, 9, 4), (1, 1, 3), (256, 128, 1)])
def test_levels_are_those_of_the_numbers(shape: tuple[int, int, int]) -> None:
    one = texture(*shape)
    coded, plain = build_pyramid(one), build_pyramid(one.clone())
    rows = torch.arange(int((plain.width * plain.height).sum()))
    count = shape[0] * shape[1]
    found, wanted = coded.take(rows), plain.take(rows)
    assert torch.equal(found[:count], wanted[:count])
    off = (found[count:] - wanted[count:]).abs()
    assert not len(off) or float(off.max()) < 0.15 * SMALLEST_STEP
    assert torch.equal(coded.offset, plain.offset) and torch.equal(coded.width, plain.width)
    assert is_followed(coded.codes) and is_followed(coded.coarser)


def test_textures_of_one_size_lie_side_by_side() -> None:
    parts = [texture(8, 6, 3), texture(8, 6, 2, 0), texture(8, 6, 4)]
    together, plain = pyramid_of(parts), pyramid_of([part.clone() for part in parts])
    rows = torch.arange(48)
    assert torch.equal(together.take(rows), plain.take(rows))
    mixed = pyramid_of([parts[0], parts[1].clone()])
    assert torch.equal(mixed.take(rows), plain.take(rows)[:, :5])


@pytest.mark.parametrize("filtering", ["trilinear", "bilinear", "nearest"])
def test_look_ups(filtering: str) -> None:
    one = texture(32, 48, 4)
    uv, width = torch.rand(200, 2) * 3 - 1, torch.rand(200) * 0.3
    found = sample_texture(texture_pyramid(one), uv, width, Addressing(filter=filtering))
    wanted = sample_texture(build_pyramid(one.clone()), uv, width, Addressing(filter=filtering))
    exact = filtering != "trilinear"
    torch.testing.assert_close(found, wanted, atol=0 if exact else 2e-5, rtol=0)


@pytest.mark.parametrize("shape", [(64, 48, 3), (63, 48, 4), (1, 5, 3)])
def test_halves_are_the_nearest_codes(shape: tuple[int, int, int]) -> None:
    one = texture(*shape)
    made, means = halved_texture(one), halved(one.clone())
    assert codes_of(made) is not None and made.shape == means.shape
    steps = torch.from_numpy(np.arange(257) / 255.0)
    around = linear_from_srgb(steps)
    codes = torch.from_numpy(made.codes.astype(np.int64))
    half = (around[codes + 1] - around[codes]) / 2
    half[..., 3:] = 0.5 / 255
    assert bool(((made.numbers() - means).abs() <= 1.1 * half).all())


def test_pictures_of_the_finest_level_are_the_same_bit_by_bit() -> None:
    """The kernel reads codes as it reads their numbers; coarser levels differ by their rounding."""
    scene = scene_of_all()
    coded = as_codes(scene)
    plain = coded.replace(
        materials=tuple(
            Material(**{**vars(m), **{n: v.clone() for n, v in vars(m).items() if codes_of_any(v)}})
            for m in coded.materials
        )
    )
    near, far = views(64, 48), views(16, 12)
    for seen_by, limit in ((near, 2e-4), (far, 2e-4)):
        seen = rasterize_visibility(scene.geometry, seen_by)
        a, b = (send_fused(s, seen, None, Around(), ("polygon", None, True)).radiance for s in (coded, plain))
        assert float((a - b).abs().max()) <= limit * float(b.max())
    table = looks_of(coded.materials, coded.material_table)
    assert int((table.groups[:, 7] > 0).sum()) == len(table.groups) and table.texels.size == 0
    assert table.groups.shape[1] > LEVELS and is_followed(table.codes) and is_followed(table.coarser)


def codes_of_any(value: object) -> bool:
    return isinstance(value, CodedTexture)


def test_room_behind() -> None:
    assert is_followed(room_for((2, 3), np.uint8)) and not is_followed(np.zeros((2, 3), np.uint8))
    assert not is_followed(np.zeros(12, np.uint8)[:10]) and is_followed(np.zeros(12, np.uint8)[:9])
