"""Pictures at another size: PyTorch's own numbers, and the same for any number of threads."""

from __future__ import annotations

from pathlib import Path

import numba
import pytest
import torch

import torchrender
from torchrender.kernels.threads import most_threads
from torchrender.numerics.texels.scaling import scaled_bilinearly
from torchrender.scene.environment import Environment
from torchrender.scene.sky.prefilter import FilteredSky


@pytest.fixture
def threads():
    """Of PyTorch and of the kernels: these share a library, and the last one asked decides."""
    before = torch.get_num_threads(), numba.get_num_threads()

    def use(count: int) -> None:
        torch.set_num_threads(count)
        numba.set_num_threads(min(count, most_threads()))

    yield use
    torch.set_num_threads(before[0])
    numba.set_num_threads(before[1])


@pytest.mark.parametrize("channels", [1, 3, 4])
@pytest.mark.parametrize("aligned", [False, True])
def test_it_is_what_pytorch_makes_of_each_channel(channels: int, aligned: bool, threads) -> None:
    picture = torch.rand(2, 33, 41, channels, generator=torch.Generator().manual_seed(1)).permute(0, 3, 1, 2)
    made = []
    for count in (1, 2, 3):
        threads(count)
        made.append(scaled_bilinearly(picture, (77, 30), align_corners=aligned))
    ours = made[0]
    assert all(torch.equal(ours, other) for other in made)
    theirs = torch.nn.functional.interpolate(picture, (77, 30), mode="bilinear", align_corners=aligned)
    torch.testing.assert_close(ours, theirs, rtol=1e-5, atol=1e-6)


def test_nothing_that_renders_scales_in_another_way() -> None:
    files = [f for f in Path(torchrender.__file__).parent.rglob("*.py") if not {"report", "tuning"} & set(f.parts)]
    own = [f.name for f in files if "bilinear" in f.read_text() and "functional.interpolate(" in f.read_text()]
    assert sorted(own) == ["resample.py", "scaling.py"]
    resample = next(f for f in files if f.name == "resample.py").read_text()
    assert all('mode="bilinear"' not in line for line in resample.splitlines() if "functional.interpolate(" in line)


def test_gradients_pass() -> None:
    picture = torch.rand(1, 3, 4, 5, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda p: scaled_bilinearly(p, (7, 3)), picture)


def test_filtered_skies_are_the_same_for_any_number_of_threads(threads) -> None:
    sky = torch.rand(64, 128, 3, generator=torch.Generator().manual_seed(2))
    made = []
    for count in (1, 2):
        threads(count)
        made.append(FilteredSky.of(Environment(radiance=sky).radiance).levels)
    assert torch.equal(*made)
