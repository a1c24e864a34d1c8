"""Where hair runs in a photograph: an angle in every pixel, and how far to trust it.

The way: the logarithm of the brightness without its smooth part; the energy of oriented
quadrature filters at several wavelengths; votes for a direction, each scale weighted by
how far its votes agree; a mean over an area that is wide where hair runs straight and
narrow where it turns; and from what is left of disagreement the error to expect. All
that once more with filters of half the size, which follow hair that turns within a few
pixels and see more noise: about each place those count that expect to err less.
"""

import dataclasses
import functools
import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32, Shaped

from ..errors import InputError
from .filters import gaussian_blur, halved, line_moments

# The expected error that a guess has, and the one that is trusted in full. Radians.
SIGMA_BLIND = math.radians(60.0)
SIGMA_SURE = math.radians(4.0)
# A texture that varies by less than this share of its brightness counts as flat colour.
FLAT = 0.02
# Contrast beyond this multiple of the median contrast is cut off.
OUTLIER = 4.5
# Filters of half the size err by so much more by chance than their votes say, as they
# see no more pixels.
HALF_CHANCE = 1.8
# They count where the mean of what is expected of them, over a Gaussian of so many
# pixels, is less than this share of the usual filters' squared error; the power says
# how sharply.
AROUND, BETTER, DECIDED = 12.0, 0.8, 8.0
# Hair of more pixels from end to end needs no smaller filters: they cost twice as much.
LARGEST = 1000


@dataclasses.dataclass(frozen=True)
class OrientationMap:
    """The 2D orientation of hair in one photograph.

    Attributes:
        angle: Angle of the line along the hair, from +x towards +y (down), in [0, pi).
        confidence: `(4 degrees / sigma)^2`, at most 1; 0 where there is no hair.
        sigma: Standard deviation of the error of `angle` to expect, in radians, as
            1.4826 times its median: outliers do not count.
    """

    angle: Float[np.ndarray, "height width"]
    confidence: Float[np.ndarray, "height width"]
    sigma: Float[np.ndarray, "height width"]


@dataclasses.dataclass(frozen=True)
class OrientationConfig:
    """What the filters look for. Lengths in pixels.

    Attributes:
        wavelengths: Centres of the bands, three or more: from single hairs to locks.
        length: Length of a filter along the hair, the standard deviation of a Gaussian.
        bandwidth: Standard deviation of the logarithm of the frequency in a band.
        pooling: Gaussians over which votes are gathered, from narrow to wide, two or
            more.
        background: Shading smoother than this Gaussian is taken out.
        dark: Brightness that counts as black, as a share of the hair's median.
    """

    wavelengths: tuple[float, ...] = (4.2, 6.0, 8.5, 12.0, 17.0)
    length: float = 3.5
    bandwidth: float = 0.55
    pooling: tuple[float, ...] = (2.0, 5.0, 12.0)
    background: float = 12.0
    dark: float = 0.1


def estimate_orientation(
    image: Shaped[np.ndarray, "..."],
    hair: Bool[np.ndarray, "height width"],
    *,
    config: OrientationConfig | None = None,
) -> OrientationMap:
    """Return the orientation of the hair in every pixel of a photograph.

    Args:
        image: Linear RGB, `(height, width, 3)`.
        hair: Which pixels are hair.
        config: What the filters look for.

    Returns:
        Angle, confidence and expected error; the confidence is zero outside `hair`.

    Raises:
        InputError: If the sizes differ or the picture holds values that are not finite.
    """
    import cv2

    check_picture(image, hair)
    angle = np.zeros(hair.shape, np.float32)
    sigma = np.full(hair.shape, SIGMA_BLIND, np.float32)
    confidence = np.zeros(hair.shape, np.float32)
    if not hair.any():
        return OrientationMap(angle, confidence, sigma)
    box = bounding_box(hair)
    inside = hair[box]
    config = config or OrientationConfig()
    texture = flatten(image[box], inside, config)
    size = texture.known.shape[::-1]
    votes = mean_votes(texture, config)
    votes = cv2.resize(votes, size, interpolation=cv2.INTER_LINEAR)
    found = Lines(votes[..., :2], error_of(votes))
    if max(inside.shape) <= LARGEST:
        # An enlarged picture holds nothing for the finest band, and its broadest is one
        # of the usual filters.
        inner = dataclasses.replace(config, wavelengths=config.wavelengths[1:-1])
        half = mean_votes(enlarged(texture), inner)
        found = surer_lines(found, half, texture.known)
    line, spread = (one[: inside.shape[0], : inside.shape[1]] for one in found)
    inner = map_of_lines(Lines(line, spread), inside)
    angle[box], confidence[box], sigma[box] = inner.angle, inner.confidence, inner.sigma
    return OrientationMap(angle, confidence, sigma)


