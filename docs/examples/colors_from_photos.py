"""Colours of a scene's materials out of two photographs of it: python colors_from_photos.py [PIXELS]."""

import sys

import torch
import torchrender as tr

size = int(sys.argv[1]) if len(sys.argv) > 1 else 128
eyes = [[1.8, 1.4, 2.2], [-1.6, 1.8, 2.0]]
cameras = tr.Cameras.look_at(eyes, [0, 0.3, 0], width=size, height=size, fov_deg=50)
sky = tr.Environment(radiance=torch.ones(8, 16, 3))
lamp = tr.PointLight(position=[1.0, 3.0, 2.0], intensity=8)
options = tr.RenderOptions(reflections="off")


def pictures(colors: torch.Tensor) -> torch.Tensor:
    ball = tr.Mesh.sphere(0.3, [0.8, 0.3, 0.6], material=2)
    meshes = [tr.Mesh.plane(6), tr.Mesh.box(0.8, [0, 0.4, 0], material=1), ball]
    materials = [tr.Material(diffuse=color) for color in colors]
    scene = tr.Scene(meshes=meshes, materials=materials, lights=[lamp], environment=sky)
    return tr.render(scene, cameras, options=options).radiance


wanted = torch.tensor([[0.7, 0.7, 0.65], [0.6, 0.2, 0.1], [0.1, 0.3, 0.6]])
image = tr.Scene(meshes=[tr.Mesh.box(0.8)], materials=[tr.Material(diffuse=wanted[1])], environment=sky)
tr.render(image, width=size, height=size).save("box.png")
photos = pictures(wanted)

colors = torch.full((3, 3), 0.5, requires_grad=True)
optimiser = torch.optim.Adam([colors], lr=0.05)
for _ in range(60):
    optimiser.zero_grad()
    loss = (pictures(colors) - photos).square().mean()
    loss.backward()
    optimiser.step()
    with torch.no_grad():
        colors.clamp_(0.0, 1.0)
error = (colors.detach() - wanted).abs().max()
print(f"colours off by {error:.4f} at most")
assert error < 0.02
