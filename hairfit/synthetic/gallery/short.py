"""Short hair, and hair that stands: pixie, undercut, mohawk, buzz cut, afro."""

import dataclasses

import numpy as np

from ...model import HairTree, Scalp
from ...render.raster import unit
from ..guides import comb_directions
from ..head import CRANIUM, head_normal
from .base import (
    Lay,
    along_of,
    lay,
    ramp,
    root_clusters,
    roots_of,
    settle,
    split,
    widen,
)
from .guides import (
    Sweep,
    length_line,
    paint_maps,
    scalp_line,
    straight_guides,
    swept_guides,
)

# Middle of an afro's ball, and its radius.
BALL, BALL_RADIUS = np.array([0.0, 0.040, -0.018]), 0.158
UP, BACK = np.eye(3)[1], -np.eye(3)[2]
UPRIGHT = Lay(1.0, 1.15)


def afro(scalp: Scalp, seed: int) -> HairTree:
    """Return a ball of hair that stands away from the head, each hair curled."""
    tree = root_clusters(scalp, 40, 16, seed, vary=0.12)
    roots = roots_of(tree)
    tips = BALL + BALL_RADIUS * unit(roots - BALL + 0.02 * head_normal(roots))
    tree = lay(tree, straight_guides(roots, 16, tips), Lay(1.0, 2.6))
    tree = settle(split(tree, 5, seed))
    return dataclasses.replace(tree, maps=paint_maps(scalp, curl=0.0032))


def pixie(scalp: Scalp, seed: int) -> HairTree:
    """Return short hair swept from the crown, shorter at the sides and the nape."""
    tree = root_clusters(scalp, 60, 16, seed, vary=0.25)
    roots = roots_of(tree)
    way = comb_directions(roots, head_normal(roots), 0.0)
    front = ramp(roots[:, 2], 0.0, 0.06)[:, None]
    way = unit((1.0 - front) * way + front * np.array([0.75, -0.1, 0.65]))
    guides = swept_guides(roots, 16, way, 0.075, Sweep(0.5, 0.05, 0.006))
    tree = settle(split(lay(tree, guides, Lay(0.35, 1.3)), 5, seed))

    def length(p):
        return 0.42 + 0.58 * ramp(p[:, 1] + 0.35 * p[:, 2], 0.02, 0.10)

    return dataclasses.replace(tree, maps=paint_maps(scalp, length))


def buzz_cut(scalp: Scalp, seed: int) -> HairTree:
    """Return hair of a few millimetres, shorter towards the nape and the ears."""
    tree = root_clusters(scalp, 36, 16, seed, vary=0.25)
    roots = roots_of(tree)
    tips = roots + 0.009 * head_normal(roots)
    tree = lay(tree, straight_guides(roots, 16, tips), UPRIGHT)
    tree = settle(split(tree, 8, seed))

    def length(p):
        return 0.45 + 0.55 * ramp(p[:, 1], -0.01, 0.09)

    return dataclasses.replace(tree, maps=paint_maps(scalp, length))


def crop_line() -> np.ndarray:
    """Return the closed line around the top of the head above which hair stays long."""
    azimuth = np.linspace(0.0, 2.0 * np.pi, 49)
    polar = np.radians(np.interp(np.cos(azimuth), [-1.0, 0.0, 1.0], [62.0, 46.0, 80.0]))
    level = np.sin(polar)
    ray = np.stack([level * np.sin(azimuth), np.cos(polar), level * np.cos(azimuth)], 1)
    return CRANIUM + 0.095 * ray


def undercut(scalp: Scalp, seed: int) -> HairTree:
    """Return long hair on top, combed over to the right; sides and back cropped."""
    line = scalp_line(scalp, crop_line())
    tree = root_clusters(scalp, 60, 16, seed, [line], vary=0.15)
    roots = roots_of(tree)
    top = on_top(roots)
    way = np.tile([-1.0, 0.0, 0.15], (len(roots), 1))
    off = 0.006 + 0.016 * ramp(roots[:, 0], -0.05, 0.05)
    guides = swept_guides(roots, 16, way, 0.14, Sweep(0.7, 0.10, off))
    cropped = straight_guides(roots, 16, roots + 0.008 * head_normal(roots))
    guides = np.where(top[:, None, None], guides, cropped)
    tree = lay(tree, guides, Lay(0.4, 1.0))
    wide = np.where(top, 0.5, 0.0)[:, None] * ramp(along_of(guides), 0.0, 0.03)
    tree = widen(tree, 1.0 + wide)
    tree = settle(split(tree, np.where(top, 6, 3), seed, [line]))

    def length(p):
        return np.where(on_top(p), 1.0, 0.5 + 0.5 * ramp(p[:, 1], -0.02, 0.06))

    def density(p):
        return np.where(on_top(p), 1.0, 0.8)

    return dataclasses.replace(tree, maps=paint_maps(scalp, length, density))


def on_top(p) -> np.ndarray:
    """Return which points of the scalp are above the line of an undercut."""
    ray = unit(np.asarray(p) - CRANIUM)
    azimuth = np.arctan2(ray[:, 0], ray[:, 2])
    polar = np.degrees(np.arccos(np.clip(ray[:, 1], -1.0, 1.0)))
    return polar < np.interp(np.cos(azimuth), [-1.0, 0.0, 1.0], [62.0, 46.0, 80.0])


def mohawk(scalp: Scalp, seed: int) -> HairTree:
    """Return a crest from the forehead to the nape; the sides are shaved."""
    half = 0.021
    lines = [scalp_line(scalp, length_line(x, 85.0, 130.0)) for x in (-half, half)]
    tree = root_clusters(scalp, 64, 16, seed, lines, vary=0.1)
    roots = roots_of(tree)
    crest = np.abs(roots[:, 0]) < half
    normal = head_normal(roots)
    stand = unit(normal * [0.25, 1.0, 1.0] + 0.35 * BACK + 0.1 * UP)
    tall = roots + 0.085 * stand
    tips = np.where(crest[:, None], tall, roots + 0.004 * normal)
    tree = lay(tree, straight_guides(roots, 16, tips), UPRIGHT)
    fan = 1.0 + np.where(crest, 0.6, 0.0)[:, None] * np.linspace(0.0, 1.0, 16)
    tree = widen(tree, fan)
    tree = settle(split(tree, np.where(crest, 7, 3), seed, lines))

    def density(p):
        return np.where(np.abs(p[:, 0]) < half, 1.0, 0.7)

    return dataclasses.replace(tree, maps=paint_maps(scalp, None, density))