def angle_of_line(
    cosine: Float[np.ndarray, "*shape"], sine: Float[np.ndarray, "*shape"]
) -> Float32[np.ndarray, "*shape"]:
    """Return angles of lines, in [0, pi).

    Args:
        cosine: Of twice the angles, times any number above 0.
        sine: The same of the sine.
    """
    turn = (np.arctan2(sine, cosine) / 2).astype(np.float32)
    turn = np.where(turn < 0, turn + np.float32(np.pi), turn)
    # A tiny negative angle becomes pi itself by rounding.
    return np.where(turn >= np.float32(np.pi), np.float32(0), turn)


def line_angle(
    first: Float[np.ndarray, "*shape"], second: Float[np.ndarray, "*shape"]
) -> Float[np.ndarray, "*shape"]:
    """Return the angle between lines, in [0, pi/2]."""
    gap = np.mod(first.astype(np.float64) - second, np.pi)
    return np.minimum(gap, np.pi - gap)


def spread_of_lines(
    agree: Float[np.ndarray, "*shape"],
) -> Float[np.ndarray, "*shape"]:
    """Return the standard deviation of lines about their mean, in radians.

    Args:
        agree: Length of the mean of unit vectors of twice their angles.
    """
    return np.sqrt(-2.0 * np.log(np.clip(agree, 1e-3, 1.0))) / 2.0


def expected_error(
    coherence: Float[np.ndarray, "*shape"],
    bend: Float[np.ndarray, "*shape"],
    more: float = 1.0,
) -> Float[np.ndarray, "*shape"]:
    """Return the error to expect, in radians, as 1.4826 times its median.

    The 1.75 degrees and the exponent were fitted to path-traced photographs of
    straight, tied, short, wavy and curly hair and to drawn waves and noise, all with
    one weight; `benchmarks/orientation.py` prints what they predict beside what is.

    Args:
        coherence: How far votes agree, from 0 to 1.
        bend: Mean square of the turn between narrow and wide areas beyond chance,
            across the vector of the doubled angle.
        more: By what chance errs more than for filters of the usual size.
    """
    coherence = np.maximum(coherence, 1e-3)
    chance = more * math.radians(1.75) / coherence**1.25
    turn = np.sqrt(bend) / (2 * coherence)
    return np.minimum(np.hypot(chance, turn), SIGMA_BLIND).astype(coherence.dtype)


def check_picture(image: np.ndarray, hair: np.ndarray) -> None:
    """Refuse a picture that does not fit its mask, or has holes."""
    if image.shape != (*hair.shape, 3):
        raise InputError(
            f"the picture has the shape {image.shape} and its hair mask {hair.shape}; "
            "give a mask of the picture's size and a picture with three channels."
        )
    if not np.isfinite(image).all():
        raise InputError(
            "the picture holds values that are not finite; save it again without them."
        )


def bounding_box(hair: Bool[np.ndarray, "height width"]) -> tuple[slice, slice]:
    """Return the rows and the columns that hold hair, from an even one on.

    Votes are gathered on every other pixel: which ones must not depend on the hair.
    """
    rows, columns = np.flatnonzero(hair.any(1)), np.flatnonzero(hair.any(0))
    top, left = rows[0] // 2 * 2, columns[0] // 2 * 2
    return slice(top, rows[-1] + 1), slice(left, columns[-1] + 1)


