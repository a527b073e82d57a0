"""Which boxes around points a camera need not look at."""

from __future__ import annotations

import numpy as np

from torchrender.kernels.compile import kernel


@kernel(inline=True)
def reach(node, plane):
    """Least and greatest n.p + d over the corners of a box."""
    middle = plane[0] * node[0] + plane[1] * node[1] + plane[2] * node[2] + plane[3]
    away = 0.0
    for k in range(3):
        away += abs(plane[0] * node[3 + 3 * k] + plane[1] * node[4 + 3 * k] + plane[2] * node[5 + 3 * k]) * node[12 + k]
    return middle - away, middle + away


@kernel()
def visible(nodes, links, roots, planes, shadows, runs):
    """Walk the trees from ``roots``; see ``walkthrough.culling``.

    Args:
        nodes: (K,15) boxes. links (K,4): first point, one past the last, first child, one past the last child.
        planes: (F,4) of the view, inside >= 0. shadows (S,E,4): a point with > 0 for all E is hidden.
        runs: (K,2) receives the points to look at.

    Returns:
        runs found, points outside the view, points hidden.
    """
    stack = np.empty(len(links) + 1, np.int64)
    found, outside, hidden = 0, 0, 0
    for r in range(len(roots)):
        stack[0], depth = roots[r], 1
        while depth > 0:
            depth -= 1
            k = stack[depth]
            count = links[k, 1] - links[k, 0]
            gone, whole = False, True
            for p in range(len(planes)):
                low, high = reach(nodes[k], planes[p])
                if high < 0.0:
                    gone = True
                    break
                whole = whole and low >= 0.0
            if gone:
                outside += count
                continue
            covered, touched = False, False
            for s in range(len(shadows)):
                inside, meets = True, True
                for p in range(shadows.shape[1]):
                    low, high = reach(nodes[k], shadows[s, p])
                    if high <= 0.0:
                        inside, meets = False, False
                        break
                    inside = inside and low > 0.0
                covered = covered or inside
                touched = touched or meets
                if covered:
                    break
            if covered:
                hidden += count
            elif links[k, 2] == links[k, 3] or (whole and not touched):
                runs[found, 0], runs[found, 1] = links[k, 0], links[k, 1]
                found += 1
            else:
                for child in range(links[k, 2], links[k, 3]):
                    stack[depth] = child
                    depth += 1
    return found, outside, hidden
