"""Numbers of materials side by side: rows, the row of empty pixels, and what may be kept."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from torchrender.scene.material import Material
from torchrender.scene.material_table import MaterialTable
from torchrender.scene.model import Scene

CLAY = Material(diffuse=torch.tensor([0.3, 0.2, 0.1]), specular=0.05, shininess=7.0)
BRASS = Material(
    diffuse=torch.tensor([0.1, 0.1, 0.0]), specular=0.9, specular_color=torch.tensor([1.0, 0.8, 0.3]), gloss=0.2
)
LAMP = Material(emission=torch.tensor([5.0, 4.0, 3.0]))
MATERIALS = (CLAY, BRASS, LAMP)


def test_each_row_holds_its_material():
    table = MaterialTable.of(MATERIALS)
    for index, material in enumerate(MATERIALS):
        assert torch.equal(table.diffuse[index], material.diffuse)
        assert torch.equal(table.tint[index], material.specular_color)
        assert torch.equal(table.highlight[index], material.specular * material.specular_color)
        assert torch.equal(table.emission[index], material.emission)
        assert float(table.specular[index]) == pytest.approx(material.specular, abs=1e-7)
        assert float(table.shininess[index]) == material.shininess
        assert float(table.gloss[index]) == material.gloss  # float64: exactly
    assert table.is_reflector.tolist() == [False, True, False, False]
    assert table.mirrored.tolist() == pytest.approx([0.0, 0.9, 0.0, 0.0])


def test_an_empty_pixel_finds_nothing():
    table = MaterialTable.of(MATERIALS)
    columns = [column for column in vars(table).values() if isinstance(column, torch.Tensor)]
    assert len(columns) >= 8 and all(len(column) == 4 and not bool(column[-1].any()) for column in columns)


def test_built_once_for_a_scene_and_anew_for_another():
    scene = Scene(materials=MATERIALS)
    assert scene.material_table is scene.material_table
    painted = replace(scene, materials=(replace(CLAY, diffuse=torch.ones(3)), BRASS, LAMP))
    assert painted.material_table.diffuse[0].tolist() == [1.0, 1.0, 1.0]


@pytest.mark.parametrize("name", ["diffuse", "specular_color", "emission"])
def test_gradients_reach_the_materials_call_after_call(name):
    color = torch.tensor([0.5, 0.5, 0.5], requires_grad=True)
    scene = Scene(materials=(CLAY, replace(BRASS, **{name: color})))
    for _ in range(2):  # a kept table would have lost its graph the second time
        color.grad = None
        table = scene.material_table
        (table.diffuse + table.highlight + table.emission)[1].square().sum().backward()
        assert color.grad is not None and bool((color.grad > 0).all())


def test_what_is_first_asked_for_without_gradients_can_still_be_derived_later():
    scene = Scene(materials=MATERIALS)
    with torch.inference_mode():
        assert scene.material_table.diffuse.shape == (4, 3)
    factor = torch.ones(4, 3, requires_grad=True)
    (factor * scene.material_table.diffuse).sum().backward()
    assert factor.grad is not None and torch.equal(factor.grad[0], CLAY.diffuse)