class Lines(NamedTuple):
    """Where hair runs.

    Attributes:
        line: Cosine and sine of twice the angle, times any number above 0.
        spread: The error to expect, in radians.
    """

    line: Float32[np.ndarray, "rows columns 2"]
    spread: Float32[np.ndarray, "rows columns"]


def map_of_lines(
    found: Lines, hair: Bool[np.ndarray, "rows columns"]
) -> OrientationMap:
    """Return the map of hair that runs along lines, which says nothing elsewhere."""
    line, spread = found
    turn = angle_of_line(line[..., 0], line[..., 1])
    # What is no better than a guess says nothing, not little.
    trust = np.where(spread < SIGMA_BLIND, (SIGMA_SURE / spread) ** 2, 0)
    return OrientationMap(
        np.where(hair, turn, np.float32(0)),
        np.where(hair, np.minimum(trust, 1), 0).astype(np.float32),
        np.where(hair, spread, np.float32(SIGMA_BLIND)),
    )


class Texture(NamedTuple):
    """The contrast of the hair and where it is known, 0 outside."""

    contrast: Float32[np.ndarray, "rows columns"]
    known: Float32[np.ndarray, "rows columns"]


def flatten(image: np.ndarray, hair: np.ndarray, config: OrientationConfig) -> Texture:
    """Return the contrast of the hair, padded to even size.

    In the logarithm of the brightness a strand in shadow weighs as much as one in the
    light. The smooth part is a mean over the hair alone, so that the silhouette leaves
    no step.
    """
    import cv2

    light = np.clip(image, 0, None).mean(-1)
    # Half a step of eight bits at the dark end, should all of the hair be black.
    dark = max(config.dark * float(np.median(light[hair])), 1.5e-4)
    value, known = (
        np.pad(array, [(0, count % 2) for count in hair.shape]).astype(np.float32)
        for array in (np.log(light + dark), hair)
    )
    # Pixels at the silhouette show what is behind, too: trust them where no others are.
    around = cv2.blur(known, (5, 5), borderType=cv2.BORDER_CONSTANT)
    inner = np.where(around > 0.999, np.float32(1.01), np.float32(0.01)) * known
    smooth = gaussian_blur(np.stack([value * inner, inner], -1), config.background)
    value = value - smooth[..., 0] / np.maximum(smooth[..., 1], 1e-5)
    # The silhouette's mixed pixels and single bright samples stand out of the texture:
    # they count no more than its strongest strands.
    limit = OUTLIER * np.median(np.abs(value[known > 0]))
    return Texture(np.clip(value, -limit, limit) * known, known)


def enlarged(texture: Texture) -> Texture:
    """Return a texture of twice as many pixels a side, in which filters are half."""
    import cv2

    # Beyond the border all is 0, as it is beside the hair.
    contrast = np.pad(texture.contrast, 2)
    size = tuple(2 * count for count in contrast.shape[::-1])
    contrast = cv2.resize(contrast, size, interpolation=cv2.INTER_CUBIC)[4:-4, 4:-4]
    known = texture.known.repeat(2, axis=0).repeat(2, axis=1)
    return Texture(contrast * known, known)


def error_of(
    votes: Float32[np.ndarray, "rows columns 3"], more: float = 1.0
) -> Float32[np.ndarray, "rows columns"]:
    """Return the error to expect of `mean_votes`, see `expected_error`."""
    return expected_error(np.hypot(votes[..., 0], votes[..., 1]), votes[..., 2], more)


