"""The ways hair takes from its roots: combed, falling around the head, or tied."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..render.raster import unit
from ..types import Strands
from .head import head_distance, head_normal

STEP = 0.004
DOWN = np.array([0.0, -1.0, 0.0])
TIE = np.array([0.0, 0.050, -0.128])


class Fall(NamedTuple):
    """How loose hair falls.

    Attributes:
        part: x of the parting, in metres; positive is the person's left.
        lift: How far top hair stands off the head, in metres.
        end: Height at which hair is cut, in metres.
        shortest: Least length, in metres.
        longest: Greatest length, in metres.
    """

    part: float
    lift: float
    end: float
    shortest: float
    longest: float


def falling_guides(
    roots: Float[np.ndarray, "guides 3"], knots: int, fall: Fall
) -> Float[np.ndarray, "guides knots 3"]:
    """Return curves that leave the parting, bend over the head and hang from it."""
    normal = head_normal(roots)
    comb = comb_directions(roots, normal, fall.part)
    # Hair that grows higher lies over hair that grows lower.
    height = np.clip((roots[:, 1] + 0.05) / 0.16, 0.0, 1.0)[:, None]
    off = 0.007 + fall.lift * height
    heading = unit(0.40 * normal + 0.85 * comb)
    path = [roots]
    for step in range(1, int(np.ceil(fall.longest / STEP)) + 1):
        along = step * STEP
        p = path[-1]
        combed = np.exp(-along / 0.05)
        target = combed * comb + (1.0 - combed) * DOWN + face_wind(p)
        heading = unit(heading + 0.30 * target)
        rise = smooth_step(along / 0.045)
        moved = keep_off(p + STEP * heading, off * rise)
        heading = unit(moved - p)
        path.append(p + STEP * heading)
    return cut(np.stack(path, 1), knots, fall)


def comb_directions(roots, normal, part: float) -> Float[np.ndarray, "guides 3"]:
    """Return the way each root is combed, along the scalp: away from the parting.

    The parting is a line on top of the head that ends in the whorl.
    """
    z = np.clip(roots[:, 2], -0.045, 0.08)
    front = smooth_step((z + 0.045) / 0.06)
    line = np.stack([part * front, np.full(len(roots), 0.125), z], 1)
    away = roots - line
    away[:, 0] += 0.015 * front * np.where(away[:, 0] >= 0.0, 1.0, -1.0)
    away[:, 2] -= 0.5 * np.clip(roots[:, 2], 0.0, None)
    away -= np.einsum("ij,ij->i", away, normal)[:, None] * normal
    return unit(away)


def face_wind(p: Float[np.ndarray, "guides 3"]) -> Float[np.ndarray, "guides 3"]:
    """Return what turns hair away from the face, to the side and back."""
    strength = smooth_step((p[:, 2] - 0.030) / 0.04) * smooth_step(
        (0.085 - p[:, 1]) / 0.05
    )
    side = np.where(p[:, 0] >= 0.0, 1.0, -1.0)
    return strength[:, None] * np.stack([1.2 * side, 0.0 * side, -1.0 + 0.0 * side], 1)


def keep_off(p, off) -> Float[np.ndarray, "guides 3"]:
    """Return points moved out of the head until they are `off` outside of it."""
    for _ in range(3):
        missing = np.maximum(off - head_distance(p)[:, None], 0.0)
        p = p + missing * head_normal(p)
    return p


def cut(path, knots: int, fall: Fall) -> Float[np.ndarray, "guides knots 3"]:
    """Return paths cut at a height, with `knots` points at even distances."""
    steps = np.arange(path.shape[1])
    below = path[:, :, 1] < fall.end
    last = np.where(below.any(1), below.argmax(1), len(steps) - 1)
    last = np.clip(last, int(fall.shortest / STEP), None)
    pieces = [one[: end + 1] for one, end in zip(path, last, strict=True)]
    return resampled(pieces, knots)


def tied_guides(
    roots: Float[np.ndarray, "guides 3"], knots: int, tail: float
) -> Float[np.ndarray, "guides knots 3"]:
    """Return curves that run over the head to a tie at its back and hang from there."""
    normal = head_normal(roots)
    to_tie = unit(TIE - roots)
    heading = unit(0.5 * normal + to_tie)
    # Hair from further away lies over hair from near the tie.
    far = np.linalg.norm(roots - TIE, axis=1)[:, None]
    off = 0.004 + 0.035 * np.clip(far, 0.0, 0.2)
    around = (roots - TIE) * [1.0, 1.0, 0.0]
    around = 0.011 * np.tanh(far / 0.1) * unit(around + 1e-9)
    gate = TIE + around
    path, p = [roots], roots
    for step in range(1, 90):
        rest = gate - p
        distance = np.linalg.norm(rest, axis=1, keepdims=True)
        heading = unit(heading + 0.6 * unit(rest))
        near = smooth_step(distance / 0.05)
        rise = smooth_step(step * STEP / 0.03) * near
        heading = unit(near * heading + (1.0 - near) * unit(rest + 1e-12))
        moved = p + np.minimum(STEP, distance) * heading
        p = np.where(distance > 1e-9, keep_off(moved, off * rise), p)
        path.append(p)
    over = np.stack(path, 1)
    pieces = []
    for one, goal, offset in zip(over, gate, around, strict=True):
        there = int(np.argmin(np.linalg.norm(one - goal, axis=1)))
        pieces.append(np.concatenate([one[:there], hanging_tail(offset, tail)]))
    return resampled(pieces, knots)


def hanging_tail(offset, length: float) -> Float[np.ndarray, "steps 3"]:
    """Return how one part of a ponytail hangs from the tie."""
    heading, p = unit(np.array([0.0, 0.15, -1.0])), TIE
    path = []
    for along in np.arange(0.0, length, STEP):
        spread = 1.0 + 1.1 * smooth_step(along / 0.06) - 0.8 * (along / length) ** 2
        # The cross-section turns with the tail: what is on top becomes the outside.
        side = np.array([offset[0], 0.0, 0.0])
        up = offset[1] * unit(np.array([0.0, -heading[2], heading[1]]))
        path.append(p + spread * (side + up))
        heading = unit(heading + 0.17 * DOWN)
        p = p + STEP * heading
    return np.array(path)


def resampled(pieces, knots: int) -> Float[np.ndarray, "guides knots 3"]:
    """Return polylines with `knots` points each, at even distances."""
    offsets = np.cumsum([0, *map(len, pieces)])
    return Strands(np.concatenate(pieces), offsets).resample(knots)


def smooth_step(x):
    """Return 0 below 0, 1 above 1, and a smooth way between."""
    x = np.clip(x, 0.0, 1.0)
    return x * x * (3.0 - 2.0 * x)
