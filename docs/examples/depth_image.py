"""Depth image of a mesh, with normals and ids: python depth_image.py [PIXELS] [MESH FILE]."""

import sys

import torch
import torchrender as tr

size = int(sys.argv[1]) if len(sys.argv) > 1 else 512
scene = (
    tr.load(sys.argv[2])
    if len(sys.argv) > 2
    else tr.Scene(meshes=[tr.Mesh.sphere(0.5), tr.Mesh.plane(3, [0, -0.5, 0])])
)

camera = tr.Cameras.look_at([1.0, 0.8, 1.5], [0, 0, 0], width=size, height=size, fov_deg=40)
maps = tr.rasterize(scene, camera, outputs=("depth", "normal", "object_id"))

depth = maps["depth"]  # (1,H,W): camera z, +inf where nothing is
seen = torch.isfinite(depth)
print(f"{seen.float().mean():.0%} of the pixels see something, {depth.min():.2f} to {depth[seen].max():.2f} away")
tr.render(scene, camera).save("mesh.exr")  # radiance, Z, normals and ids in one file
