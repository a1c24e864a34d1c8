"""Loose hair: straight, wavy and curly, parted, and cut in one line."""

from collections.abc import Collection

import jax
import jax.numpy as jnp
import numpy as np

from ...model import HairTree, Scalp
from ...model.edit import Plane
from ...model.parting import Parting, part
from ...model.reshape import Curl, bend, twist
from ...model.style import extract_style, paste_style
from ...model.tree import graft
from ...model.trim import cut
from ..guides import DOWN, Fall, falling_guides
from .base import (
    Lay,
    along_of,
    below,
    curl_each,
    lay,
    ramp,
    root_clusters,
    roots_of,
    settle,
    split,
    widen,
)
from .guides import Sweep, length_line, scalp_line, swept_guides

FORWARD = np.array([0.0, 0.0, 1.0])
FLAT = Lay(0.25, 1.0)


def falling(tree: HairTree, fall: Fall, how: Lay = FLAT) -> HairTree:
    """Return a tree of root clusters that fall around the head.

    Clusters widen near the scalp and overlap from there on, since their ways part: no
    skin shall show between them.
    """
    guides = falling_guides(roots_of(tree), tree.cylinder.skeleton.shape[1], fall)
    return widen(lay(tree, guides, how), 1.0 + 0.35 * ramp(along_of(guides), 0.0, 0.03))


def long_straight(scalp: Scalp, seed: int) -> HairTree:
    """Return smooth hair that falls over the shoulders."""
    tree = root_clusters(scalp, 36, 16, seed, vary=0.04)
    tree = falling(tree, Fall(0.0, 0.010, -0.220, 0.16, 0.44))
    return settle(split(tree, 7, seed, gather=1.1))


def long_wavy(scalp: Scalp, seed: int) -> HairTree:
    """Return long hair in waves: large ones of the locks, small ones of the strands."""
    tree = root_clusters(scalp, 36, 40, seed)
    tree = falling(tree, Fall(0.012, 0.016, -0.205, 0.14, 0.40))
    rows = np.arange(tree.count)
    large = [Curl(0.0075, pitch, 0.3, 0.12, 0.35) for pitch in (0.060, 0.070)]
    tree = curl_each(tree, rows, large, seed)
    tree = split(tree, 6, seed, gather=1.25)
    small = [Curl(0.0030, pitch, 0.5, 0.15, 0.40) for pitch in (0.045, 0.055)]
    return settle(curl_each(tree, below(tree, rows), small, seed + 1))


def tight_curls(scalp: Scalp, seed: int) -> HairTree:
    """Return ringlets: each child of a lock winds for itself."""
    tree = root_clusters(scalp, 32, 64, seed)
    tree = falling(tree, Fall(0.004, 0.026, -0.075, 0.10, 0.21), Lay(0.6, 1.0))
    tree = split(tree, 8, seed, gather=1.8)
    rows = below(tree, np.arange(32))
    hows = [
        Curl(radius, pitch, 1.0, 0.06, 0.2)
        for radius, pitch in ((0.0045, 0.018), (0.0055, 0.020), (0.0065, 0.022))
    ]
    tree = curl_each(tree, rows, hows, seed)
    return settle(tree)


def bob(scalp: Scalp, seed: int) -> HairTree:
    """Return straight hair cut by a plane at the jaw, its ends bent inwards."""
    tree = root_clusters(scalp, 36, 16, seed, vary=0.025)
    tree = falling(tree, Fall(0.0, 0.012, -0.140, 0.05, 0.36))
    rows = np.arange(tree.count)
    tree = cut(tree, rows, Plane((0.0, -0.088, 0.0), DOWN))
    tips = np.asarray(tree.cylinder.skeleton[:, -1])
    for row, tip in zip(rows, tips, strict=True):
        inward = -np.array([tip[0], 0.0, tip[2] + 0.02])
        tree = bend(tree, int(row), np.cross(DOWN, inward), 0.9, (0.72, 1.0))
    return settle(split(tree, 7, seed, gather=1.1))


def fringe(scalp: Scalp, seed: int) -> HairTree:
    """Return straight hair with a fringe over the forehead, cut above the brows."""
    tree = root_clusters(scalp, 52, 16, seed, vary=0.04)
    roots = roots_of(tree)
    front = (roots[:, 2] > 0.025) & (np.abs(roots[:, 0]) < 0.058)
    guides = falling_guides(roots, 16, Fall(0.0, 0.010, -0.150, 0.14, 0.40))
    way = FORWARD + roots[front] * [3.0, 0.0, 0.0]
    off = 0.006 + 0.12 * np.clip(0.085 - roots[front, 2], 0.0, 0.06)
    guides[front] = swept_guides(roots[front], 16, way, 0.16, Sweep(0.4, 0.05, off))
    wide = np.where(front, 0.7, 0.35)[:, None] * ramp(along_of(guides), 0.0, 0.03)
    tree = widen(lay(tree, guides, FLAT), 1.0 + wide)
    tree = cut(tree, np.flatnonzero(front), Plane((0.0, 0.034, 0.0), DOWN))
    return settle(split(tree, 6, seed))


def parted(scalp: Scalp, seed: int) -> HairTree:
    """Return chin-length hair combed to both sides of a deep parting on the left."""
    x = 0.034
    line = scalp_line(scalp, length_line(x, 80.0, 20.0))
    tree = root_clusters(scalp, 40, 16, seed, [line])
    tree = falling(tree, Fall(x, 0.014, -0.130, 0.12, 0.36))
    tree = part(tree, line, Parting(0.03, 0.04, 0.35))
    return settle(split(tree, 6, seed, [line]))


def dreadlocks(scalp: Scalp, seed: int) -> HairTree:
    """Return ropes of hair: one is twisted from three locks, and pasted on all."""
    tree = root_clusters(scalp, 56, 40, seed, vary=0.03)
    tree = falling(tree, Fall(0.01, 0.020, -0.150, 0.14, 0.34), Lay(1.0, 1.0))
    tree = roped(tree, 0.0062)
    one = split(extract_style(tree, 0), 3, seed, gather=1.1)
    one = twist(one, 0, 2.0 * np.pi * 7.0)
    return settle(pasted_on_all(tree, one, {"children", "twist"}))


def pasted_on_all(
    tree: HairTree, template: HairTree, what: Collection[str]
) -> HairTree:
    """Return a tree of root clusters, each of which has the style of a template.

    Each is pasted in a tree of its own, and all are grafted together at the end.
    """
    parts = [
        paste_style(extract_style(tree, row), template, 0, what=what)
        for row in range(tree.count)
    ]
    fields = [(p.contour, p.cylinder, p.length_variation) for p in parts]
    roots, inner = (
        jax.tree.map(lambda *x, at=at: jnp.concatenate([y[at] for y in x]), *fields)
        for at in (slice(1), slice(1, None))
    )
    above = np.repeat(np.arange(tree.count), template.count - 1)
    contour, cylinder, variation = roots
    bare = HairTree(tree.scalp, contour, cylinder, variation, tree.parent)
    contour, cylinder, variation = inner
    return graft(bare, contour, cylinder, variation, above.tolist())


def roped(tree: HairTree, radius: float) -> HairTree:
    """Return the tree whose clusters thin out to ropes of a radius, in metres."""
    along = along_of(np.asarray(tree.cylinder.skeleton))
    wide = np.asarray(tree.cylinder.radius * abs(tree.cylinder.scale).mean(-1))
    goal = radius / np.maximum(wide, 1e-6)
    grip = ramp(along, 0.0, 0.035)
    return widen(tree, 1.0 + grip * (np.minimum(goal, 1.0) - 1.0))
