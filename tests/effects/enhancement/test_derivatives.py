"""Every derivative against finite differences in float64, on random triangles; and the laws that follow."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from torchrender.effects.enhancement import derivatives as d
from torchrender.scene.environment import Environment
from torchrender.scene.sky.harmonics import harmonics_2

COUNT, STEP = 150, 1e-5


@pytest.fixture(scope="module")
def triangles() -> dict[str, Tensor]:
    """Random triangles before the eye, with vertex normals near their own, and a point on each."""
    g = torch.Generator().manual_seed(3)

    def random(*shape: int) -> Tensor:
        return torch.rand(*shape, generator=g, dtype=torch.float64) * 2.0 - 1.0

    corners = random(COUNT, 3, 3) + torch.tensor([0.0, 0.0, 4.0])
    normal = torch.nn.functional.normalize(
        torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), dim=-1
    )
    turned = (normal * corners.mean(1)).sum(-1) > 0  # counter-clockwise seen from the eye
    corners[turned] = corners[turned][:, [0, 2, 1]]
    normal[turned] *= -1
    rough = torch.nn.functional.normalize(normal[:, None] + 0.4 * random(COUNT, 3, 3), dim=-1)
    weights = torch.rand(COUNT, 3, generator=g, dtype=torch.float64) + 0.2
    return {
        "corners": corners,
        "face": normal,
        "normals": rough,
        "weights": weights / weights.sum(-1, keepdim=True),
        "light": torch.tensor([1.5, -2.0, 0.5], dtype=torch.float64),
    }


def weights_at(t: dict[str, Tensor], x: Tensor) -> Tensor:
    """Barycentric weights of points in the planes of the triangles, by areas."""
    a, b, c = t["corners"].unbind(1)
    n = torch.linalg.cross(b - a, c - a)
    square = (n * n).sum(-1)
    pairs = ((b, c), (c, a), (a, b))
    return torch.stack([(n * torch.linalg.cross(p - x, q - x)).sum(-1) / square for p, q in pairs], dim=-1)


def normal_at(t: dict[str, Tensor], x: Tensor) -> Tensor:
    return torch.nn.functional.normalize((weights_at(t, x)[..., None] * t["normals"]).sum(1), dim=-1)


def point(t: dict[str, Tensor]) -> Tensor:
    return (t["weights"][..., None] * t["corners"]).sum(1)


def on_plane(t: dict[str, Tensor], image: Tensor) -> Tensor:
    """Where the rays through image points (N,2) meet the planes."""
    ray = torch.cat([image, torch.ones(len(image), 1, dtype=torch.float64)], dim=-1)
    n = t["face"]
    depth = (n * t["corners"][:, 0]).sum(-1) / (n * ray).sum(-1)
    return ray * depth[:, None]


def differences(f, x: Tensor) -> Tensor:  # type: ignore[no-untyped-def]
    """Derivatives of a function of rows (N,K) along the K coordinates, by central differences."""
    columns = []
    for k in range(x.shape[-1]):
        step = torch.zeros_like(x)
        step[:, k] = STEP
        columns.append((f(x + step) - f(x - step)) / (2 * STEP))
    return torch.stack(columns, dim=-1)


def seen_well(t: dict[str, Tensor]) -> Tensor:
    """Faces that are not near edge-on, where the clamp of grazing views acts."""
    x = point(t)
    return (t["face"] * torch.nn.functional.normalize(x, dim=-1)).sum(-1) < -0.1


def close(found: Tensor, wanted: Tensor, limit: float = 1e-5) -> None:
    scale = wanted.flatten(1).norm(dim=-1).clamp_min(1e-3)
    error = (found - wanted).flatten(1).norm(dim=-1) / scale
    assert float(error.max()) < limit, float(error.max())


def test_projection(triangles: dict[str, Tensor]) -> None:
    keep = seen_well(triangles)
    assert int(keep.sum()) >= 100
    x = point(triangles)
    rays = x / x[:, 2:]
    found = d.projection_gradient(rays, triangles["face"], x[:, 2], torch.eye(3, dtype=torch.float64)[:2])
    wanted = differences(lambda p: on_plane(triangles, p), rays[:, :2])
    close(found[keep], wanted[keep])


def test_projection_is_the_published_form(triangles: dict[str, Tensor]) -> None:
    keep = seen_well(triangles) & (triangles["face"][:, 2].abs() > 0.1)
    x, n = point(triangles)[keep], triangles["face"][keep]
    u, v = x[:, 0] / x[:, 2], x[:, 1] / x[:, 2]
    a, b, c = -n[:, 0] / n[:, 2], -n[:, 1] / n[:, 2], (n * x).sum(-1) / n[:, 2]
    w = 1 - a * u - b * v
    rows = [torch.stack(r, -1) for r in ((1 - b * v, b * u), (a * v, 1 - a * u), (a, b))]
    published = (c / w**2)[:, None, None] * torch.stack(rows, dim=1)
    found = d.projection_gradient(x / x[:, 2:], n, x[:, 2], torch.eye(3, dtype=torch.float64)[:2])
    torch.testing.assert_close(found, published, rtol=1e-9, atol=1e-9)


def test_projection_is_finite_edge_on_and_without_depth_component() -> None:
    axes = torch.eye(3, dtype=torch.float64)[:2]
    ray, depth = torch.tensor([[0.3, 0.1, 1.0]], dtype=torch.float64), torch.ones(1, dtype=torch.float64)
    for n in ([1.0, 0, 0], [-1.0, 0, 0], [0, 1.0, 0], [1.0, -3.0, 0.0], [0.0, 0.0, -1.0]):
        normal = torch.nn.functional.normalize(torch.tensor([n], dtype=torch.float64), dim=-1)
        assert bool(torch.isfinite(d.projection_gradient(ray, normal, depth, axes)).all())


def test_barycentric_weights(triangles: dict[str, Tensor]) -> None:
    found = d.barycentric_gradients(triangles["corners"])
    wanted = differences(lambda x: weights_at(triangles, x), point(triangles))
    close(found, wanted)
    assert not bool(d.barycentric_gradients(torch.zeros(2, 3, 3)).any())
    line = torch.tensor([[[0.0, 0, 0], [1, 1, 1], [2, 2, 2]]])
    assert not bool(d.barycentric_gradients(line).any())


def test_interpolated_normal(triangles: dict[str, Tensor]) -> None:
    gradients = d.barycentric_gradients(triangles["corners"])
    normal, slope = d.normal_gradient(triangles["normals"], triangles["weights"], gradients, triangles["face"])
    close(normal, normal_at(triangles, point(triangles)))
    close(slope, differences(lambda x: normal_at(triangles, x), point(triangles)))


def test_normals_that_cancel_give_the_faces_own() -> None:
    opposed = torch.tensor([[[1.0, 0, 0], [-1.0, 0, 0], [0, 0, 0]]])
    face = torch.tensor([[0.0, 0, 1]])
    normal, slope = d.normal_gradient(opposed, torch.tensor([[0.5, 0.5, 0.0]]), torch.rand(1, 3, 3), face)
    assert torch.equal(normal, face) and not bool(slope.any())


def to_light(t: dict[str, Tensor], x: Tensor) -> Tensor:
    return torch.nn.functional.normalize(t["light"] - x, dim=-1)


def parts(t: dict[str, Tensor]) -> tuple[Tensor, ...]:
    x = point(t)
    gradients = d.barycentric_gradients(t["corners"])
    normal, slope = d.normal_gradient(t["normals"], t["weights"], gradients, t["face"])
    light_slope = d.direction_gradient(to_light(t, x), (t["light"] - x).norm(dim=-1))
    eye_slope = d.direction_gradient(-torch.nn.functional.normalize(x, dim=-1), x.norm(dim=-1))
    return x, normal, slope, light_slope, eye_slope


def test_direction_to_a_light(triangles: dict[str, Tensor]) -> None:
    x, _, _, light_slope, _ = parts(triangles)
    close(light_slope, differences(lambda p: to_light(triangles, p), x))
    far = d.direction_gradient(torch.tensor([[0.0, 0, 1]]), torch.tensor([torch.inf]))
    assert not bool(far.any())


def cosine_at(t: dict[str, Tensor], x: Tensor) -> Tensor:
    return (normal_at(t, x) * to_light(t, x)).sum(-1).clamp_min(0.0)


def test_cosine(triangles: dict[str, Tensor]) -> None:
    x, normal, slope, light_slope, _ = parts(triangles)
    found = d.cosine_gradient(normal, to_light(triangles, x), slope, light_slope)
    wanted = differences(lambda p: cosine_at(triangles, p), x)
    away = (normal * to_light(triangles, x)).sum(-1).abs() > 1e-3
    close(found[away], wanted[away])
    dark = d.cosine_gradient(
        torch.tensor([[0.0, 0, 1]]), torch.tensor([[1.0, 0, 0]]), torch.ones(1, 3, 3), torch.ones(1, 3, 3)
    )
    assert not bool(dark.any()), "at D = 0 the gradient is defined as 0"


def test_phong_lobe(triangles: dict[str, Tensor]) -> None:
    x, normal, slope, light_slope, eye_slope = parts(triangles)
    exponent = torch.full((COUNT,), 7.5, dtype=torch.float64)

    def lobe(p: Tensor) -> Tensor:
        n, w, o = normal_at(triangles, p), to_light(triangles, p), -torch.nn.functional.normalize(p, dim=-1)
        cosine = (n * w).sum(-1, keepdim=True)
        along = ((2 * cosine * n - w) * o).sum(-1)
        return torch.where((cosine[:, 0] > 0) & (along > 0), along.clamp_min(0) ** exponent, 0.0)

    eye = -torch.nn.functional.normalize(x, dim=-1)
    found = d.phong_gradient(normal, to_light(triangles, x), eye, (slope, light_slope, eye_slope), exponent)
    bright = lobe(x) > 1e-4
    assert int(bright.sum()) > 20
    close(found[bright], differences(lobe, x)[bright])
    assert not bool(found[lobe(x) == 0].any())


def test_the_whole_chain_over_the_picture(triangles: dict[str, Tensor]) -> None:
    keep = seen_well(triangles)
    x, normal, slope, light_slope, _ = parts(triangles)
    moves = d.projection_gradient(x / x[:, 2:], triangles["face"], x[:, 2], torch.eye(3, dtype=torch.float64)[:2])
    found = d.row_times(d.cosine_gradient(normal, to_light(triangles, x), slope, light_slope), moves)
    wanted = differences(lambda p: cosine_at(triangles, on_plane(triangles, p)), x[:, :2] / x[:, 2:])
    lit = keep & ((normal * to_light(triangles, x)).sum(-1).abs() > 1e-2)
    close(found[lit], wanted[lit])


def test_visibility() -> None:
    along = torch.linspace(-2.0, 2.0, 41, dtype=torch.float64)
    sharpness = torch.tensor(1.7, dtype=torch.float64)
    into = torch.nn.functional.normalize(torch.tensor([[2.0, -1.0, 0.5]], dtype=torch.float64), dim=-1).expand(41, 3)
    found = d.visibility_gradient(into, along, sharpness)
    position = along[:, None] * into
    wanted = differences(lambda x: d.smooth_step((x * into).sum(-1), sharpness), position)
    close(found, wanted, 1e-7)
    assert float(d.smooth_step(along[:1], sharpness)) > 0.99, "lit before the edge"
    straight = d.visibility_gradient(torch.tensor([[1.0, 0, 0]]), torch.zeros(1), torch.ones(1))
    assert torch.equal(straight[:, 1:], torch.zeros(1, 2)) and float(straight[0, 0]) == -0.5


def test_the_response_peaks_where_the_specification_says() -> None:
    """At the ends of an edge of width w the response is strongest at k w = 1.543."""
    k = torch.linspace(0.5, 3.0, 2501, dtype=torch.float64)
    response = d.visibility_gradient(torch.tensor([[1.0, 0.0, 0.0]], dtype=torch.float64), torch.full_like(k, 0.5), k)
    assert float(k[response[:, 0].abs().argmax()]) == pytest.approx(1.543, abs=2e-3)


def test_environment_by_turning_the_normal() -> None:
    g = torch.Generator().manual_seed(0)
    coefficients = torch.rand(9, 3, generator=g, dtype=torch.float64)
    bands = torch.tensor([torch.pi] + [2 * torch.pi / 3] * 3 + [torch.pi / 4] * 5, dtype=torch.float64)

    def irradiance(n: Tensor) -> Tensor:
        return (harmonics_2(n) * bands) @ coefficients

    n = torch.nn.functional.normalize(torch.rand(50, 3, generator=g, dtype=torch.float64) - 0.5, dim=-1)
    slope = d.irradiance_gradient(coefficients, n)
    for axis in torch.eye(3, dtype=torch.float64):
        turn = torch.linalg.cross(axis.expand_as(n), n)
        wanted = (irradiance(torch.nn.functional.normalize(n + STEP * turn, dim=-1)) - irradiance(n)) / STEP
        found = (slope * turn[:, None]).sum(-1)
        torch.testing.assert_close(found, wanted, rtol=0.01, atol=1e-4)


def test_environment_gradient_is_the_vector_irradiance() -> None:
    """Against the integral over the hemisphere, for a smooth sky."""
    from torchrender.effects.enhancement.lights import environment_harmonics
    from torchrender.scene.environment import latlong_directions

    sky = latlong_directions(64, 128)
    radiance = (1.0 + 0.5 * sky[..., 1:2] + 0.3 * sky[..., :1]).expand(-1, -1, 3).contiguous()
    harmonics = environment_harmonics(Environment(radiance=radiance))
    n = torch.nn.functional.normalize(torch.tensor([[0.2, 0.9, -0.3], [1.0, 0.0, 0.2]], dtype=torch.float64), dim=-1)
    fine = latlong_directions(256, 512).double()
    weight = torch.sin((torch.arange(256) + 0.5) * torch.pi / 256)[:, None].double() * (torch.pi / 256) ** 2
    light = 1.0 + 0.5 * fine[..., 1] + 0.3 * fine[..., 0]
    for k in range(2):
        inside = (fine @ n[k]) > 0
        vector = (fine * (light * weight * inside)[..., None]).sum((0, 1))
        wanted = vector - (vector @ n[k]) * n[k]
        found = d.irradiance_gradient(harmonics, n)[k, 0]
        torch.testing.assert_close(found, wanted, rtol=0.02, atol=5e-3)


def test_gradients_pass_gradcheck(triangles: dict[str, Tensor]) -> None:
    few = {k: v[:3].clone() if v.shape[0] == COUNT else v for k, v in triangles.items()}
    axes = torch.eye(3, dtype=torch.float64)[:2]

    def whole(corners: Tensor, normals: Tensor, light: Tensor) -> Tensor:
        x = (few["weights"][..., None] * corners).sum(1)
        rays = x / x[:, 2:]
        face = torch.nn.functional.normalize(
            torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), dim=-1
        )
        normal, slope = d.normal_gradient(normals, few["weights"], d.barycentric_gradients(corners), face)
        to = torch.nn.functional.normalize(light - x, dim=-1)
        turning = d.direction_gradient(to, (light - x).norm(dim=-1))
        change = d.cosine_gradient(normal, to, slope, turning)
        return d.row_times(change, d.projection_gradient(rays, face, x[:, 2], axes))

    inputs = [few[k].clone().requires_grad_() for k in ("corners", "normals", "light")]
    assert torch.autograd.gradcheck(whole, inputs)
