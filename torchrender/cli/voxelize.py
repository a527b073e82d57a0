"""The command ``torchrender voxelize``, and what ``torchrender info`` says about voxel files."""

from __future__ import annotations

import argparse
import sys
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchrender.cli.arguments import add_scene, add_size, load_scene, say_idle
from torchrender.cli.output import check_output
from torchrender.errors import EmptyWarning, OptionError

if TYPE_CHECKING:
    from torch import Tensor

    from torchrender.scene.model import Scene
    from torchrender.voxels.file import VoxelModel
    from torchrender.voxels.grid import VoxelGrid

SUFFIXES = (".npz", ".vox", ".png")
PICTURE = ("size", "transparent")
"""Options of pictures alone."""


def add_voxelize(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    add_scene(parser)
    parser.add_argument("-o", "--output", required=True, metavar="FILE", help="voxels .npz or .vox, or a picture .png")
    parser.add_argument("--resolution", type=int, default=256, metavar="N", help="cells of the longest side, 1 to 2048")
    parser.add_argument("--solid", action="store_true", help="the inside instead of the surface")
    parser.add_argument("--thin", action="store_true", help="surface sampled at cell columns: fewer cells, may leak")
    parser.add_argument(
        "--method",
        choices=("winding", "parity", "vote", "soup"),
        help="how the inside is found (default winding, and vote where that leaks)",
    )
    parser.add_argument("--transparent", action="store_true", help="picture: voxels let light through")
    add_size(parser)


def run_voxelize(arguments: argparse.Namespace, size: tuple[int, int]) -> None:
    """Voxelize a model and write the file; ``size`` of a picture."""
    from torchrender.voxels.file import write_voxels
    from torchrender.voxels.grid import make_grid

    output = Path(arguments.output)
    check_output(output, SUFFIXES)
    if arguments.method and not arguments.solid:
        raise OptionError("--method is for --solid")
    if arguments.solid and arguments.thin:
        raise OptionError("--thin is for surfaces, not for --solid")
    if not 1 <= arguments.resolution <= 2048:
        raise OptionError(f"--resolution must be in [1, 2048], got {arguments.resolution}")
    if output.suffix.lower() != ".png":
        say_idle(arguments, PICTURE, f"{output.suffix.lower()} files")
    scene = load_scene(arguments)
    grid = make_grid(scene.bounds[None], arguments.resolution)
    model = _solid(scene, grid, arguments) if arguments.solid else _surface(scene, grid, arguments)
    if not model.voxels.count:
        found = "no cell is inside" if arguments.solid else "no cell meets a surface"
        why = found if scene.geometry.triangle_count else "the scene has no triangles"
        warnings.warn(f"{scene.name}: {why}, so there are no voxels", EmptyWarning, stacklevel=2)
    if output.suffix.lower() == ".png":
        _picture(model, output, size, arguments.transparent)
    else:
        write_voxels(output, model)
    nx, ny, nz = grid.dims
    count = model.voxels.count
    print(
        f"{output}  {nx}x{ny}x{nz} cells  {count:,} {model.kind} voxels of {scene.geometry.triangle_count:,} triangles"
    )


def _surface(scene: Scene, grid: VoxelGrid, arguments: argparse.Namespace) -> VoxelModel:
    from torchrender.voxels.attributes import voxelize_scene
    from torchrender.voxels.file import VoxelModel
    from torchrender.voxels.surface import SurfaceOptions

    options = SurfaceOptions(mode="thin" if arguments.thin else "conservative")
    return VoxelModel.of(voxelize_scene(scene, grid, options), scene.name)


def _solid(scene: Scene, grid: VoxelGrid, arguments: argparse.Namespace) -> VoxelModel:
    """The inside by winding numbers, or if columns leak by the vote of three axes; says so."""
    from torchrender.voxels.file import VoxelModel
    from torchrender.voxels.solid import LeakWarning, SolidOptions, voxelize_solid

    mesh = scene.geometry.vertices[None], scene.geometry.faces, grid
    options = SolidOptions(method=arguments.method or "winding", warn=False)
    voxels, report = voxelize_solid(*mesh, options)
    if not report.closed:
        options = SolidOptions(method=arguments.method or "vote")
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always", LeakWarning)
            voxels, _ = voxelize_solid(*mesh, options)
        for warning in said:
            print(f"torchrender: warning: {warning.message}", file=sys.stderr)
    return VoxelModel(voxels=voxels, kind="solid", name=scene.name)


def _picture(model: VoxelModel, output: Path, size: tuple[int, int], transparent: bool) -> None:
    from torchrender.images.files import write_image
    from torchrender.renderer import render
    from torchrender.scene.model import Scene
    from torchrender.voxels.mesh import voxel_mesh

    mesh = voxel_mesh(model.voxels, model.linear_color)
    scene = Scene(meshes=(mesh,), name=model.name)
    width, height = size
    if not transparent:
        render(scene, width=width, height=height).save(output)
        return
    from torchrender.voxels.volume import over_background, render_volume

    image = render_volume([_layer(model)], scene.camera(width=width, height=height))
    write_image(output, over_background(image, (0.2, 0.22, 0.25))[0])


def _layer(model: VoxelModel) -> Any:
    from torchrender.voxels.attributes import SurfaceVoxels
    from torchrender.voxels.volume import surface_layer, voxel_layer

    normal, color = model.unit_normal, model.linear_color
    if normal is None or color is None or model.density is None:
        return voxel_layer(model.voxels)
    cells = model.voxels.cells()
    none: Tensor = cells.new_zeros(len(cells))
    surface = SurfaceVoxels(
        voxels=model.voxels,
        cells=cells,
        normal=normal,
        color=color,
        uv=normal[:, :2] * 0,
        material=none,
        density=model.density.float() / 255,
    )
    return surface_layer(surface, 0.15)


def voxel_info(path: str) -> dict[str, Any]:
    """What a voxel file holds.

    Raises:
        SceneFileError: as :func:`~torchrender.voxels.file.read_voxels`.
    """
    from torchrender.voxels.file import read_voxels

    return read_voxels(path).info()
