"""A scene of this program in a browser, changed while it is looked at: python viewer.py [PIXELS] [STAY]."""

import math
import sys

import torch

import torchrender as tr

size = int(sys.argv[1]) if len(sys.argv) > 1 else 480
stay = len(sys.argv) < 3  # until Enter is pressed

ball = tr.Mesh.sphere(0.5, (0.0, 0.5, 0.0), name="ball")
floor = tr.Mesh.box((4.0, 0.1, 4.0), (0.0, -0.05, 0.0), name="floor")
scene = tr.Scene(meshes=[ball, floor], name="waves")

view = tr.show(scene, browser=stay)
print(view)


@view.on_pick
def tell(found):
    print(f"{found.mesh.name}, face {found.face}, at {found.point.tolist()}")


for step in range(60 if stay else 3):  # a ball with waves: new vertices, the same triangles
    height = ball.vertices[:, 1:2]
    waves = 1.0 + 0.1 * torch.sin(12.0 * height + 0.3 * step)
    view.update(mesh="ball", vertices=ball.vertices * torch.cat([waves, torch.ones_like(waves), waves], dim=1))

turns = torch.linspace(0.0, 6.0 * math.pi, 300, dtype=torch.float64)
spiral = torch.stack([turns.cos(), turns / 12.0, turns.sin()], dim=1)
view.add(tr.PointCloud(position=spiral, color=torch.tensor([0.9, 0.5, 0.1]).expand(300, 3)))
view.camera = tr.Cameras.look_at((2.5, 1.8, 2.5), (0.0, 0.6, 0.0), width=size, height=size)

found = view.pick(size / 2, size / 2)
print("in the middle:", found.mesh.name if found else "nothing")
view.screenshot(width=size, height=size).save("view.png")
if stay:
    input("Enter ends it ")
view.close()
