"""A scalp patch that covers all roots of given strands, with a head or without.

The patch of `wrap_scalp` ends at the hairline and lies on the skin. Strands from
elsewhere have roots on cheeks, above the skin or on the band of a ponytail. So a cap is
laid around all of them and drawn to where they are.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy import ndimage

from ..capture.cranium import (
    Cranium,
    disc_to_square,
    find_cranium,
    skin_distance,
    square_to_disc,
)
from ..capture.distance import signed_distance
from ..errors import InputError
from ..model.curve import catmull_rom_weights
from ..model.scalp import SIDE, Scalp, points_on, scalp_uv
from ..types import Mesh, Strands

# Roots farther than this from the head, in the median, are in other units. Metres.
FAR = 0.05
# How wide the roots of hair may stand. Metres.
NARROWEST, WIDEST = 1e-3, 2.0
AZIMUTHS = 72
MARGIN, SMALLEST, LARGEST = np.radians([4.0, 10.0, 165.0])
# A cloud of roots so thin against its width has no sphere of its own.
FLAT = 0.05
# How well roots say where the patch is, how little it bends elsewhere, and how far it
# may be from the skin where no root is near. Metres.
ROOT_SIGMA, BEND_SIGMA, STAY_SIGMA = 0.001, 0.002, 0.1
# Where roots lie farther from an even patch, its lines stand closer. Metres.
MISSED = 0.006
MOST_ROOTS = 20_000
CELLS = 48


class Cap(NamedTuple):
    """What the unit square of the patch covers: directions out of a head.

    Attributes:
        frame: The polar frame.
        border: Polar angle of the border, at even azimuths.
        lines: Where in the square [-1, 1]^2 the lines of control points lie, along u
            and along v.
    """

    frame: Cranium
    border: Float[np.ndarray, " azimuths"]
    lines: Float[np.ndarray, "2 13"]

    def control_directions(self) -> Float[np.ndarray, "13 13 3"]:
        """Return the unit directions of the control points."""
        a, b = np.meshgrid(*self.lines, indexing="ij")
        x, y = square_to_disc(a, b)
        azimuth = np.arctan2(x, y).ravel()
        polar = np.hypot(x, y).ravel() * _limit(self.border, azimuth)
        return self.frame.direction(polar, azimuth).reshape(SIDE, SIDE, 3)

    def square(
        self, points: Float[np.ndarray, "points 3"]
    ) -> Float[np.ndarray, "points 2"]:
        """Return the places of points in the square [-1, 1]^2."""
        polar, azimuth = _polar(self.frame, points)
        share = polar / _limit(self.border, azimuth)
        return disc_to_square(share * np.sin(azimuth), share * np.cos(azimuth))

    def places(
        self, points: Float[np.ndarray, "points 3"]
    ) -> Float[np.ndarray, "points 2"]:
        """Return the places of points in scalp space, nearly."""
        even = np.linspace(0.0, 1.0, SIDE)
        square = self.square(points)
        along = [np.interp(square[:, k], self.lines[k], even) for k in range(2)]
        return np.stack(along, axis=1)


def scalp_for(head: Mesh | None, strands: Strands) -> Scalp:
    """Return a scalp patch that covers the roots of all strands.

    The patch passes through the roots, smoothed, and lies on the skin where there are
    none. Roots that stand off like those on the band of a ponytail draw its lines of
    control points together there.

    Args:
        head: The head; +y up, +z to the face. None has the patch follow roots alone.
        strands: The strands, root first.

    Raises:
        InputError: If there is no strand, a root is not finite, or the roots are too
            far from the head or too far apart to be in metres.
    """
    first = strands.offsets[:-1]
    roots = np.asarray(strands.points[first[first < len(strands.points)]], np.float64)
    _check(roots, head)
    tips = np.asarray(strands.points[strands.offsets[1:] - 1], np.float64)
    frame = _frame(roots, tips, head)
    some = roots[:: len(roots) // MOST_ROOTS + 1]
    even = np.tile(np.linspace(-1.0, 1.0, SIDE), (2, 1))
    cap = Cap(frame, _border(frame, roots), even)
    scalp = _drawn(cap, some, head)
    on = scalp_points(scalp, root_places(scalp, some))
    missed = np.linalg.norm(on - some, axis=1) > MISSED
    if missed.mean() > 0.01:
        cap = cap._replace(lines=_finer_lines(cap.square(some), missed))
        scalp = _drawn(cap, some, head)
    return scalp


def root_places(
    scalp: Scalp, roots: Float[np.ndarray, "strands 3"]
) -> Float[np.ndarray, "strands 2"]:
    """Return (u, v) of the scalp's points that are closest to the roots."""
    kind = scalp.control.dtype
    return np.asarray(_closest(scalp, jnp.asarray(roots, kind)), np.float64)


