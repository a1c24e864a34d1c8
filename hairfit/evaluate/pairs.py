"""All pairs of points that lie near each other and run within an angle."""

import dataclasses
import itertools
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from .sample import Samples

SLACK = 1e-9
"""A neighbour at the radius itself counts, whatever the last bit says."""

BLOCK = 50_000
"""Pairs looked at in one go: in a core's cache, and below OpenBLAS's own threading."""

ROWS = 64
"""Queries looked at in one go, at most."""

CROWD = 96
"""Cubes that hold more queries than this are looked at in eighths."""


class Pairs(NamedTuple):
    """Neighbours: indices of both points, squared distance, cosine of their angle."""

    query: Int[np.ndarray, " pairs"]
    target: Int[np.ndarray, " pairs"]
    squared: Float[np.ndarray, " pairs"]
    cosine: Float[np.ndarray, " pairs"]

    def choose(self, radius: float, angle_deg: float) -> Bool[np.ndarray, " pairs"]:
        """Return which pairs are near enough and run alike, either way."""
        near = self.squared <= (radius * (1 + SLACK)) ** 2
        return near & (np.abs(self.cosine) >= np.cos(np.radians(angle_deg)) - SLACK)


class Span(NamedTuple):
    """A run of entries of `Cubes.order` for each query."""

    first: Int[np.ndarray, " queries"]
    last: Int[np.ndarray, " queries"]


@dataclasses.dataclass(frozen=True)
class Cubes:
    """Points sorted into cubes of space.

    Attributes:
        side: Width of a cube, in metres.
        origin: Corner of the first cube.
        size: Number of cubes along each axis, two empty ones at both ends included.
        order: The points, cube by cube.
        key: The cube of each entry of `order`; they ascend along z, then y, then x.
    """

    side: float
    origin: Float[np.ndarray, " 3"]
    size: Int[np.ndarray, " 3"]
    order: Int[np.ndarray, " points"]
    key: Int[np.ndarray, " points"]

    @classmethod
    def build(cls, points: Float[np.ndarray, "points 3"], side: float) -> "Cubes":
        """Return `points` sorted into cubes of width `side`."""
        origin = points.min(0) - 2 * side
        cell = np.floor((points - origin) / side).astype(np.int64)
        size = cell.max(0) + 3
        key = cell @ np.array([size[1] * size[2], size[2], 1])
        order = np.argsort(key, kind="stable")
        return cls(side, origin, size, order, key[order])

    @property
    def columns(self) -> Int[np.ndarray, " 9"]:
        """What to add to a cube's key for it and its neighbours across x and y."""
        x, y = np.meshgrid([-1, 0, 1], [-1, 0, 1], indexing="ij")
        return (x * self.size[1] * self.size[2] + y * self.size[2]).ravel()

    def locate(self, points: Float[np.ndarray, "q 3"]) -> Int[np.ndarray, " q"]:
        """Return the key of each point's cube, -1 where no neighbour cube is filled."""
        cell = np.floor((points - self.origin) / self.side)
        inside = np.all((cell >= 1) & (cell <= self.size - 2), axis=1)
        cell = np.where(inside[:, None], cell, 0).astype(np.int64)
        key = cell @ np.array([self.size[1] * self.size[2], self.size[2], 1])
        return np.where(inside, key, -1)

    def span(self, points: Float[np.ndarray, "q 3"]) -> Span:
        """Return which entries share a cube with each point."""
        key = self.locate(points)
        return Span(
            np.searchsorted(self.key, key, side="left"),
            np.searchsorted(self.key, key, side="right"),
        )


def visit_pairs(
    queries: Samples,
    targets: Samples,
    radius: float,
    angle_deg: float,
    visit: Callable[[Pairs], None],
    *,
    wanted: Bool[np.ndarray, " queries"],
    directed: Bool[np.ndarray, " queries"],
) -> None:
    """Call `visit` with all pairs, block by block.

    The queries of one cube meet all targets that can be near, as two small matrix
    products. Blocks come from several threads in any order; those that hold the same
    query come from the same thread.

    Args:
        queries: One set of points.
        targets: The other set.
        radius: Largest distance, in metres.
        angle_deg: Largest angle, in degrees.
        visit: What to do with a block of pairs.
        wanted: The queries to look at.
        directed: Queries that want only targets which run their way; all others also
            want those that run against it.
    """
    # Few queries share a cube where hair is sparse, so cubes start wide.
    side, left = 2 * radius * (1 + 1e-6), np.flatnonzero(wanted)
    cosine = float(np.cos(np.radians(angle_deg))) - SLACK
    limits = Limits(radius * (1 + SLACK), cosine)
    while len(left):
        cubes = Cubes.build(targets.points, side)
        sorted_targets = targets.take(cubes.order)
        key = cubes.locate(queries.points[left])
        left, key = left[key >= 0], key[key >= 0]
        order = np.argsort(key, kind="stable")
        left, key = left[order], key[order]
        filled, start, count = np.unique(key, return_index=True, return_counts=True)
        crowded = count > (CROWD if side > 1.5 * radius else np.inf)
        task = Task(queries, sorted_targets, cubes, limits, directed, visit)
        groups = np.split(left, start[1:])
        chosen = np.flatnonzero(~crowded)
        run_tasks(task, [groups[i] for i in chosen], filled[chosen])
        left = left[np.repeat(crowded, count)]
        side = side / 2


