"""Greedy merging of pixels by their mean log-odds: the simple version, a few seconds per frame.

`splatseg` has the fast one. One run serves all thresholds: the merges for a higher threshold are the first merges for a
lower one.
"""

import heapq

import numpy as np

from .affinities import OFFSETS, ends

LIMIT = 6.0  # log-odds are clamped to ± this


def merges(logits, lowest):
    """Merges in their order, for log-odds [12, H, W]: a list of (kept, merged, bound).

    `kept` and `merged` are pixel indices that represent regions. A merge belongs to all thresholds below `bound`, the
    minimum mean log-odds of the merges so far.
    """
    neighbours = _graph(np.clip(logits, -LIMIT, LIMIT))
    heap = [(-total / count, a, b) for a, near in enumerate(neighbours) for b, (total, count) in near.items() if a < b]
    heapq.heapify(heap)
    done, bound = [], np.inf
    while heap and -heap[0][0] > lowest:
        priority, a, b = heapq.heappop(heap)
        edge = neighbours[a].get(b)
        if edge is None or -edge[0] / edge[1] != priority:
            continue
        if len(neighbours[a]) < len(neighbours[b]):
            a, b = b, a
        bound = min(bound, -priority)
        done.append((a, b, bound))
        _merge(neighbours, heap, a, b)
    return done


def segments(done, threshold, shape):
    """Segment numbers [H, W], from 0, after the merges for the threshold."""
    parents = np.arange(shape[0] * shape[1])
    for kept, merged, bound in done:
        if bound <= threshold:
            break
        parents[merged] = kept
    while (parents[parents] != parents).any():
        parents = parents[parents]
    return np.unique(parents, return_inverse=True)[1].reshape(shape)


def _graph(logits):
    """The neighbours of each pixel: {pixel: (sum of log-odds, edges)}."""
    _, height, width = logits.shape
    pixels = np.arange(height * width).reshape(height, width)
    neighbours = [{} for _ in range(height * width)]
    for offset, values in zip(OFFSETS, logits):
        start, end = ends(height, width, offset)
        edges = zip(pixels[start].ravel().tolist(), pixels[end].ravel().tolist(), values[start].ravel().tolist())
        for a, b, value in edges:
            neighbours[a][b] = neighbours[b][a] = (value, 1)
    return neighbours


def _merge(neighbours, heap, a, b):
    """Merges region b into region a."""
    del neighbours[a][b]
    for c, (total, count) in neighbours[b].items():
        if c == a:
            continue
        other = neighbours[a].get(c, (0.0, 0))
        total, count = total + other[0], count + other[1]
        neighbours[a][c] = neighbours[c][a] = (total, count)
        del neighbours[c][b]
        heapq.heappush(heap, (-total / count, min(a, c), max(a, c)))
    neighbours[b] = {}
