"""How wide the waves and curls of strands are, and how long one of them is.

The residual of a strand from its smooth centre line is what curls. Its period is the
peak of the spectrum of the strand's tangents, in which the bend of the head and the
fall of the hair fade, as they are slow. The centre line is the mean over one period,
which leaves nothing of a wave and of a helix its axis.
"""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.interpolate import CubicSpline

from ..types import Strands, resample_paths
from .visibility import even_strands

LEAST_RADIUS = 3e-4
"""What deviates less from its centre line is straight, in metres."""

LEAST_ANGLE_DEG = 10.0
"""A strand that never runs at such an angle to its centre line is straight."""

LEAST_PERIODS = 2.5
"""A strand that holds fewer periods is bent, not curled."""

LEAST_POINTS = 4
"""Points in one period, below which points of strands cannot tell its length."""

LEAST_SHARE = 0.4
"""Share of the tangents' power, apart from slow bends, that one period must hold."""

SAMPLES = 128
"""Points by which every strand is measured."""

FINER = 4
"""Points put in place of one, by a spline, before arc lengths are measured."""

CHUNK = 250
"""Strands that are measured together: more of them would not fit into caches."""

PADDING = 2
"""Length of the transform over that of what is transformed."""

Rows = Float[np.ndarray, "strands samples 3"]


class Curls(NamedTuple):
    """Waves and curls of strands. Metres.

    Attributes:
        radius: From the centre line to the crest of a wave, or the radius of a helix,
            as a quadratic mean along the strand.
        pitch: Length of one wave or turn along the centre line.
        curled: Which strands curl; the radius and pitch of the others mean nothing.
    """

    radius: Float[np.ndarray, " strands"]
    pitch: Float[np.ndarray, " strands"]
    curled: Bool[np.ndarray, " strands"]


@dataclasses.dataclass(frozen=True)
class CurlErrors:
    """Waves and curls of recovered and of true hair. Metres.

    Attributes:
        share: Share of the recovered strands that curl.
        true_share: Share of the true ones.
        radius: Median radius of the recovered strands that curl; None if none does.
        true_radius: The same of the true ones.
        pitch: Median pitch of the recovered strands that curl; None if none does.
        true_pitch: The same of the true ones.
    """

    share: float
    true_share: float
    radius: float | None
    true_radius: float | None
    pitch: float | None
    true_pitch: float | None

    @property
    def radius_error(self) -> float | None:
        """The recovered radius over the true one, less 1; None if one is unknown."""
        return relative(self.radius, self.true_radius)

    @property
    def pitch_error(self) -> float | None:
        """The recovered pitch over the true one, less 1; None if one is unknown."""
        return relative(self.pitch, self.true_pitch)


def relative(found: float | None, true: float | None) -> float | None:
    """Return one length over another, less 1; None if one is unknown."""
    return None if found is None or true is None else found / true - 1.0


def compare_curls(pred: Strands, truth: Strands) -> CurlErrors:
    """Return how waves and curls of recovered and true strands differ."""
    found, true = find_curls(pred), find_curls(truth)
    return CurlErrors(
        share=float(found.curled.mean()),
        true_share=float(true.curled.mean()),
        radius=median_of(found.radius, found.curled),
        true_radius=median_of(true.radius, true.curled),
        pitch=median_of(found.pitch, found.curled),
        true_pitch=median_of(true.pitch, true.curled),
    )


def median_of(
    values: Float[np.ndarray, " strands"], curled: Bool[np.ndarray, " strands"]
) -> float | None:
    """Return the median over strands that curl; None if none does."""
    return float(np.median(values[curled])) if curled.any() else None


