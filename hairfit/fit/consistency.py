"""The hull where views contradict each other, which no mask tells: there is no hair.

Where three views or more see a voxel of hair, their planes meet in one line. Before the
hair, where the hull is too wide, each view sees other hair behind it, and the planes
disagree, and so does how dark it is. Carving by photo-consistency (Kutulakos & Seitz
2000), with directions and shadows in place of colours, which change with the view.
"""

import dataclasses
import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from ..abreast import abreast
from ..capture.capture import View
from ..capture.orientation import (
    SIGMA_BLIND,
    SIGMA_SURE,
    OrientationMap,
    spread_of_lines,
)
from .curls import mean_line
from .evidence import find_planes, full_matrix
from .grid import blurred
from .hull import Hull, hull_of, pixel_sizes, walls_of
from .shades import Shade, find_shades
from .unexplained import with_unexplained

INCONSISTENT = 1.5  # disagreement over the expected one from which on there is no hair
UNLIKE = 2.0  # times as unlike as usual, likewise; each layer takes one time more
# Where directions contradict each other so much less than elsewhere, what shades would
# cut is hair: thin, before something bright, or cut short it had 0.26 to 0.59 in the
# first two layers, ghosts of other heads 0.65 and more.
DOUBTED = 0.62
ASKED = 2  # layers
LEAST_CUT = 0.1  # of a layer, by which to judge
AROUND = 0.006  # metres: one voxel says little, those around it decide together
LEAST_AROUND = 2.0  # voxels; a single large one is partly air, and differs by itself
DEEP = 0.015  # metres within the surface in which voxels are asked
LEAST_KNOWN = 0.05  # share of the voxels around that three views must see
LEAST_FREEDOM = 0.1  # views beyond the two that always agree
LEAST_COMPARED = 0.9  # views beyond one that tell whether a place is as dark in all
BARE = 0.015  # metres from the skin; nearer it shows, and all hair is thin
MOST_PLACES = 20_000  # that are asked for the exposures
BESIDE = 0.001  # metres by which hair may lie beside a place
SWEEPS = 8
# Where masks are too wide, what is behind what was cut agrees: of the surface, so deep,
# 0.2 times as much is to be cut as at first. Where maps are wrong, 0.35 times and more.
CONVERGED = 0.28
FEWEST_CUT = 0.002  # of the hull; a sweep that cuts less is the last


