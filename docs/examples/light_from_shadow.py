"""How bright each of three lamps is, out of one picture of shadows: python light_from_shadow.py [PIXELS]."""

import sys

import torch
import torchrender as tr

size = int(sys.argv[1]) if len(sys.argv) > 1 else 128
PLACES = [[2.0, 2.5, 1.0], [-2.0, 2.0, 1.5], [0.3, 2.2, -2.5]]
meshes = [tr.Mesh.plane(6), tr.Mesh.box(0.8, [0, 0.4, 0])]
camera = tr.Cameras.look_at([0.5, 4.0, 3.0], [0, 0.2, 0], width=size, height=size, fov_deg=45)


def picture(brightness: torch.Tensor) -> torch.Tensor:
    lamps = [tr.PointLight(position=place, intensity=b) for place, b in zip(PLACES, brightness)]
    return tr.render(tr.Scene(meshes=meshes, lights=lamps), camera).radiance  # shadows as they are


wanted = torch.tensor([[6.0, 5.0, 4.0], [1.0, 2.0, 4.0], [3.0, 3.0, 3.0]])
photo = picture(wanted)
tr.render(tr.Scene(meshes=meshes, lights=[tr.PointLight(position=PLACES[0], intensity=6)]), camera).save("one_lamp.png")

brightness = torch.full((3, 3), 2.0, requires_grad=True)
optimiser = torch.optim.Adam([brightness], lr=0.4)
for _ in range(60):
    optimiser.zero_grad()
    loss = (picture(brightness) - photo).square().mean()
    loss.backward()
    optimiser.step()
    with torch.no_grad():
        brightness.clamp_(min=0.0)
error = (brightness.detach() - wanted).abs().max()
print(f"found {brightness.detach().round(decimals=2).tolist()}, off by {error:.3f} at most")
assert error < 0.15