@jax.jit
def _closest(scalp: Scalp, roots):
    return jax.vmap(scalp_uv, (None, 0))(scalp, roots)


def scalp_points(
    scalp: Scalp, uv: Float[np.ndarray, "places 2"]
) -> Float[np.ndarray, "places 3"]:
    """Return the scalp's points at many places, in metres."""
    kind = scalp.control.dtype
    return np.asarray(points_on(scalp, jnp.asarray(uv, kind)), np.float64)


def _check(roots: Float[np.ndarray, "strands 3"], head: Mesh | None) -> None:
    if not len(roots):
        raise InputError("there is no strand; give a file that holds some.")
    if not np.isfinite(roots).all():
        raise InputError("some roots are not finite numbers; export the strands again.")
    wide = float(np.ptp(roots, axis=0).max())
    if wide > WIDEST or (len(roots) > 1 and wide < NARROWEST):
        raise InputError(
            f"the roots stand {wide:.3g} m wide, which is not hair in metres; scale "
            "the strands to metres."
        )
    if head is None:
        return
    away = np.abs(signed_distance(head, roots[:: len(roots) // 500 + 1]))
    if np.median(away) > FAR:
        span = float(np.ptp(head.vertices, axis=0).max())
        raise InputError(
            f"the roots are {np.median(away):.3g} m from the head in the median (they "
            f"stand {wide:.3g} m wide, the head measures {span:.3g} m); bring strands "
            "and head to metres and to one place."
        )


def _frame(
    roots: Float[np.ndarray, "strands 3"],
    tips: Float[np.ndarray, "strands 3"],
    head: Mesh | None,
) -> Cranium:
    """Return a polar frame whose axis has all roots well before its other pole."""
    frame = _sphere(roots, tips) if head is None else find_cranium(head)
    if head is not None and _polar(frame, roots)[0].max() < LARGEST:
        return frame
    out = roots - frame.centre
    out /= np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-9)
    axis = out.mean(axis=0)
    size = np.linalg.norm(axis)
    axis = axis / size if size > 1e-3 else np.array([0.0, 1.0, 0.0])
    front = np.eye(3)[2] if abs(axis[2]) < 0.9 else -np.eye(3)[1]
    left = np.cross(axis, front)
    left /= np.linalg.norm(left)
    return frame._replace(axes=np.stack([left, np.cross(left, axis), axis]))


def _sphere(
    roots: Float[np.ndarray, "strands 3"], tips: Float[np.ndarray, "strands 3"]
) -> Cranium:
    """Return a frame in the middle of the sphere nearest to the roots."""
    middle = roots.mean(axis=0)
    away = roots - middle
    _, size, axes = np.linalg.svd(away, full_matrices=False)
    width = max(size[0] / np.sqrt(len(roots)), NARROWEST)
    if len(roots) < 4 or size[2] < FLAT * size[0]:
        up = axes[-1] if len(roots) > 3 else np.array([0.0, 1.0, 0.0])
        sign = np.sign((tips - roots).mean(axis=0) @ up) or 1.0
        centre = middle - 2.0 * width * sign * up
    else:
        # |p|^2 = 2 c p + (r^2 - |c|^2), linear in the centre.
        rows = np.column_stack([2.0 * away, np.full(len(away), width)])
        centre = middle + np.linalg.lstsq(rows, (away**2).sum(axis=1))[0][:3]
    return Cranium(centre, np.eye(3)[[0, 2, 1]], 1.0)


def _polar(frame: Cranium, points: Float[np.ndarray, "points 3"]):
    """Return polar angles and azimuths of points."""
    left, front, up = frame.axes @ (points - frame.centre).T
    return np.arctan2(np.hypot(left, front), up), np.arctan2(left, front)


def _limit(
    border: Float[np.ndarray, " azimuths"], azimuth: Float[np.ndarray, " points"]
) -> Float[np.ndarray, " points"]:
    at = np.arange(len(border)) * (2.0 * np.pi / len(border))
    return np.interp(azimuth, at, border, period=2.0 * np.pi)


def _border(
    frame: Cranium, roots: Float[np.ndarray, "strands 3"]
) -> Float[np.ndarray, " azimuths"]:
    """Return a smooth border beyond all roots, as polar angles at even azimuths."""
    polar, azimuth = _polar(frame, roots)
    sector = np.floor(azimuth / (2.0 * np.pi) * AZIMUTHS).astype(int) % AZIMUTHS
    lowest = np.full(AZIMUTHS, SMALLEST)
    for side in (0, 1):  # a root lies between two azimuths
        np.maximum.at(lowest, (sector + side) % AZIMUTHS, polar + MARGIN)
    wide = ndimage.maximum_filter1d(lowest, 7, mode="wrap")
    smooth = ndimage.gaussian_filter1d(wide, 2.0, mode="wrap")
    return np.minimum(np.maximum(smooth, lowest), LARGEST + MARGIN)


def _drawn(cap: Cap, roots: Float[np.ndarray, "strands 3"], head: Mesh | None) -> Scalp:
    """Return the patch on the skin, drawn to the roots by least squares.

    The unknowns are the moves of the control points; they vary as little as can be.
    First roots lie where their directions say, then where they are closest.
    """
    rays = cap.control_directions()
    if head is None:
        away = np.linalg.norm(roots - cap.frame.centre, axis=1)
        skin = np.full((SIDE, SIDE), np.median(away))
    else:
        skin = skin_distance(head, cap.frame, rays.reshape(-1, 3))
        skin = ndimage.median_filter(skin.reshape(SIDE, SIDE), 3)
    bare = (cap.frame.centre + skin[..., None] * rays).reshape(-1, 3)
    bend = np.concatenate(
        [
            np.kron(np.diff(np.eye(SIDE), 2, axis=0), np.eye(SIDE)),
            np.kron(np.eye(SIDE), np.diff(np.eye(SIDE), 2, axis=0)),
        ]
    )
    prior = bend.T @ bend / BEND_SIGMA**2 + np.eye(SIDE**2) / STAY_SIGMA**2
    uv = cap.places(roots)
    for last in (False, True):
        weights = _patch_weights(uv)
        weight = _even_weight(uv) / ROOT_SIGMA**2
        rest = roots - weights @ bare
        normal = weights.T @ (weight[:, None] * weights) + prior
        move = np.linalg.solve(normal, weights.T @ (weight[:, None] * rest))
        scalp = Scalp(jnp.asarray((bare + move).reshape(SIDE, SIDE, 3)))
        if not last:
            uv = root_places(scalp, roots)
    return scalp


def _patch_weights(
    uv: Float[np.ndarray, "strands 2"],
) -> Float[np.ndarray, "strands 169"]:
    """Return how the control points weigh in the patch's points."""
    along = [np.asarray(catmull_rom_weights(SIDE, jnp.asarray(x))) for x in uv.T]
    return np.einsum("si,sj->sij", *along).reshape(len(uv), SIDE**2)


def _even_weight(uv: Float[np.ndarray, "strands 2"]) -> Float[np.ndarray, " strands"]:
    """Return weights with which a dense tuft of roots counts as one of its area."""
    row, column = np.minimum((uv * CELLS).astype(int), CELLS - 1).T
    cell = row * CELLS + column
    return 1.0 / np.bincount(cell, minlength=CELLS**2)[cell]


def _finer_lines(square, missed) -> Float[np.ndarray, "2 13"]:
    """Return lines of which up to half run where roots were missed."""
    share = 0.5 * min(1.0, missed.mean() / 0.05)
    even = np.linspace(-1.0, 1.0, 401)
    lines = []
    for k in range(2):
        count = np.histogram(square[missed, k], np.linspace(-1.0, 1.0, 402))[0]
        dense = ndimage.gaussian_filter1d(count.astype(float), 12.0)
        mix = share * dense / dense.sum() + (1.0 - share) / len(even)
        total = np.concatenate([[0.0], np.cumsum(mix)])
        edges = np.linspace(-1.0, 1.0, 402)
        lines.append(np.interp(np.linspace(0.0, 1.0, SIDE), total / total[-1], edges))
    return np.stack(lines)
