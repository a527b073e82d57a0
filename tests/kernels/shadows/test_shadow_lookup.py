"""The fused shadow lookup against an obvious loop written from the method's formulas."""

from __future__ import annotations

import math

import numpy as np
import pytest

from torchrender.kernels.shadows.shadow_lookup import AVERAGE_DEPTH, DISC, NEAREST_TEXEL, PCSS, WINDOW, shadow_lookup
from torchrender.kernels.shadows.shadow_receiver import CONSTANT, RECEIVER_PLANE, SLOPE, LookupSettings

SIZE = (48, 40)
FILTERS = {"none": NEAREST_TEXEL, "window": WINDOW, "disc": DISC, "pcss": PCSS, "average": AVERAGE_DEPTH}
NEAR, FAR = 1.0, 5.0


def settings(**changes) -> LookupSettings:
    values = {
        "orthographic": False, "cube": False, "bias": SLOPE, "filter": WINDOW, "n": 1, "radius": 1.5, "reach": 0.0,
        "b0": 0.05, "k": 1.0, "b_max": 3.0, "k_n": 0.0, "outside": 1.0, "light_size": 0.4, "rho_max": 6.0,
        "search_near": 1.2, "search_taps": 5, "settles": False, "exact": False,
    }  # fmt: skip
    values |= dict.fromkeys(("ux", "uy", "uz", "vx", "vy", "vz"), 0.0)
    return LookupSettings(**(values | changes))


def twin(point, normal, index, light, view, depths, taps, s: LookupSettings) -> float:
    """Section by section: facing, transform, plane, bias, filter."""
    height, width = depths.shape
    normal = normal / np.linalg.norm(normal)
    to_light = light[:3] - light[3] * point
    if normal @ to_light <= 0:
        return 0.0
    matrix, (fx, fy, cx, cy, near, far) = view[:12].reshape(3, 4), view[12:]
    cosine = normal @ to_light / np.linalg.norm(to_light)
    if s.k_n:
        depth = (matrix[:, :3] @ point + matrix[:, 3])[2]
        texel = (1 if s.orthographic else depth) / min(fx, fy)
        point = point + s.k_n * texel * math.sqrt(1 - cosine**2) * normal
    p, n = matrix[:, :3] @ point + matrix[:, 3], matrix[:, :3] @ normal
    z = p[2]
    if z <= near or z > far:
        return s.outside
    w = 1.0 if s.orthographic else z
    u, v = fx * p[0] / w + cx, fy * p[1] / w + cy
    if not (0 <= u < width and 0 <= v < height):
        return s.outside

    def plane(ut, vt):
        if s.orthographic:
            return z - n[0] / (fx * n[2]) * (ut - u) - n[1] / (fy * n[2]) * (vt - v), abs(n[2])
        denominator = n[0] * (ut - cx) / fx + n[1] * (vt - cy) / fy + n[2]
        return (n @ p) / denominator, -denominator

    gu, gv = -w * w * n[0] / (fx * (n[2] if s.orthographic else n @ p)), 0.0
    gv = -w * w * n[1] / (fy * (n[2] if s.orthographic else n @ p))
    texel = w / min(fx, fy)
    size = 4096 * texel if s.exact else np.abs(point).sum()  # of the numbers that points were rounded with
    rounding = 2**-23 * abs(z) + 2**-24 * size * (1 + (abs(gu) + abs(gv)) / texel)

    cap = s.b_max * texel

    flat = cosine >= 1e-4 and plane(u, v)[1] >= 1e-4  # a normal offset may lift the point past the light's plane

    def slope_bias(ru, rv):
        if not flat:
            return cap
        return s.b0 * texel + s.k * ((0.5 + ru) * abs(gu) + (0.5 + rv) * abs(gv))

    def lit(row, column, ru, rv):
        if not (0 <= row < height and 0 <= column < width):
            return s.outside, math.inf
        stored = float(depths[row, column])
        if s.bias == CONSTANT:
            z_here, bias = z, s.b0 * texel + rounding
        else:
            z_here, bias = z, min(slope_bias(ru, rv), cap) + rounding
        if s.bias == RECEIVER_PLANE or (s.bias == SLOPE and slope_bias(ru, rv) > cap):
            at, denominator = plane(column + 0.5, row + 0.5)
            if flat and denominator >= 1e-4:
                z_here, bias = at, s.b0 * texel + rounding
        return (1.0, math.inf) if stored == math.inf or z_here <= stored + bias else (0.0, stored)

    def disc(offsets, ru, rv):
        h = index
        h = ((h ^ (h >> 16)) * 0x85EBCA6B) & 0xFFFFFFFF
        h = ((h ^ (h >> 13)) * 0xC2B2AE35) & 0xFFFFFFFF
        turn = 2 * math.pi * ((h ^ (h >> 16)) / 2**32)
        c, sn = math.cos(turn), math.sin(turn)
        found = []
        for x, y in offsets:
            a, b = ru * (c * x - sn * y), rv * (sn * x + c * y)
            tap = lit(math.floor(v + b), math.floor(u + a), ru, rv)
            if s.filter == PCSS and tap[1] < math.inf and math.hypot(a, b) > 1:  # in the cone to the light's disc
                gap = s.light_size / 2 * (z - tap[1]) / (1 if s.orthographic else z * tap[1])
                tap = tap if math.hypot(a / fx, b / fy) <= 1.25 * gap else (1.0, math.inf)
            found.append(tap)
        return found

    left, top = math.floor(u - 0.5), math.floor(v - 0.5)
    a, b = u - 0.5 - left, v - 0.5 - top
    corners = [(0, 0, (1 - a) * (1 - b)), (1, 0, a * (1 - b)), (0, 1, (1 - a) * b), (1, 1, a * b)]
    if s.filter == NEAREST_TEXEL:
        return lit(math.floor(v), math.floor(u), 0, 0)[0]
    if s.filter == AVERAGE_DEPTH:
        rows, columns = np.clip([top, top + 1], 0, height - 1), np.clip([left, left + 1], 0, width - 1)
        mean = sum(weight * float(depths[rows[j], columns[i]]) for i, j, weight in corners)
        bias = (min(slope_bias(0, 0), cap) if s.bias != CONSTANT else s.b0 * texel) + rounding
        return float(z <= mean + bias)
    if s.filter == WINDOW:
        reach = s.n + 0.5
        total = 0.0
        for dy in range(-s.n, s.n + 1):  # (2n+1)^2 separate bilinear taps
            for dx in range(-s.n, s.n + 1):
                total += sum(wt * lit(top + dy + j, left + dx + i, reach, reach)[0] for i, j, wt in corners)
        return total / (2 * s.n + 1) ** 2
    if s.filter == DISC:
        return float(np.mean([x for x, _ in disc(taps[s.search_taps :], s.radius, s.radius)]))
    gap = max(z - s.search_near, 0)
    search = s.light_size / 2 * gap / (1 if s.orthographic else s.search_near * z)
    search = min(max(search, 1 / max(fx, fy)), s.rho_max / max(fx, fy))
    blockers = [d for _, d in disc(taps[: s.search_taps], search * fx, search * fy) if d < math.inf]
    if not blockers:
        return 1.0
    mean = sum(blockers) / len(blockers)
    radius = s.light_size / 2 * max(z - mean, 0) / (1 if s.orthographic else mean * z)
    radius = min(max(radius, 1 / max(fx, fy)), s.rho_max / max(fx, fy))
    return float(np.mean([x for x, _ in disc(taps[s.search_taps :], radius * fx, radius * fy)]))


