"""Where hair runs in a photograph: an angle in every pixel, and how far to trust it.

The way: the logarithm of the brightness without its smooth part; the energy of oriented
quadrature filters at several wavelengths; votes for a direction, each scale weighted by
how far its votes agree; a mean over an area that is wide where hair runs straight and
narrow where it turns; and from what is left of disagreement the error to expect.
"""

import dataclasses
import functools
import math
import os
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Shaped

from ..errors import InputError
from .filters import gaussian_blur, line_moments, one_thread_per_operation

if TYPE_CHECKING:
    from torch import Tensor

# The expected error that a guess has, and the one that is trusted in full. Radians.
SIGMA_BLIND = math.radians(60.0)
SIGMA_SURE = math.radians(4.0)
# A texture that varies by less than this share of its brightness counts as flat colour.
FLAT = 0.02
# Contrast beyond this multiple of the median contrast is cut off.
OUTLIER = 4.5


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
        wavelengths: Centres of the bands: from single hairs to locks.
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
    check_picture(image, hair)
    angle = np.zeros(hair.shape, np.float32)
    sigma = np.full(hair.shape, SIGMA_BLIND, np.float32)
    confidence = np.zeros(hair.shape, np.float32)
    if not hair.any():
        return OrientationMap(angle, confidence, sigma)
    box = bounding_box(hair)
    inside = hair[box]
    config = config or OrientationConfig()
    with one_thread_per_operation():
        votes = mean_votes(flatten(image[box], inside, config), config).cpu().numpy()
    cosine, sine, bend = votes[:, : inside.shape[0], : inside.shape[1]]
    turn = np.arctan2(sine, cosine) / 2
    turn = np.where(turn < 0, turn + np.float32(np.pi), turn)
    # A tiny negative angle becomes pi itself by rounding.
    turn = np.where(turn >= np.float32(np.pi), 0, turn)
    spread = expected_error(np.hypot(cosine, sine), bend)
    angle[box] = np.where(inside, turn, 0)
    sigma[box] = np.where(inside, spread, SIGMA_BLIND)
    # What is no better than a guess says nothing, not little.
    trust = np.where(spread < SIGMA_BLIND, (SIGMA_SURE / spread) ** 2, 0)
    confidence[box] = np.where(inside, np.minimum(trust, 1), 0)
    return OrientationMap(angle, confidence, sigma)


def expected_error(
    coherence: Float[np.ndarray, "*shape"], bend: Float[np.ndarray, "*shape"]
) -> Float[np.ndarray, "*shape"]:
    """Return the error to expect, in radians, as 1.4826 times its median.

    The 1.75 degrees and the exponent were fitted to path-traced photographs of
    straight, tied, short, wavy and curly hair and to drawn waves and noise, all with
    one weight; `benchmarks/orientation.py` prints what they predict beside what is.

    Args:
        coherence: How far votes agree, from 0 to 1.
        bend: Mean square of the turn between narrow and wide areas beyond chance,
            across the vector of the doubled angle.
    """
    coherence = np.maximum(coherence, 1e-3)
    chance = math.radians(1.75) / coherence**1.25
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


class Texture(NamedTuple):
    """The contrast of the hair and where it is known, 0 outside; `(rows, columns)`."""

    contrast: "Tensor"
    known: "Tensor"


