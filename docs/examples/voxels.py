"""A mesh as voxels: volume, file, collision: python voxels.py [CELLS]."""

import math
import sys

import torchrender as tr

cells = int(sys.argv[1]) if len(sys.argv) > 1 else 128
ball = tr.Mesh.sphere(1.0, segments=128)

solid, report = tr.voxelize_solid(ball, cells)  # cells whose centre lies inside; what is wrong with the mesh
print(f"volume {float(solid.volume):.3f}, exactly {4 / 3 * math.pi:.3f}")
tr.write_voxels("ball.npz", solid)  # or .vox for MagicaVoxel

crate = tr.Mesh.box(1.0, [1.3, 0.0, 0.0])
touch = tr.collide(ball, crate)
print("they touch" if touch else "they are apart", f"at {touch.centroid.tolist()}")