def random_case(rng, orthographic: bool):
    """A tilted light, a map with holes, and points of which some lie outside."""
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    matrix = np.concatenate([q, rng.normal(size=(3, 1))], axis=1)
    height, width = SIZE
    scale = 12.0 if orthographic else 30.0
    view = np.concatenate([matrix.ravel(), [scale, scale * 1.2, width / 2, height / 2, NEAR, FAR]])
    depths = rng.uniform(2.0, 4.5, SIZE).astype(np.float32)
    depths[rng.random(SIZE) < 0.2] = np.inf
    light_points = rng.uniform([-1.6, -1.6, 0.5], [1.6, 1.6, 5.5], (300, 3))
    points = (light_points - matrix[:, 3]) @ matrix[:, :3]
    normals = rng.normal(size=(300, 3)).astype(np.float32)
    if orthographic:
        light = np.append(-matrix[2, :3], 0.0)
    else:
        light = np.append(-matrix[:, :3].T @ matrix[:, 3], 1.0)
    taps = rng.uniform(-0.7, 0.7, (14, 2))
    return points, normals, light, view, depths, taps


def look_up(points, normals, light, views, maps, taps, s):
    out = np.full(len(points), -1.0, np.float32)
    shadow_lookup(points, normals, light, views, maps, taps, s, (out, np.full(len(points), -1, np.int32)))
    return out


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("bias", [CONSTANT, SLOPE, RECEIVER_PLANE])
@pytest.mark.parametrize("kind", FILTERS)
def test_equals_the_loop(kind, bias, orthographic):
    points, normals, light, view, depths, taps = random_case(np.random.default_rng(3), orthographic)
    for changes in ({}, {"n": 3, "k_n": 1.5, "outside": 0.0, "radius": 4.0}, {"exact": True}):
        s = settings(filter=FILTERS[kind], bias=bias, orthographic=orthographic, **changes)
        found = look_up(points, normals, light, view[None], depths[None], taps, s)
        wanted = [
            twin(p, n.astype(float), i, light, view, depths, taps, s) for i, (p, n) in enumerate(zip(points, normals))
        ]
        np.testing.assert_allclose(found, wanted, atol=1e-5)
        assert 0.05 < np.mean((found > 0) & (found <= 1)) < 0.95


