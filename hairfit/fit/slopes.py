"""How steep curls are: by how far hair runs across its locks in photographs.

Hair of a helix runs `T cos a` across its lock for each metre along, where `T` is 2 pi
radii over the pitch, and `a` the angle about the lock, 0 at its middle. One sees the
front half, whose area in the picture goes with `cos a`, or where locks are few the
back as well. What one sees in the mean depends on that, and on the sides of turns that
others hide; the steepest is near the middle of the front in any case. Of fronts a share
`q` runs less far across than `T sqrt(1 - (1 - q)^2)`.

Hair that waves in a plane runs `T cos a cos b` across its lock in a photograph that
sees that plane at an angle `b`. With `a` and `b` even, half of it runs less far across
than 0.36 `T`.
"""

import numpy as np
from jaxtyping import Bool, Float

from ..capture.orientation import OrientationMap, angle_of_line, line_angle

# Share of a photograph's hair whose locks are told best: what the slope of waves is
# read from, and that of curls.
SUREST, SUREST_CURLS = 0.4, 0.6
# Power of the confidence by which pixels count: both sides of a turn and the slopes
# between a wave's crests do, which are seen less sharply than its crests.
TRUST = 0.25
STEEP = 0.75  # share of it that is less steep than what tells the slope
# Share of waving hair that tells its slope, and what that crosses of `T`.
HALF, FLAT = 0.5, 0.36
BINS = 180  # of angles from 0 to a right one
EDGES = np.linspace(0.0, 0.5 * np.pi, BINS + 1)

Crossing = Float[np.ndarray, " bins"]


def cross_locks(
    hair: Bool[np.ndarray, "height width"],
    found: OrientationMap,
    lines: Float[np.ndarray, "height width 2"],
    surest: float = SUREST,
    trust: float = TRUST,
) -> Crossing:
    """Return at which angles hair crosses its locks where these are told best.

    Args:
        hair: Which pixels are hair.
        found: The orientation map.
        lines: Cosine and sine of twice the angle of the locks, the longer the surer.
        surest: Share of the hair that counts.
        trust: Power of the map's confidence by which it counts.

    Returns:
        The weights of angles between `EDGES`.
    """
    if not hair.any():
        return np.zeros(BINS)
    sure = np.hypot(lines[..., 0], lines[..., 1])
    best = hair & (sure > np.quantile(sure[hair], 1.0 - surest))
    off = line_angle(found.angle[best], angle_of_line(lines[best, 0], lines[best, 1]))
    weight = found.confidence[best].astype(np.float64) ** trust
    return np.histogram(off, EDGES, weights=weight)[0]


def mean_cosine(crossing: Crossing) -> float:
    """Return the mean cosine of twice the angle: 1 along locks, -1 across them."""
    middle = 0.5 * (EDGES[1:] + EDGES[:-1])
    total = crossing.sum()
    return float(crossing @ np.cos(2.0 * middle) / total) if total > 0.0 else 1.0


def slope_of(crossing: Crossing) -> float:
    """Return the slope of curls that cross their locks so: metres across a metre along.

    It is finite: the steepest angle that tells is below a right one.
    """
    return crossed_by(crossing, STEEP) / float(np.sqrt(1.0 - (1.0 - STEEP) ** 2))


def wave_slope_of(crossing: Crossing) -> float:
    """Return the steepest slope of waves that cross their locks so, likewise."""
    return crossed_by(crossing, HALF) / FLAT


def radius_at(slope: float, pitch: float) -> float:
    """Return how far from its middle hair of a slope goes, in metres.

    Args:
        slope: Of curls or waves: metres across a metre along.
        pitch: Length of a turn or a wave, in metres.
    """
    return pitch * slope / (2.0 * np.pi)


def crossed_by(crossing: Crossing, share: float) -> float:
    """Return the slope than which a share of hair crosses its locks less steeply."""
    total = np.concatenate([[0.0], np.cumsum(crossing)])
    if total[-1] <= 0.0:
        return 0.0
    angle = np.interp(share * total[-1], total, EDGES)
    return float(np.tan(min(angle, EDGES[-2])))
