"""What the soft-shadow study looks at: scenes, lights, pictures."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from torchrender.buffers import GBuffer
from torchrender.checks import checked_fields
from torchrender.effects.shadows.occluders import MESHES
from torchrender.effects.shadows.soft_shadow import LightVisibility, Occluders, SoftShadowOptions, soft_shadow
from torchrender.raster import rasterize
from torchrender.report.common.subject import own_direction, subject_box
from torchrender.scene.camera import Cameras
from torchrender.scene.light import RectLight
from torchrender.scene.model import Scene

SCENES = ("nest", "grass", "city", "tree")


@dataclass(frozen=True, kw_only=True)
@checked_fields
class StudyOptions:
    """How much is measured."""

    scenes: tuple[str, ...] = SCENES
    picture: int = 64  # pixels of the output's side where errors are taken
    timed_picture: int = 512  # and where times are
    size: int = 512  # pixels of a reference image
    timed_size: int = 1024  # and where times are taken
    larger: tuple[tuple[str, int], ...] = (("city", 1024),)  # scenes that are also seen by such reference images
    meshes: tuple[str, ...] = MESHES
    swept: tuple[str, ...] = ("city",)  # scenes of the sweeps over lights, meshes, and each of our changes
    literal: tuple[str, ...] = ("nest", "city")  # scenes where the source is taken to the letter
    ratios: tuple[float, ...] = (0.25, 1.0, 4.0)  # light diagonal over scene diagonal
    timed: tuple[tuple[str, int], ...] = (  # scenes and triangle counts
        ("city", 1_000_000), ("city", 3_000_000), ("nest", 1_000_000)
    )  # fmt: skip
    light_samples: int = 16
    ray_pixels: int = 2000  # pixels whose rays are traced one by one
    penumbra_scenes: tuple[str, ...] = ("cornell_box", "living_room", "washroom")
    penumbra_picture: int = 256
    penumbra_pixels: int = 500  # of which 4,096 rays each are traced
    sample_counts: tuple[int, ...] = (8, 16, 24)


QUICK = StudyOptions(
    scenes=("city",), picture=48, timed_picture=64, size=64, timed_size=96, larger=(("city", 96),), ratios=(0.5, 1.0),
    swept=("city",), literal=("city",), timed=(("city", 5_000),), light_samples=4, ray_pixels=20,
    penumbra_scenes=("cornell_box",), penumbra_picture=48, penumbra_pixels=50, sample_counts=(8, 16),
)  # fmt: skip


def study_light(box: Tensor, ratio: float = 1.0) -> RectLight:
    """The square light of the study: 0.75 diagonals above the centre of a box (2,3), facing down."""
    diagonal = float((box[1] - box[0]).norm())
    side = ratio * diagonal / 2**0.5
    centre = box.mean(0) + torch.tensor([0.0, 0.75 * diagonal, 0.0], dtype=torch.float64)
    corner = centre - torch.tensor([side / 2, 0.0, side / 2], dtype=torch.float64)
    return RectLight(corner=corner, edge_u=torch.tensor([side, 0.0, 0.0]), edge_v=torch.tensor([0.0, 0.0, side]))


@dataclass(frozen=True, eq=False)
class Subject:
    """What a scene is asked about: the light and its cameras go by the subject's box, the picture shows the subject."""

    scene: Scene
    box: Tensor  # (2,3)
    view: GBuffer

    @classmethod
    def of(cls, scene: Scene, side: int) -> Subject:
        """From obliquely above on the scene's own side, one diagonal away."""
        box = subject_box(scene)
        direction = torch.nn.functional.normalize(own_direction(scene) * torch.tensor([1.0, 0.0, 1.0]), dim=0)
        direction = torch.nn.functional.normalize(direction + torch.tensor([0.0, 0.7, 0.0]), dim=0)
        diagonal = float((box[1] - box[0]).norm())
        eye = box.mean(0) + direction * diagonal
        camera = Cameras.look_at(eye, box.mean(0), width=side, height=side, fov_deg=45.0, near=1e-3 * diagonal)
        return cls(scene, box, rasterize(scene, camera))

    def lit(self, casters: Occluders, ratio: float, options: SoftShadowOptions) -> LightVisibility:
        """Light visibility in the picture, with the light of this size."""
        return soft_shadow(casters, study_light(self.box, ratio), self.view, options, bounds=self.box)