def surer_lines(
    whole: Lines,
    half: Float32[np.ndarray, "rows columns 3"],
    known: Float32[np.ndarray, "rows columns"],
) -> Lines:
    """Return where hair runs by the filters whose votes are surer about each place.

    Args:
        whole: What the filters see.
        half: The votes of filters of half the size, see `mean_votes`.
        known: 1 where there is hair, 0 elsewhere.
    """
    spreads = whole.spread, error_of(half)
    sure = np.stack([known / spread**2 for spread in spreads], axis=2)
    sure = np.maximum(gaussian_blur(sure, AROUND), np.float32(1e-6))
    ratio = sure[..., 0] / (np.float32(BETTER) * sure[..., 1])
    share = 1 / (1 + ratio ** np.float32(DECIDED))
    lines = [
        line / (np.linalg.norm(line, axis=2)[..., None] + 1e-12)
        for line in (whole.line, half[..., :2])
    ]
    line = lines[0] + share[..., None] * (lines[1] - lines[0])
    squares = [whole.spread**2, error_of(half, HALF_CHANCE) ** 2]
    return Lines(line, np.sqrt(squares[0] + share * (squares[1] - squares[0])))


def mean_votes(
    texture: Texture, config: OrientationConfig
) -> Float32[np.ndarray, "half_rows half_columns 3"]:
    """Return mean doubled-angle vectors and their bend, on a grid of half the size.

    The mean vote of a wide area errs least by chance but is wrong where hair turns. It
    is moved towards that of a narrow area by the share of their difference that chance
    does not explain: Wiener's filter, between scales.
    """
    levels = pooled_votes(texture, config)
    noise = vote_noise(config)
    mean, bend = levels[-1], np.zeros_like(levels[-1][..., :1])
    for index in range(len(levels) - 2, -1, -1):
        fine, coarse = levels[index], levels[index + 1]
        size = np.linalg.norm(coarse, axis=2) + np.float32(1e-6)
        turned = (fine[..., 0] * coarse[..., 1] - fine[..., 1] * coarse[..., 0]) / size
        pair = np.stack([turned**2, np.sum(fine**2, axis=2)], axis=-1)
        blurred = gaussian_blur(pair, 0.5 * config.pooling[index + 1])
        seen, agreed = blurred[..., :1], blurred[..., 1:]
        # Half of the noise lies across the vector; only votes that disagree make it.
        chance = np.float32(0.5 * (noise[index] - noise[index + 1]))
        excess = np.maximum(seen - chance * np.maximum(1 - agreed, 0), 0)
        mean = mean + (fine - mean) * (excess / (seen + np.float32(1e-9)))
        bend = bend + excess
    return np.concatenate([mean, bend], axis=2)


def pooled_votes(
    texture: Texture, config: OrientationConfig
) -> list[Float32[np.ndarray, "half_rows half_columns 2"]]:
    """Return the mean votes over wider and wider areas, on a grid of half the size."""
    known = np.float32(FLAT**2) * halved(texture.known)
    votes = np.zeros((*known.shape, 3), np.float32)
    weights = np.full((*known.shape, 1), 1e-9, np.float32)
    for wave in config.wavelengths:
        moments = line_moments(texture.contrast, wave, config.length, config.bandwidth)
        # Flat colour votes for no direction.
        moments[..., 2] += known
        area = gaussian_blur(moments, 0.5 * config.pooling[1])
        # How strong a band is cancels: what counts is how far its votes agree. Coarse
        # waves give fewer independent votes in the same area.
        power = area[..., 2:] + np.float32(1e-9)
        weight = np.linalg.norm(area[..., :2], axis=2, keepdims=True) / power
        weight /= np.float32(wave)
        votes += moments * (weight / power)
        weights += weight
    votes /= weights
    areas = (gaussian_blur(votes, 0.5 * sigma) for sigma in config.pooling)
    return [area[..., :2] / (area[..., 2:] + np.float32(1e-3)) for area in areas]


@functools.cache
def vote_noise(config: OrientationConfig) -> tuple[float, ...]:
    """Return the mean square of the pooled votes where a picture is white noise."""
    noise = np.random.default_rng(0).standard_normal((256, 256)).astype(np.float32)
    levels = pooled_votes(Texture(noise, np.ones_like(noise)), config)
    return tuple(float(np.sum(level**2, axis=2).mean()) for level in levels)