class Limits(NamedTuple):
    """The largest distance and the least cosine of a pair."""

    radius: float
    cosine: float


class Task(NamedTuple):
    """What all threads share."""

    queries: Samples
    targets: Samples
    cubes: Cubes
    limits: Limits
    directed: Bool[np.ndarray, " queries"]
    visit: Callable[[Pairs], None]


def run_tasks(
    task: Task, groups: list[np.ndarray], keys: Int[np.ndarray, " groups"]
) -> None:
    """Visit the pairs of groups of queries, each in its cube, on all cores."""
    middle = keys[:, None] + task.cubes.columns
    first = np.searchsorted(task.cubes.key, middle - 1, side="left")
    last = np.searchsorted(task.cubes.key, middle + 1, side="right")

    def work(part: np.ndarray) -> None:
        for i in part:
            pairs = zip(first[i], last[i], strict=True)
            runs = [slice(int(a), int(b)) for a, b in pairs if b > a]
            if runs:
                visit_cube(task, groups[i], runs)

    workers = len(os.sched_getaffinity(0))
    parts = np.array_split(np.arange(len(groups)), 32)
    with ThreadPoolExecutor(workers) as pool:
        for done in [pool.submit(work, part) for part in parts]:
            done.result()


def visit_cube(
    task: Task, query: Int[np.ndarray, " queries"], runs: list[slice]
) -> None:
    """Visit the pairs of the queries in one cube with the targets in `runs`."""
    q, u = task.queries.points[query], task.queries.directions[query]
    radius, cosine = task.limits
    low, high = q.min(0) - radius, q.max(0) + radius
    t = np.concatenate([task.targets.points[run] for run in runs])
    inside = np.flatnonzero(((t >= low) & (t <= high)).all(1))
    if len(inside) == 0:
        return
    v = np.concatenate([task.targets.directions[run] for run in runs])[inside]
    # Local coordinates keep the matrix form of the distance exact.
    q, t = q - low, t[inside] - low
    # The squared distance is one product: (q, q², 1) times (-2 t, 1, t²).
    left = np.column_stack([q, np.einsum("ij,ij->i", q, q), np.ones(len(q))])
    right = np.column_stack([-2 * t, np.ones(len(t)), np.einsum("ij,ij->i", t, t)])
    for a, b in split(len(q), ROWS):
        only = task.directed[query[a:b]]
        for c, d in split(len(t), BLOCK // max(b - a, 2)):
            squared = multiply(left[a:b], right[c:d])
            along = multiply(u[a:b], v[c:d])
            fits = np.abs(along)
            fits[only] = along[only]
            hit = np.flatnonzero((fits >= cosine) & (squared <= radius * radius))
            if len(hit) == 0:
                continue
            row, column = np.divmod(hit, d - c)
            place = pick(runs, inside[c + column])
            task.visit(
                Pairs(
                    query[a + row],
                    task.cubes.order[place],
                    squared.ravel()[hit],
                    along.ravel()[hit],
                )
            )


def pick(runs: list[slice], index: np.ndarray) -> np.ndarray:
    """Return the entries at `index` of the concatenated `runs`."""
    size = np.cumsum([0] + [run.stop - run.start for run in runs])
    run = np.searchsorted(size, index, side="right") - 1
    start = np.array([run.start for run in runs])
    return start[run] + index - size[run]


def split(count: int, most: int) -> list[tuple[int, int]]:
    """Return the bounds of equal parts of `count` things, at most `most` in each."""
    parts = -(-count // most)
    bounds = [count * i // parts for i in range(parts + 1)]
    return list(itertools.pairwise(bounds))


def multiply(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return `left @ right.T`, on this thread alone.

    OpenBLAS hands products to its own threads unless they are small, and products with
    a vector nearly always; threads inside threads cost up to eight times the time.
    """
    if len(left) > 1:
        return left @ right.T
    return (np.repeat(left, 2, axis=0) @ right.T)[:1]