def test_float32_points_give_the_same_picture():
    points, normals, light, view, depths, taps = random_case(np.random.default_rng(4), False)
    rough = points.astype(np.float32)
    fine = look_up(rough.astype(np.float64), normals, light, view[None], depths[None], taps, settings())
    assert np.array_equal(fine, look_up(rough, normals, light, view[None], depths[None], taps, settings()))


def test_cube_takes_the_deepest_view_and_cascades_the_first_that_holds_the_point():
    height, width = SIZE
    eye = np.concatenate([np.eye(3), np.zeros((3, 1))], axis=1)
    back = np.concatenate([np.diag([-1.0, 1.0, -1.0]), np.zeros((3, 1))], axis=1)
    camera = [20.0, 20.0, width / 2, height / 2, NEAR, FAR]
    views = np.stack([np.concatenate([m.ravel(), camera]) for m in (eye, back)])
    maps = np.stack([np.full(SIZE, 1.5), np.full(SIZE, np.inf)]).astype(np.float32)
    points = np.array([[0.0, 0.0, 3.0], [0.0, 0.0, -3.0]])
    normals = -points.astype(np.float32)
    taps, light = np.zeros((6, 2)), np.array([0.0, 0.0, 0.0, 1.0])
    cube = settings(cube=True)
    assert look_up(points, normals, light, views, maps, taps, cube).tolist() == [0.0, 1.0]

    fine, coarse = [20.0, 20.0, width / 2, height / 2, 0.1, FAR], [5.0, 5.0, width / 2, height / 2, 0.1, FAR]
    views = np.stack([np.concatenate([eye.ravel(), c]) for c in (fine, coarse)])
    maps = np.stack([np.full(SIZE, np.inf), np.full(SIZE, 1.5)]).astype(np.float32)
    points = np.array([[0.0, 0.0, 3.0], [1.3, 0.0, 3.0], [3.0, 0.0, 3.0], [9.0, 0.0, 3.0]])
    normals = np.tile(np.array([0, 0, -1], np.float32), (4, 1))
    parallel = np.array([0.0, 0.0, -1.0, 0.0])
    s = settings(orthographic=True, filter=NEAREST_TEXEL)
    assert look_up(points, normals, parallel, views, maps, taps, s).tolist() == [1.0, 0.0, 0.0, 1.0]
    # A margin moves the change-over inwards: the second point lies within it.
    near_border = np.array([[0.9, 0.0, 3.0]])
    normal = normals[:1]
    assert look_up(near_border, normal, parallel, views, maps, taps, s).tolist() == [1.0]
    assert look_up(near_border, normal, parallel, views, maps, taps, s._replace(reach=4.0)).tolist() == [0.0]


def test_a_cube_never_leaves_its_map_while_other_maps_take_the_outside_value():
    height, width = SIZE
    eye = np.concatenate([np.eye(3), np.zeros((3, 1))], axis=1)
    view = np.concatenate([eye.ravel(), [20.0, 20.0, width / 2, height / 2, NEAR, FAR]])
    maps = np.full((1, *SIZE), 1.5, np.float32)
    point = np.array([[(width / 2 - 0.2) / 20 * 3, 0.0, 3.0]])  # 0.2 texels from the right border
    args = (point, -point.astype(np.float32), np.array([0.0, 0, 0, 1]), view[None], maps, np.zeros((6, 2)))
    assert look_up(*args, settings(n=0))[0] == pytest.approx(0.3, abs=1e-4)  # weight of the missing column
    assert look_up(*args, settings(n=0, cube=True))[0] == 0.0