def flatten(image: np.ndarray, hair: np.ndarray, config: OrientationConfig) -> Texture:
    """Return the contrast of the hair, padded to even size.

    In the logarithm of the brightness a strand in shadow weighs as much as one in the
    light. The smooth part is a mean over the hair alone, so that the silhouette leaves
    no step.
    """
    import torch

    light = np.clip(image, 0, None).mean(-1)
    # Half a step of eight bits at the dark end, should all of the hair be black.
    dark = max(config.dark * float(np.median(light[hair])), 1.5e-4)
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    value, known = (
        torch.from_numpy(
            np.pad(array, [(0, count % 2) for count in hair.shape]).astype(np.float32)
        ).to(device)
        for array in (np.log(light + dark), hair)
    )
    # Pixels at the silhouette show what is behind, too: trust them where no others are.
    around = torch.nn.functional.avg_pool2d(known[None], 5, 1, 2)[0]
    inner = ((around > 0.999) + 0.01) * known
    smooth = gaussian_blur(torch.stack([value * inner, inner]), config.background)
    value = value - smooth[0] / smooth[1].clamp_min(1e-5)
    # The silhouette's mixed pixels and single bright samples stand out of the texture:
    # they count no more than its strongest strands.
    limit = OUTLIER * float(value[known > 0].abs().median())
    return Texture(value.clamp(-limit, limit) * known, known)


def mean_votes(texture: Texture, config: OrientationConfig) -> "Tensor":
    """Return the mean doubled-angle vector and its bend, `(3, rows, columns)`.

    The mean vote of a wide area errs least by chance but is wrong where hair turns. It
    is moved towards that of a narrow area by the share of their difference that chance
    does not explain: Wiener's filter, between scales.
    """
    import torch

    levels = pooled_votes(texture, config)
    noise = vote_noise(config)
    mean, bend = levels[-1], torch.zeros_like(levels[-1][0])
    for index in range(len(levels) - 2, -1, -1):
        fine, coarse = levels[index], levels[index + 1]
        size = torch.linalg.vector_norm(coarse, dim=0) + 1e-6
        turned = (fine[0] * coarse[1] - fine[1] * coarse[0]) / size
        seen, agreed = gaussian_blur(
            torch.stack([turned**2, (fine**2).sum(0)]), 0.5 * config.pooling[index + 1]
        )
        # Half of the noise lies across the vector; only votes that disagree make it.
        chance = 0.5 * (noise[index] - noise[index + 1]) * (1 - agreed).clamp_min(0)
        excess = (seen - chance).clamp_min(0)
        mean = mean + (fine - mean) * excess / (seen + 1e-9)
        bend = bend + excess
    return torch.nn.functional.interpolate(
        torch.cat([mean, bend[None]])[None],
        size=texture.known.shape,
        mode="bilinear",
        align_corners=False,
    )[0]


def pooled_votes(texture: Texture, config: OrientationConfig) -> "list[Tensor]":
    """Return the mean votes over wider and wider areas, on a grid of half the size."""
    import torch

    contrast, device = texture.contrast, texture.contrast.device
    known = torch.nn.functional.avg_pool2d(texture.known[None], 2)
    votes = torch.zeros((), device=device)
    weights = torch.full((), 1e-9, device=device)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        bands = pool.map(
            lambda wave: line_moments(contrast, wave, config.length, config.bandwidth),
            config.wavelengths,
        )
        bands = list(bands)
    for wavelength, moments in zip(config.wavelengths, bands, strict=True):
        # Flat colour votes for no direction.
        moments = torch.cat([moments[:2], moments[2:] + FLAT**2 * known])
        area = gaussian_blur(moments, 0.5 * config.pooling[1])
        # How strong a band is cancels: what counts is how far its votes agree. Coarse
        # waves give fewer independent votes in the same area.
        power = area[2] + 1e-9
        weight = torch.linalg.vector_norm(area[:2], dim=0) / power / wavelength
        votes = votes + moments * (weight / power)
        weights = weights + weight
    votes = votes / weights
    areas = (gaussian_blur(votes, 0.5 * sigma) for sigma in config.pooling)
    return [area[:2] / (area[2] + 1e-3) for area in areas]


@functools.cache
def vote_noise(config: OrientationConfig) -> tuple[float, ...]:
    """Return the mean square of the pooled votes where a picture is white noise."""
    import torch

    noise = np.random.default_rng(0).standard_normal((256, 256)).astype(np.float32)
    contrast = torch.from_numpy(noise)
    levels = pooled_votes(Texture(contrast, torch.ones_like(contrast)), config)
    return tuple(float((level**2).sum(0).mean()) for level in levels)
