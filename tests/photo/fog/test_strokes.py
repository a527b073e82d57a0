"""Photos divided by strokes, and the regions that come of it."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from torchrender.errors import InputError, OptionError
from torchrender.photo.fog.depth.labels import label_map
from torchrender.photo.fog.depth.strokes import Stroke, divide, painted, regions_of
from torchrender.photo.fog.marks.records import LABELS, Marks

H, W = 96, 128
LINES = {0: ((10.0, 85.0), (118.0, 85.0)), 1: ((20.0, 40.0), (30.0, 60.0)), 2: ((70.0, 10.0), (120.0, 12.0)),
         3: ((95.0, 50.0), (100.0, 60.0))}  # fmt: skip


def scene() -> tuple[Tensor, Tensor]:
    """A photo with grain, and what is where: ground, a house, sky, another house with a hole of sky in it."""
    truth = torch.full((H, W), 2)
    truth[64:] = 0
    truth[24:70, 10:44] = 1
    truth[34:72, 80:116] = 3
    truth[40:48, 100:108] = 2
    colors = torch.tensor([[0.1, 0.25, 0.08], [0.3, 0.1, 0.06], [0.5, 0.6, 0.9], [0.25, 0.22, 0.2]])
    grain = 0.04 * torch.rand(H, W, 3, generator=torch.Generator().manual_seed(5))
    return colors[truth] + grain, truth


def seeds(*parts: int) -> Tensor:
    return painted([Stroke(part=p, points=LINES[p], width=5.0) for p in parts], H, W)


def test_a_few_strokes_divide_a_photo() -> None:
    photo, truth = scene()
    found = divide(photo, seeds(0, 1, 2, 3))
    assert found.shape == (H, W) and found.dtype == torch.int64
    hole = torch.zeros(H, W, dtype=torch.bool)
    hole[39:49, 99:109] = True
    wrong = (found != truth) & ~hole
    assert float(wrong.float().mean()) < 0.02
    drawn = seeds(0, 1, 2, 3)
    assert bool((found[drawn >= 0] == drawn[drawn >= 0]).all()), "what was drawn is what it was drawn as"
    assert torch.equal(found, divide(photo, drawn)), "the same again"


def test_regions_show_the_parts_again() -> None:
    _, truth = scene()
    labels = ("ground", "vertical", "sky", "vertical")
    regions = regions_of(truth, labels, (None, 12.0, None, None))
    shown = label_map(Marks(regions=tuple(regions)), W, H)
    wanted = torch.tensor([LABELS.index(name) for name in labels])[truth]
    assert float((shown != wanted).float().mean()) < 0.005, "the hole in the house included"
    depths = sorted((r.depth or 0.0) for r in regions if r.label == "vertical")
    assert depths == [0.0, 12.0] and all(r.depth is None for r in regions if r.label != "vertical")


def test_strokes_are_painted_one_over_the_other() -> None:
    one = Stroke(part=0, points=((10.5, 10.5), (30.5, 10.5)), width=3.0)
    dot = Stroke(part=4, points=((20.5, 10.5),), width=5.0)
    mask = painted([one, dot], 20, 40)
    assert mask[10, 12] == 0 and mask[10, 20] == 4 and mask[15, 20] == -1
    assert int((mask == 4).sum()) == pytest.approx(25 * 0.785, abs=6)
    assert bool((painted([], 4, 4) == -1).all())
    outside = painted([Stroke(part=1, points=((-900.0, 5.0), (900.0, 5.0)))], 10, 10)
    assert bool((outside == 1).any()), "strokes may leave the photo"


def test_bad_strokes_are_named() -> None:
    photo, _ = scene()
    with pytest.raises(InputError, match="at least two parts"):
        divide(photo, seeds(0))
    with pytest.raises(InputError, match="seeds"):
        divide(photo, seeds(0, 1)[:10])
    with pytest.raises(InputError, match="at least one point"):
        Stroke(part=0, points=())
    with pytest.raises((InputError, OptionError), match="stroke part"):
        Stroke(part=99, points=((1.0, 1.0),))
    with pytest.raises(InputError, match="labels must name every part"):
        regions_of(torch.tensor([[0, 1], [2, 2]]), ("ground", "sky"))


def test_hard_photos_are_divided() -> None:
    flat = torch.full((H, W, 3), 0.4)
    halves = divide(flat[::2, ::2].contiguous(), seeds(0, 2)[::2, ::2])
    assert set(halves.unique().tolist()) == {0, 2}, "without any edge, too"
    tiny = divide(torch.rand(3, 3, 3), torch.tensor([[0, 0, 0], [-1, -1, -1], [1, 1, 1]]))
    assert tiny.shape == (3, 3) and tiny[0].eq(0).all() and tiny[2].eq(1).all()
    dark = divide(0.0 * flat[::2, ::2], seeds(0, 1, 2)[::2, ::2])
    assert bool((dark >= 0).all())
