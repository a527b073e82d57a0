"""Points of a surface, compressed and drawn: python points.py [PIXELS] [FILE]."""

import sys

import torchrender as tr

size = int(sys.argv[1]) if len(sys.argv) > 1 else 512
source = sys.argv[2] if len(sys.argv) > 2 else "nest"

cloud = tr.load_points(source, samples=20 * size)  # files of points are taken as they are: without samples
patches = tr.build_patches(cloud)  # with levels of detail
print(f"{tr.write_points('cloud.trp', patches)} bytes for {len(cloud)} points")

camera = cloud.camera(width=size, height=size)
tr.render_points(tr.open_points("cloud.trp"), camera).save("cloud.png")
