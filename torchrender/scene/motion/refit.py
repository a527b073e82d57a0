"""Triangles whose vertices move: what was found out about them stays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import Recycler
from torchrender.errors import MeshError
from torchrender.kernels.meshes.culling_clusters import cluster_boxes, take_vertices
from torchrender.scene.mesh import Geometry, describe

KEPT = ("order", "clusters", "numbering", "cluster_blocks")
"""What a geometry found out about its triangles that stays true while they move."""
_memory = Recycler(1 << 26)


def refitted(
    geometry: Geometry, vertices: Tensor, *, normals: Tensor | None = None, tangents: Tensor | None = None
) -> Geometry:
    """The same triangles with other vertices (V,3): culling clusters are refitted to them, not built anew.

    What was found out about which triangles lie together stays, also where it is no longer so: pictures are the same,
    but drawing takes longer once neighbours have gone apart.

    Args:
        vertices: float64, scene units.
        normals: that changed with them; None: they stay as they are. tangents: likewise.

    Raises:
        MeshError: another number of vertices, or of another type.
    """
    if vertices.shape != geometry.vertices.shape or vertices.dtype != torch.float64:
        raise MeshError(f"vertices must be float64 {tuple(geometry.vertices.shape)}, got {describe(vertices)}")
    new = replace(
        geometry,
        vertices=vertices,
        normals=geometry.normals if normals is None else normals,
        tangents=geometry.tangents if tangents is None else tangents,
    )
    new.__dict__.update({name: getattr(geometry, name) for name in KEPT})
    if not geometry.coherent:
        rows = geometry.numbering[0].numpy()
        taken = _memory.empty((len(rows), 3), np.float64)  # every row is written
        take_vertices(np.ascontiguousarray(vertices.numpy()), rows, taken)
        new.__dict__["numbered_vertices"] = torch.from_numpy(taken)
        # In this order what lies together in memory is read together.
        boxes, order = torch.zeros_like(geometry.cluster_bounds), np.arange(geometry.triangle_count, dtype=np.int32)
        cluster_boxes(taken, geometry.numbering[2].numpy(), order, geometry.clusters.numpy(), boxes.numpy())
        new.__dict__["cluster_bounds"] = boxes
    for name in ("_solid", "panes"):
        if isinstance(part := geometry.__dict__.get(name), Geometry):
            new.__dict__[name] = refitted(part, vertices, normals=normals, tangents=tangents)
    return new