@pytest.mark.parametrize("orthographic", [False, True])
def test_doubt_is_where_texels_around_disagree_or_are_close(orthographic):
    """Beside the receiver's plane: all nine lit, or all nine dark by two texels, is sure; anything else is not."""
    points, normals, light, view, depths, taps = random_case(np.random.default_rng(7), orthographic)
    depths[10:30, 10:30] = 1.2  # sure dark for what lies behind
    depths[30:, :] = np.inf  # sure lit
    s = settings(orthographic=orthographic, filter=NEAREST_TEXEL, settles=True, bias=RECEIVER_PLANE, exact=True)
    out, doubt = np.zeros(len(points), np.float32), np.full(len(points), -7, np.int32)
    shadow_lookup(points, normals, light, view[None], depths[None], taps, s, (out, doubt))
    matrix, (fx, fy, cx, cy, near, far) = view[:12].reshape(3, 4), view[12:]
    checked = {True: 0, False: 0}
    for point, normal, found in zip(points, normals.astype(float), doubt, strict=True):
        normal = normal / np.linalg.norm(normal)
        to_light = light[:3] - light[3] * point
        p, n = matrix[:, :3] @ point + matrix[:, 3], matrix[:, :3] @ normal
        cosine = normal @ to_light / np.linalg.norm(to_light)
        w = 1.0 if orthographic else p[2]
        if cosine < 0.05 or not near < p[2] <= far:
            continue
        u, v = fx * p[0] / w + cx, fy * p[1] / w + cy
        column, row = math.floor(u), math.floor(v)
        if not (1 <= column < SIZE[1] - 1 and 1 <= row < SIZE[0] - 1):
            continue
        kinds = set()
        for j in range(row - 1, row + 2):
            for i in range(column - 1, column + 2):
                ray = np.array([(i + 0.5 - cx) / fx, (j + 0.5 - cy) / fy, 1.0])
                if orthographic:
                    plane = p[2] - (n[:2] @ (ray[:2] - p[:2])) / n[2]
                else:
                    plane = (n @ p) / (n @ ray)
                gap = (plane - float(depths[j, i])) * min(fx, fy) / w
                kinds.add("lit" if gap <= 0.05 else "dark" if gap > 2.0 else "close")
        unsure = kinds not in ({"lit"}, {"dark"})
        assert (found == 0) == unsure
        assert found in (0, -1)
        checked[unsure] += 1
    assert min(checked.values()) > 5


@pytest.mark.parametrize("kind", ["window", "disc"])
def test_a_filter_wider_than_a_shadow_keeps_its_side(kind):
    """A strip of three dark texels under a filter of eleven: dark in its middle, lit beside it, though softly."""
    height, width = SIZE
    depths = np.full(SIZE, np.inf, np.float32)
    depths[:, 19:22] = 0.2  # far above: what stands close by a contact is left out
    eye = np.concatenate([np.eye(3), np.zeros((3, 1))], axis=1)
    view = np.concatenate([eye.ravel(), [20.0, 20.0, width / 2, height / 2, 0.1, FAR]])
    points = np.array([[(c + 0.5 - width / 2) / 20, 0.01, 3.0] for c in (20, 17, 5)])
    normals = np.tile(np.array([0, 0, -1], np.float32), (3, 1))
    taps = np.random.default_rng(2).uniform(-0.7, 0.7, (69, 2))
    args = (points, normals, np.array([0.0, 0, -1, 0]), view[None], depths[None], taps)
    s = settings(orthographic=True, filter=FILTERS[kind], n=5, radius=5.5, bias=RECEIVER_PLANE, exact=True)
    plain, kept = look_up(*args, s), look_up(*args, s._replace(settles=True))
    assert 0.5 < plain[0] < 0.9 and kept[0] == pytest.approx(1 - plain[0], abs=1e-6)
    assert 0.5 < plain[1] < 1 and kept[1] == plain[1] and kept[2] == plain[2] == 1.0


def test_between_a_light_and_its_near_plane_triangles_decide():
    """Nothing was drawn there: not lit for certain where edges are settled, the outside value else."""
    eye = np.concatenate([np.eye(3), np.zeros((3, 1))], axis=1)
    view = np.concatenate([eye.ravel(), [20.0, 20.0, SIZE[1] / 2, SIZE[0] / 2, NEAR, FAR]])
    points = np.array([[0.0, 0.0, 0.5], [0.0, 0.0, 5.5], [2.0, 0.0, 0.5]])  # near, too far, beside the map
    maps, normals = np.full((1, *SIZE), np.inf, np.float32), np.tile(np.array([0, 0, -1], np.float32), (3, 1))
    for settled, wanted in ((True, [0, -1, -1]), (False, [-1, -1, -1])):
        out, doubt = np.zeros(3, np.float32), np.full(3, -1, np.int32)
        s = settings(settles=settled)
        light = np.array([0.0, 0, 0, 1])
        shadow_lookup(points, normals, light, view[None], maps, np.zeros((6, 2)), s, (out, doubt))
        assert doubt.tolist() == wanted and out.tolist() == [1.0, 1.0, 1.0]


