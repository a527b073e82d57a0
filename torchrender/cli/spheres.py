"""The command ``torchrender spheres``: spheres that stand for a model in shadows, and a picture of both."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchrender.cli.arguments import add_scene, add_size, load_scene
from torchrender.cli.files.kept import beside
from torchrender.cli.output import check_file, check_output, image_size
from torchrender.errors import InputError, OptionError

if TYPE_CHECKING:
    from torchrender.effects.sky_shadows.fit import SphereSet
    from torchrender.scene.model import Scene

SEGMENTS = 24


def add_spheres(commands: Any) -> None:
    """Describe the command to the parser."""
    parser = commands.add_parser("spheres", help="fit spheres to a model, for shadows under the sky")
    add_scene(parser)
    parser.add_argument(
        "-o", "--output", required=True, metavar="FILE", help="set.npz; a picture set_spheres.png comes beside it"
    )
    parser.add_argument("-n", "--spheres", type=int, default=64, metavar="N", help="number of spheres (default 64)")
    parser.add_argument("--resolution", type=int, default=64, metavar="N", help="cells of the solid's longest side")
    parser.add_argument(
        "--starts", type=int, default=3, metavar="N", help="random starts; the best is kept (default 3)"
    )
    parser.add_argument("--seed", type=int, default=0, help="of the random starts")
    add_size(parser, "1024x512")


def run_spheres(arguments: argparse.Namespace) -> None:
    """Fit, write the set, and draw model and spheres side by side."""
    from torchrender.effects.sky_shadows.fit import fit_spheres
    from torchrender.effects.sky_shadows.occluder import joined, write_spheres
    from torchrender.effects.sky_shadows.options import SphereOptions

    output = Path(arguments.output)
    check_output(output, (".npz",))
    check_file(beside(output, "spheres.png"))
    size = image_size(arguments.size)
    if not 8 <= arguments.resolution <= 256:
        raise OptionError(f"--resolution must be in [8, 256], got {arguments.resolution}")
    options = SphereOptions(
        spheres=arguments.spheres, resolution=arguments.resolution, starts=arguments.starts, seed=arguments.seed
    )
    scene = load_scene(arguments)
    if not scene.geometry.triangle_count:
        raise InputError(f"{arguments.scene} has no triangles to fit spheres to")
    vertices, faces = joined(scene.meshes)
    with _Bar() as bar:
        spheres = fit_spheres(vertices, faces, options, bar)
    write_spheres(output, spheres)
    picture = beside(output, "spheres.png")
    _draw(scene, spheres, picture, size)
    print(
        f"{output}  {len(spheres.radii)} spheres, {100 * spheres.relative_error:.1f} % of the model's volume stand out"
        f"\n{picture}"
    )


class _Bar:
    """A progress bar on stderr, if somebody is watching."""

    def __init__(self) -> None:
        import sys

        self._bar: Any = None
        self._watched = sys.stderr.isatty()

    def __enter__(self) -> _Bar:
        return self

    def __call__(self, done: int, total: int) -> None:
        if not self._watched:
            return
        if self._bar is None:
            from tqdm import tqdm

            self._bar = tqdm(total=total, unit="steps")
        self._bar.update(done - self._bar.n)

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.close()


def _draw(scene: Scene, spheres: SphereSet, path: Path, size: tuple[int, int]) -> None:
    """Model left, spheres right, seen alike."""
    from dataclasses import replace

    import torch

    from torchrender.images.files import write_image
    from torchrender.renderer import render
    from torchrender.scene.material import Material
    from torchrender.scene.mesh import Mesh
    from torchrender.scene.model import Scene
    from torchrender.scene.shapes import sphere

    ball = sphere(1.0, SEGMENTS)
    unit = ball.normals
    hues = torch.rand(len(spheres.radii), 3, generator=torch.Generator().manual_seed(1)) * 0.6 + 0.3
    used = [k for k in range(len(spheres.radii)) if float(spheres.radii[k]) > 0]
    vertices = torch.cat([spheres.centres[k] + spheres.radii[k] * ball.vertices.double() for k in used])
    faces = torch.cat([ball.faces + n * len(ball.vertices) for n in range(len(used))])
    colors = torch.cat([hues[k].expand(len(ball.vertices), 3) for k in used])
    normals = None if unit is None else unit.repeat(len(used), 1)
    balls = Mesh(vertices=vertices, faces=faces, normals=normals, colors=colors, name="spheres")
    width, height = max(size[0] // 2, 1), size[1]
    model = replace(scene, cameras={})
    camera = model.camera(width=width, height=height)
    white = Scene(meshes=(balls,), materials=(Material(name="white", diffuse=torch.ones(3)),), name="spheres")
    pictures = [render(one, camera).displayed()[0] for one in (model, white)]
    write_image(path, torch.cat(pictures, dim=1))
