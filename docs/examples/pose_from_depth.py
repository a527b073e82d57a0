"""Where a depth camera stood, out of what it saw: python pose_from_depth.py [PIXELS]."""

import sys
from dataclasses import replace

import torch
import torchrender as tr

size = int(sys.argv[1]) if len(sys.argv) > 1 else 96
scene = tr.Scene(meshes=[tr.Mesh.plane(6), tr.Mesh.box(0.8, [0, 0.4, 0]), tr.Mesh.box(0.4, [0.9, 0.2, 0.7])])
truth = tr.Cameras.look_at([1.8, 1.6, 2.4], [0.1, 0.3, 0], width=size, height=size, fov_deg=45)
measured = tr.rasterize(scene, truth).depth  # what the sensor says
guess = tr.Cameras.look_at([1.9, 1.5, 2.45], [0.15, 0.27, 0.05], width=size, height=size, fov_deg=45)
tr.render(scene, truth).save("seen.png")


def moved(camera: tr.Cameras, twist: torch.Tensor) -> torch.Tensor:
    """camera_from_world (1,4,4) after a turn and a shift in the camera's own frame, (6,)."""
    none = twist.new_zeros(())
    x, y, z = twist[:3]
    turn = torch.stack([none, -z, y, z, none, -x, -y, x, none]).reshape(3, 3)
    top = torch.cat([torch.matrix_exp(turn), twist[3:, None]], dim=1)
    return torch.cat([top, top.new_tensor([[0.0, 0.0, 0.0, 1.0]])])[None] @ camera.camera_from_world


geometry = scene.geometry
for _ in range(12):
    seen = tr.rasterize(scene, guess)  # which triangle each pixel sees, for this round
    twist = torch.zeros(6, dtype=torch.float64, requires_grad=True)
    held = tr.held_surface(seen, geometry.vertices, geometry.faces, camera_from_world=moved(guess, twist))
    both = seen.covered & torch.isfinite(measured)
    gap = (held.depth - measured)[both]
    both_near = gap.detach().abs() < 0.3  # outlines say nothing: another surface is seen there
    gap = gap[both_near]
    # Gauss-Newton: a least-squares step by the derivatives of a few hundred pixels.
    rows = torch.linspace(0, len(gap) - 1, min(300, len(gap))).long()
    slopes = torch.stack([torch.autograd.grad(gap[row], twist, retain_graph=True)[0] for row in rows])
    step = torch.linalg.lstsq(slopes, -gap[rows].detach()[:, None]).solution[:, 0]
    guess = replace(guess, camera_from_world=moved(guess, step).detach())
off = float((guess.eye - truth.eye).norm())
print(f"the eye is found to {1000 * off:.2f} thousandths of a unit; it was off by 150")
assert off < 0.01