def carve_by_consistency(
    hull: Hull,
    views: Sequence[View],
    maps: Sequence[OrientationMap],
    depths: Sequence[Float[np.ndarray, "_height _width"]],
    curly: bool = False,
) -> Hull:
    """Return the hull without voxels at its surface where views contradict each other.

    Layer by layer: what is behind a voxel is seen by more views once it is gone. Where
    the first layers show that shades would cut hair, directions alone cut.

    Args:
        hull: The hull that the masks allow.
        views: The photographs.
        maps: Their orientation maps.
        depths: Depth of the head in each photograph, in metres.
        curly: Whether hair curls: then a place's direction is that of hair beside it.
    """
    if len(views) < 3:
        return hull
    if curly:
        pixels = pixel_sizes(hull, views)
        maps = list(abreast(unsure_of_place, [v.hair for v in views], maps, pixels))
    places = hull.grid.centres(surface_of(hull))
    places = places[:: -(-len(places) // MOST_PLACES)]
    see = partial(find_planes, walls_of(hull), places)
    shades = find_shades(hull, views, list(abreast(see, views, maps, depths)))
    ask = partial(contradictions, views=views, maps=maps, depths=depths, shades=shades)
    left = carve_layers(hull, ask)
    gone = hull.hair & ~left.hair
    if not gone.any():
        return left
    hair = with_unexplained(hull.grid, left.hair, gone, views, depths)
    if (hair == left.hair).all():
        return left
    return hull_of(hull.grid, hair, hull.head)


def carve_layers(
    whole: Hull,
    ask: Callable[[Hull], "Contradictions"],
    usual: float = 0.0,
    limit: float = INCONSISTENT,
) -> Hull:
    """Return the hull less what contradictions cut.

    Args:
        whole: The hull that the masks allow.
        ask: How far views contradict each other, given a hull.
        usual: How unlike shades usually are, 0 for what is found; infinite, so that
            none cut, as soon as they turn out to cut hair.
        limit: Disagreement of directions from which on there is no hair; four times as
            much, as if errors of maps were twice what they say, as long as what is cut
            leaves what disagrees as much.
    """
    hull, far, first = whole, whole.head > BARE, 0.0
    last = min(math.ceil(DEEP / whole.grid.spacing), SWEEPS - 1)
    for sweep in range(SWEEPS):
        surface = surface_of(hull)
        found = ask(hull)
        usual = usual or usual_shade(found, surface)
        # What was cut by mistake leaves what looks as bad behind it.
        unlike = far & (found.shaded > (UNLIKE + sweep) * usual)
        if sweep < ASKED and directions_agree(found, surface & far, unlike):
            return carve_layers(whole, ask, np.inf, limit)
        turned = surface & (found.turned > limit)
        share = float(turned.sum() / surface.sum())
        first = first or share
        if sweep == last and share > CONVERGED * max(first, LEAST_CUT):
            return carve_layers(whole, ask, usual, 4.0 * limit)
        cut = turned | (surface & unlike)
        left = hull.hair & ~cut
        # No hull is worse than one that is too wide; what is whole is measured already.
        if not left.any() or not cut.any():
            break
        hull = hull_of(hull.grid, left, hull.head)
        if cut.sum() < FEWEST_CUT * left.sum():
            break
    return hull


def unsure_of_place(
    hair: Bool[np.ndarray, "height width"], found: OrientationMap, pixel: float
) -> OrientationMap:
    """Return a map whose error is also that of hair a little beside the place.

    Which hair a voxel holds is known no better than that: where hair curls, other views
    see another part of the turn.

    Args:
        hair: Which pixels are hair.
        found: The orientation map.
        pixel: Width of a pixel, in metres.
    """
    mean = mean_line(hair, found, pixel, BESIDE)
    turns = spread_of_lines(np.hypot(mean[..., 0], mean[..., 1]))
    sigma = np.minimum(np.hypot(found.sigma, turns), SIGMA_BLIND)
    less = np.maximum(found.sigma, SIGMA_SURE) / np.maximum(sigma, SIGMA_SURE)
    return dataclasses.replace(
        found,
        confidence=(found.confidence * less**2).astype(np.float32),
        sigma=sigma.astype(np.float32),
    )


def surface_of(hull: Hull) -> Bool[np.ndarray, "x y z"]:
    """Return the voxels of hair beside which there is neither hair nor head."""
    solid = ndimage.binary_erosion(hull.hair | (hull.head < 0))
    return hull.hair & ~np.asarray(solid, bool)


class Contradictions(NamedTuple):
    """How far views contradict each other at every voxel; 0 where few look, or deep.

    Attributes:
        turned: How far their planes are from one line, over what their errors explain:
            about 1 where there is hair.
        shaded: How much darker the hair is in some than in others, over how much that
            differs about a place: the ratio of the variances.
    """

    turned: Float[np.ndarray, "x y z"]
    shaded: Float[np.ndarray, "x y z"]


def usual_shade(found: Contradictions, surface: Bool[np.ndarray, "x y z"]) -> float:
    """Return how unlike shades of the hull's surface usually are, to which all compare.

    Infinite, so that none cut, where nobody compares them.

    Args:
        found: How far views contradict each other.
        surface: Voxels of the surface.
    """
    known = surface & (found.shaded > 0.0)
    return float(np.median(found.shaded[known])) if known.any() else np.inf


def directions_agree(
    found: Contradictions,
    asked: Bool[np.ndarray, "x y z"],
    unlike: Bool[np.ndarray, "x y z"],
) -> bool:
    """Return whether directions agree much better where shades do not: that is hair.

    Not where shades would cut next to nothing, which tells nothing.

    Args:
        found: How far views contradict each other.
        asked: Voxels of the surface that shades may cut.
        unlike: Those that they would, and others.
    """
    asked = asked & (found.shaded > 0.0) & (found.turned > 0.0)
    turned, cut = found.turned[asked], unlike[asked]
    if cut.sum() <= LEAST_CUT * len(cut) or cut.all():
        return False
    return bool(np.median(turned[cut]) < DOUBTED * np.median(turned[~cut]))


def contradictions(
    hull: Hull,
    views: Sequence[View],
    maps: Sequence[OrientationMap],
    depths: Sequence[Float[np.ndarray, "_height _width"]],
    shades: Sequence[Shade],
) -> Contradictions:
    r"""Return how far views contradict each other in voxels near the hull's surface.

    The least eigenvalue of $\sum w\,n n^T$ is the sum of the weighted squares of the
    planes' angles to the best line. A view's angle errs by $\sigma$ and has the weight
    $w \propto \sigma^{-2}$, so each contributes the same; two of $n$ views are fitted.

    Args:
        hull: The hull.
        views: The photographs.
        maps: Their orientation maps.
        depths: Depth of the head in each photograph, in metres.
        shades: How dark hair is in each.
    """
    near = hull.hair & (hull.distance > -DEEP)
    points = hull.grid.centres(near)
    entries = np.zeros((len(points), 6))
    told, seen, level = np.zeros((3, 2, len(points)))  # sums, and those of squares
    contrast = np.zeros(len(points))
    planes = abreast(partial(find_planes, walls_of(hull), points), views, maps, depths)
    for plane, shade in zip(planes, shades, strict=True):
        entries += plane.entries
        says = np.where(plane.confidence > 0, plane.seen, 0.0)
        told += says, says**2
        seen += plane.seen, plane.seen**2
        here = shade.level[plane.at]
        level += plane.seen * here, plane.seen * here**2
        contrast += plane.seen * shade.contrast[plane.at]
    least = np.maximum(np.linalg.eigvalsh(full_matrix(entries))[:, 0], 0.0)
    looking = told[0] ** 2 / np.maximum(told[1], 1e-12)
    free = np.maximum(1.0 - 2.0 / np.maximum(looking, 2.0), 0.0) * told[0]
    turned = ratio_around(hull, near, least, SIGMA_SURE**2 * free, free)
    total = np.maximum(seen[0], 1e-12)
    apart = np.maximum(level[1] - level[0] ** 2 / total, 0.0)
    free = seen[0] - seen[1] / total
    expected = free * contrast / total
    shaded = ratio_around(hull, near, apart, expected, free, LEAST_COMPARED)
    return Contradictions(turned, shaded)


def ratio_around(
    hull: Hull,
    near: Bool[np.ndarray, "x y z"],
    found: Float[np.ndarray, " voxels"],
    expected: Float[np.ndarray, " voxels"],
    free: Float[np.ndarray, " voxels"],
    least: float = 0.0,
) -> Float[np.ndarray, "x y z"]:
    """Return what was found over what was to be expected, in places of some voxels.

    Args:
        hull: The hull.
        near: Which voxels are asked.
        found: A sum of squares in each of them.
        expected: What it would be if there was hair.
        free: How many views see it more than are always explained.
        least: How many that must be, in the mean; 0 is said where they are fewer.
    """
    around = max(AROUND / hull.grid.spacing, LEAST_AROUND)
    asked = free > LEAST_FREEDOM
    values = np.where(asked, (found, expected, free, 1.0 * asked), 0.0)
    sums = abreast(lambda one: blurred(near, one, around), values)
    found, expected, free, known = sums
    says = (known > LEAST_KNOWN) & (free >= least * known)
    return np.where(says, found / np.maximum(expected, 1e-12), 0.0)
