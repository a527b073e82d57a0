"""Options of every class refuse what is not of the type that their fields declare."""

from __future__ import annotations

import dataclasses
import importlib
import re
import types
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Union, get_args, get_origin, get_type_hints

import numpy as np
import pytest
import torch

import torchrender as tr
from torchrender.checks import checked_fields
from torchrender.errors import InputError, OptionError
from torchrender.passes.table import PASSES

ROOT = Path(__file__).resolve().parent.parent
HOMES = (ROOT, ROOT / "service")
CLASS = re.compile(r"^class (\w+Options)\b", re.MULTILINE)
WRONG: dict[Any, tuple[Any, ...]] = {
    bool: ("off", 0, 1, 2.5),
    int: (2.5, "3", True, float("nan")),
    float: ("3", float("nan"), True),
    str: (3, False),
}
EXTRAS = ("ray",)
"""Packages that need not be there: what is read through them alone is not tested."""
BEYOND: dict[Any, tuple[Any, ...]] = {int: (-(10**12),), float: (-1e305,), str: ("no such choice",)}


def option_classes() -> Iterator[type]:
    for home in HOMES:
        for path in sorted(home.glob("torchrender*/**/*.py")):
            for name in CLASS.findall(path.read_text()):
                module = ".".join(path.relative_to(home).with_suffix("").parts)
                try:
                    yield getattr(importlib.import_module(module), name)
                except ModuleNotFoundError as error:
                    if error.name not in EXTRAS:
                        raise


CLASSES = list(option_classes())
SHOWN = [kind for kind in CLASSES if ".report." not in kind.__module__ and "_service" not in kind.__module__]


def alternatives(hint: Any) -> tuple[Any, ...]:
    return get_args(hint) if get_origin(hint) in (Union, types.UnionType) else (hint,)


def wrong_values(hint: Any) -> Iterator[Any]:
    """Values of no type that a field may have."""
    kinds = alternatives(hint)
    if Any in kinds:
        return
    if type(None) not in kinds:
        yield None
    for kind in kinds:
        for value in WRONG.get(kind, ("x", 3, object())):
            fits = type(value) in kinds or (type(value) is int and float in kinds) or (value != value and kind is str)
            if not fits:
                yield value


def with_field(kind: type, name: str, value: Any) -> Any:
    needed = {f.name: None for f in dataclasses.fields(kind) if f.init and f.default is f.default_factory}
    return kind(**needed | {name: value})


@pytest.mark.parametrize("kind", CLASSES, ids=lambda kind: f"{kind.__module__}.{kind.__name__}")
def test_every_field_refuses_values_of_other_types(kind: type) -> None:
    hints = get_type_hints(kind)
    tried = 0
    for field in dataclasses.fields(kind):
        for value in wrong_values(hints[field.name]):
            with pytest.raises(OptionError, match=field.name):
                with_field(kind, field.name, value)
            tried += 1
    assert tried


@pytest.mark.parametrize("kind", SHOWN, ids=lambda kind: f"{kind.__module__}.{kind.__name__}")
def test_every_number_has_a_least_value_and_every_name_its_choices(kind: type) -> None:
    hints = get_type_hints(kind)
    for field in dataclasses.fields(kind):
        for one in alternatives(hints[field.name]):
            for value in BEYOND.get(one, ()):
                with pytest.raises(InputError, match=field.name):
                    kind(**{field.name: value})


def test_every_exported_class_is_walked() -> None:
    exported = {getattr(tr, name) for name in tr.__all__ if name.endswith("Options")}
    assert len(exported) > 10
    assert exported <= set(SHOWN)


@dataclass(frozen=True, kw_only=True)
@checked_fields
class Sample:
    name: str = "a"
    pair: tuple[int, int] = (1, 2)
    names: tuple[str, ...] | None = ()
    share: float | None = None


def test_lists_are_kept_as_tuples_and_numbers_of_other_libraries_as_they_are() -> None:
    made = Sample(pair=[3, 4], names=["b"], share=np.float32(0.5))  # type: ignore[arg-type]
    assert made.pair == (3, 4)
    assert made.names == ("b",)
    assert made.share == 0.5
    assert Sample(share=torch.tensor(2.0)).share == 2.0  # type: ignore[arg-type]
    assert Sample(share=3).share == 3


def test_the_error_names_field_type_and_value() -> None:
    with pytest.raises(OptionError, match=r"pair must be 2 values, each an integer, got \(1, 2, 3\)"):
        Sample(pair=(1, 2, 3))  # type: ignore[arg-type]
    with pytest.raises(OptionError, match="names must be a tuple, each text or None, got 'depth'"):
        Sample(names="depth")  # type: ignore[arg-type]
    with pytest.raises(OptionError, match=r"names must be a tuple.*\.\.\.$"):
        Sample(names="x" * 500)  # type: ignore[arg-type]


def test_an_annotation_that_cannot_be_checked_is_no_options_field() -> None:
    @dataclass(frozen=True)
    @checked_fields
    class Odd:
        made: type[int] = int

    with pytest.raises(TypeError, match="no way to check"):
        Odd()


@pytest.mark.parametrize("name", ["unlit", "double_sided", "blend"])
def test_flags_of_materials_are_true_or_false(name: str) -> None:
    with pytest.raises(OptionError, match=f"material 'pane': {name} must be True or False, got 'off'"):
        tr.Material(name="pane", **{name: "off"})
    with pytest.raises(OptionError, match="photometric must be True or False, got 'no'"):
        tr.Scene(photometric="no")


def test_a_table_of_passes_holds_passes() -> None:
    for wrong in ((), ("gbuffer",)):
        with pytest.raises(OptionError, match="passes must be a table of passes"):
            tr.RenderOptions(passes=wrong)
    assert tr.RenderOptions(exposure="auto").exposure is None
    with pytest.raises(OptionError, match=r'exposure must be a number \(EV\), "auto" or "as_lit"'):
        tr.RenderOptions(exposure="wat")


def test_a_background_is_a_tensor_a_sequence_or_a_number() -> None:
    for given in (torch.tensor([0.1, 0.2, 0.3]), (0.1, 0.2, 0.3), [0.1, 0.2, 0.3], np.ones(3), 0.5, None):
        assert tr.RenderOptions(background=given).background is given
    with pytest.raises(OptionError, match="background must be Tensor or a sequence or a number or None, got 'red'"):
        tr.RenderOptions(background="red")


@pytest.mark.parametrize("name", ["gbuffer", "composite", "resample"])
def test_a_table_of_passes_that_makes_no_picture_is_refused(name: str) -> None:
    options = tr.RenderOptions(passes=tuple(one for one in PASSES if one.name != name))
    with pytest.raises(OptionError, match=r"passes: this table makes no picture: .*nobody makes"):
        tr.render("cornell_box", width=16, height=12, options=options)


def test_tensors_without_numbers_are_refused_by_name() -> None:
    """Kernels read the CPU's memory: what lies elsewhere, or nowhere, fails deep inside them."""
    corner = torch.zeros(3, 3, device="meta")
    with pytest.raises(InputError, match="vertices must be on the CPU, is on the device meta"):
        tr.Mesh(vertices=corner, faces=torch.tensor([[0, 1, 2]]))