def find_curls(strands: Strands) -> Curls:
    """Return the waves and curls of strands.

    Turns of fewer than four points are not found, and strands that hold fewer than two
    and a half turns count as straight.

    Args:
        strands: The strands, of which at least one has two points or more.
    """
    points = np.asarray(even_strands(strands), np.float64)
    parts = [
        curls_of_rows(points[first : first + CHUNK])
        for first in range(0, len(points), CHUNK)
    ]
    return Curls(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def curls_of_rows(points: Float[np.ndarray, "strands knots 3"]) -> Curls:
    """Return the waves and curls of strands with equal counts of points."""
    knots = points.shape[1]
    if knots < LEAST_PERIODS * LEAST_POINTS:
        none = np.zeros(len(points))
        return Curls(none, none, none > 0.0)
    if knots < SAMPLES:
        spline = CubicSpline(np.arange(knots), points, axis=1)
        points = spline(np.linspace(0, knots - 1, FINER * (knots - 1) + 1))
    # From the root, in float32: half of the time, and still finer than a micrometre.
    rows = (resample_paths(points, SAMPLES) - points[:, :1]).astype(np.float32)
    peak = strongest_period(rows, knots)
    # In samples; a window that is as long as the strand leaves nothing to measure.
    period = np.clip(peak.period, 2.0, (SAMPLES - 1) / LEAST_PERIODS)
    period = period.astype(np.float32)
    centre = centre_line(rows, period)
    square = square_radius(rows - centre, period)
    # Where neither windows nor quarters of a period reach beyond the ends.
    margin = np.minimum(0.75 * period, 0.5 * (SAMPLES - 1) - 1.0)[:, None]
    index = np.arange(SAMPLES)
    whole = (index >= margin) & (index <= SAMPLES - 1 - margin)
    weight = np.where(whole, square, 0.0)
    radius = np.sqrt(weight.sum(1) / whole.sum(1))
    # Where a strand curls most it has decided its period, too.
    steps = np.linalg.norm(np.gradient(centre, axis=1), axis=2)
    advance = (steps * weight).sum(1) / np.maximum(weight.sum(1), 1e-30)
    pitch = period * advance
    steep = 2.0 * np.pi * radius >= np.tan(np.radians(LEAST_ANGLE_DEG)) * pitch
    curled = (peak.share >= LEAST_SHARE) & (radius >= LEAST_RADIUS) & steep
    return Curls(radius.astype(np.float64), pitch.astype(np.float64), curled)


class Peak(NamedTuple):
    """The period that dominates in each strand.

    Attributes:
        period: Its length, in samples; 0 where none stands out.
        share: Share of the power, apart from slow bends, that it holds.
    """

    period: Float[np.ndarray, " strands"]
    share: Float[np.ndarray, " strands"]


def strongest_period(rows: Rows, knots: int) -> Peak:
    """Return the period that dominates in the tangents of strands.

    Args:
        rows: Points at equal distances along each strand.
        knots: Number of points that are known of each strand.
    """
    tangent = detrended(np.diff(rows, axis=1))
    count = tangent.shape[1]
    length = PADDING * count
    window = np.hanning(count + 2)[1:-1, None].astype(rows.dtype)
    power = np.abs(np.fft.rfft(tangent * window, length, axis=1)) ** 2
    power = power.sum(2)
    # In bins of 1 / PADDING periods a strand, with one more at each end to compare.
    low = int(np.ceil(PADDING * LEAST_PERIODS))
    high = max(min(PADDING * knots // LEAST_POINTS, power.shape[1] - 2), low)
    inner = power[:, low : high + 1]
    is_peak = (inner >= power[:, low - 1 : high]) & (
        inner > power[:, low + 1 : high + 2]
    )
    found = np.where(is_peak, inner, 0.0)
    best = low + found.argmax(1)
    row = np.arange(len(rows))
    known = found.max(1) > 0.0
    before, at, after = (
        np.log(np.maximum(power[row, best + k], 1e-30)) for k in (-1, 0, 1)
    )
    bend = np.minimum(before - 2.0 * at + after, -1e-12)
    frequency = (best + np.clip(0.5 * (before - after) / bend, -0.5, 0.5)) / length
    # What Hann's window spreads one frequency over, and no two of them share.
    reach = 2 * PADDING - 1
    total = np.cumsum(power, axis=1)
    near = total[row, np.minimum(best + reach, power.shape[1] - 1)]
    near = near - total[row, np.maximum(best - reach, low) - 1]
    swift = np.maximum(total[:, -1] - total[:, low - 1], 1e-30)
    return Peak(
        np.where(known, 1.0 / frequency, 0.0), np.where(known, near / swift, 0.0)
    )


def detrended(
    values: Float[np.ndarray, "strands samples 3"],
) -> Float[np.ndarray, "strands samples 3"]:
    """Return values without the straight line that fits them best."""
    t = np.linspace(-1.0, 1.0, values.shape[1], dtype=values.dtype)[:, None]
    slope = (values * t).sum(1, keepdims=True) / (t**2).sum()
    return values - values.mean(1, keepdims=True) - slope * t


def centre_line(rows: Rows, period: Float[np.ndarray, " strands"]) -> Rows:
    r"""Return the smooth curves that strands curl about.

    The mean $H$ over one period leaves nothing of a wave, but cuts the corners of the
    centre line; $2H - H^2$ cuts far less, and still leaves nothing of a wave.
    """
    once = window_mean(rows, period)
    return 2.0 * once - window_mean(straightened(once, period), period)


def window_mean(rows: Rows, period: Float[np.ndarray, " strands"]) -> Rows:
    """Return the mean over a window about every sample; samples are joined by lines.

    Within half a window of an end, the first or last whole window counts.
    """
    count = rows.shape[1]
    total = np.cumsum(0.5 * (rows[:, 1:] + rows[:, :-1]), axis=1)
    total = np.concatenate([np.zeros_like(rows[:, :1]), total], axis=1)
    half = 0.5 * period[:, None]
    middle = np.clip(np.arange(count, dtype=np.float32), half, count - 1 - half)
    ends = [integral(rows, total, middle + side * half) for side in (-1, 1)]
    return (ends[1] - ends[0]) / period[:, None, None]


def integral(rows: Rows, total: Rows, at: Float[np.ndarray, "strands samples"]) -> Rows:
    """Return the integrals of strands from their roots to places between samples."""
    index = np.clip(at.astype(np.int64), 0, rows.shape[1] - 2)
    row = np.arange(len(rows))[:, None]
    part = (at - index).astype(rows.dtype)[..., None]
    start, end = rows[row, index], rows[row, index + 1]
    return total[row, index] + part * (start + part * (end - start) / 2)


def straightened(rows: Rows, period: Float[np.ndarray, " strands"]) -> Rows:
    """Return means over windows, made to go straight on where no window fits."""
    count = rows.shape[1]
    row = np.arange(len(rows))
    first = np.ceil(0.5 * period).astype(np.int64)
    index = np.arange(count)
    out = rows
    for edge, step in ((first, 1), (count - 1 - first, -1)):
        beyond = ((index - edge[:, None]) * step).astype(rows.dtype)
        inner = np.clip(edge + step, 0, count - 1)
        slope = rows[row, inner] - rows[row, edge]
        line = rows[row, edge][:, None] + beyond[..., None] * slope[:, None]
        out = np.where((beyond < 0)[..., None], line, out)
    return out


def square_radius(
    residual: Rows, period: Float[np.ndarray, " strands"]
) -> Float[np.ndarray, "strands samples"]:
    r"""Return the squares of the radii of curls, from what leaves the centre line.

    A sample $u$ and half of the change $v$ from a quarter of a period before to one
    after are at right angles, or in line. The greatest eigenvalue of $u u^T + v v^T$
    is the square of the radius of a helix, that of a planar wave's height, and that of
    the greater half-axis of what lies between.
    """
    count = residual.shape[1]
    quarter = 0.25 * period[:, None]
    index = np.arange(count, dtype=np.float32)
    later, sooner = (
        between(residual, np.clip(index + side * quarter, 0, count - 1))
        for side in (1, -1)
    )
    v = 0.5 * (later - sooner)
    trace = np.einsum("ijk,ijk->ij", residual, residual)
    moved = np.einsum("ijk,ijk->ij", v, v)
    product = np.einsum("ijk,ijk->ij", residual, v)
    apart = np.sqrt((trace - moved) ** 2 + 4.0 * product**2)
    return 0.5 * (trace + moved + apart)


def between(rows: Rows, at: Float[np.ndarray, "strands samples"]) -> Rows:
    """Return the points at places between samples."""
    index = np.clip(at.astype(np.int64), 0, rows.shape[1] - 2)
    row = np.arange(len(rows))[:, None]
    part = (at - index).astype(rows.dtype)[..., None]
    return (1 - part) * rows[row, index] + part * rows[row, index + 1]