@pytest.mark.parametrize("slope", [1.5, 6.0])  # texels of depth per texel: ground that the light grazes, too
@pytest.mark.parametrize("kind", ["window", "disc"])
def test_what_rises_from_the_receiver_softens_nothing(kind, slope):
    """With edges that triangles settle, a wall's foot beside the point counts as lit; else it darkens the filter."""
    height, width = SIZE
    depths = np.full(SIZE, 3.0, np.float32)
    depths[:, width // 2 + 1 :] -= np.arange(1, width - width // 2, dtype=np.float32) * (slope / 20)
    eye = np.concatenate([np.eye(3), np.zeros((3, 1))], axis=1)
    view = np.concatenate([eye.ravel(), [20.0, 20.0, width / 2, height / 2, 0.1, FAR]])
    point, normal = np.array([[0.01, 0.0, 3.0]]), np.array([[0.0, 0, -1]], np.float32)
    args = (
        point,
        normal,
        np.array([0.0, 0.0, -1.0, 0.0]),
        view[None],
        depths[None],
        np.tile([[0.9, 0.0], [-0.9, 0.0], [0.0, 0.9], [0.0, -0.9]], (5, 1)),
    )
    s = settings(orthographic=True, filter=FILTERS[kind], n=2, radius=2.5, bias=RECEIVER_PLANE, exact=True)
    assert look_up(*args, s._replace(settles=True))[0] == 1.0
    assert look_up(*args, s)[0] < 1.0


def test_a_rectangle_partly_above_a_surface_is_not_called_hidden():
    """Its centre lies below: the map knows nothing of the rest. Wholly below, it is."""
    eye = np.concatenate([np.eye(3), np.zeros((3, 1))], axis=1)
    view = np.concatenate([eye.ravel(), [20.0, 20.0, SIZE[1] / 2, SIZE[0] / 2, NEAR, FAR]])
    point, normal = np.array([[0.0, 0.5, 3.0]]), np.array([[0.0, 1.0, 0.0]], np.float32)
    args = (point, normal, np.array([0.0, 0, 0, 1]), view[None], np.full((1, *SIZE), 1.5, np.float32), np.zeros((6, 2)))
    assert look_up(*args, settings())[0] == 0.0
    assert look_up(*args, settings(ux=0.2, uy=0.9, vz=0.3))[0] == 0.0
    assert look_up(*args, settings(ux=0.2, uy=1.1, vz=0.3))[0] == 1.0


@pytest.mark.parametrize("side", ["top", "bottom", "left", "right"])
@pytest.mark.parametrize("kind", ["window", "disc"])
def test_beyond_the_border_of_a_cube_face_its_last_texels_go_on(kind: str, side: str) -> None:
    """Half of the map is empty: beside that half's border everything is lit, however far the filter reaches out."""
    rng = np.random.default_rng(7)
    _, _, _, _, depths, taps = random_case(rng, False)
    height, width = SIZE
    depths[:] = np.inf
    dark = {"top": np.s_[24:], "bottom": np.s_[:24], "left": np.s_[:, 20:], "right": np.s_[:, :20]}[side]
    depths[dark] = 1.2
    u, v = rng.uniform(1, width - 1, 40), rng.uniform(1, height - 1, 40)
    at = {"top": (u, 0 * v + 0.7), "bottom": (u, 0 * v + height - 0.7), "left": (0 * u + 0.7, v)}
    u, v = at.get(side, (0 * u + width - 0.7, v))
    view = np.concatenate([np.eye(3, 4).ravel(), [30.0, 36.0, width / 2, height / 2, NEAR, FAR]])
    points = 3.0 * np.stack([(u - width / 2) / 30.0, (v - height / 2) / 36.0, np.ones(40)], axis=-1)
    normals = np.tile(np.array([0.0, 0.0, -1.0], np.float32), (40, 1))
    s = settings(filter=FILTERS[kind], n=3, radius=4.0, cube=True, outside=0.0)
    light = np.array([0.0, 0.0, 0.0, 1.0])
    found = look_up(points, normals, light, np.tile(view, (6, 1)), np.tile(depths, (6, 1, 1)), taps, s)
    assert (found == 1.0).all()
