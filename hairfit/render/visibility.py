"""Hair drawn from back to front, and the order to draw it in [Kim02, section 6.3.1]."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from .pieces import Pieces, place_in_group
from .view import View, see_all


class DrawingOrder(NamedTuple):
    """The order in which segments are drawn.

    Attributes:
        bin: Bin of each segment, counted from the camera.
        order: Segments as they are drawn: those of the farthest bin first, in a bin as
            they are numbered.
    """

    bin: Int[np.ndarray, " segments"]
    order: Int[np.ndarray, " segments"]


class Blended(NamedTuple):
    """A picture of hair without what is behind it.

    Attributes:
        colour: Linear RGB times coverage; add what is behind times 1 - coverage.
        coverage: From 0 (none) to 1 (opaque).
    """

    colour: Float[np.ndarray, "height width 3"]
    coverage: Float[np.ndarray, "height width"]


class Fragments(NamedTuple):
    """What pixels hold of segments, sorted by pixel and segment.

    Attributes:
        pixel: Which pixel, row after row.
        segment: Which segment.
        area: Share of the pixel that it covers, at most 1.
        colour: Linear RGB.
        depth: Depth at its middle, in metres.
    """

    pixel: Int[np.ndarray, " fragments"]
    segment: Int[np.ndarray, " fragments"]
    area: Float[np.ndarray, " fragments"]
    colour: Float[np.ndarray, "fragments 3"]
    depth: Float[np.ndarray, " fragments"]


def visibility_bins(
    points: Float[np.ndarray, "strands knots 3"], view: View, bins: int = 512
) -> DrawingOrder:
    r"""Return segments ordered by slabs of distance, farthest first.

    A point at distance $D$ (6-4), the depth of the camera's view, lies in bin
    $i = \lfloor N (D - D_{min}) / (D_{max} - D_{min} + \varepsilon) \rfloor$; a segment
    lies in that of its farther end. Equation (6-3) prints a ceiling, which would put
    $D_{max}$ in bin $N$ although $0 \le i < N$, and only $D_{min}$ in bin 0: the floor
    is meant.

    Args:
        points: Strands of equal counts of points, in metres.
        view: The camera's view.
        bins: Number of bins, $N$.

    Raises:
        ValueError: If there are no bins, or more than 65536.
    """
    if not 1 <= bins <= 1 << 16:
        raise ValueError(f"segments are sorted into 1 to 65536 bins, got {bins}.")
    depth = see_all(points, view)[..., 2]
    nearest = float(depth.min(initial=np.inf))
    thick = float(depth.max(initial=-np.inf)) - nearest
    # A thousandth of a bin: less than the bin that (6-3) allows, and hair at a single
    # distance is in bin 0.
    epsilon = max(1e-3 * thick / bins, 1e-12)
    farther = np.maximum(depth[:, :-1], depth[:, 1:]).reshape(-1)
    found = np.floor(bins * (farther - nearest) / (thick + epsilon)).astype(np.int64)
    # Integers of 16 bits are sorted by counting, which keeps the order of equals.
    order = np.argsort((bins - 1 - found).astype(np.uint16), kind="stable")
    return DrawingOrder(found, order)


def composite(
    pieces: Pieces,
    colour: Float[np.ndarray, "pieces 3"],
    alpha: float,
    view: View,
    order: Int[np.ndarray, " segments"] | None = None,
) -> Blended:
    r"""Return hair blended from back to front, exactly: $C \to \alpha c + (1-\alpha)C$.

    A segment's alpha in a pixel is the share that it covers, at most 1, times `alpha`.
    Its strips lie side by side: they add up before they are blended.

    Args:
        pieces: Segments cut at the borders of pixels.
        colour: Linear RGB of each piece; `colour[pieces.segment]` for one a segment.
        alpha: Opacity of hair that fills a pixel, from 0 to 1 (figure 6-16).
        view: The camera's view.
        order: Segments in the order in which they are drawn. If None, each pixel
            sorts what it holds by depth: what all such orders come close to.
    """
    held = pixel_fragments(pieces, colour, view)
    if order is None:
        rank = -held.depth
    else:
        rank = np.empty(len(order), np.int64)
        rank[order] = np.arange(len(order))
        rank = rank[held.segment]
    drawn = np.lexsort((rank, held.pixel))
    pixels = view.height * view.width
    place = place_in_group(np.bincount(held.pixel, minlength=pixels))
    out, coverage = np.zeros((pixels, 3)), np.zeros(pixels)
    # The first of every pixel at once, then the second of every pixel, and so on.
    ends = np.cumsum(np.bincount(place))
    for turn in np.split(drawn[np.argsort(place, kind="stable")], ends[:-1]):
        pixel, share = held.pixel[turn], alpha * held.area[turn]
        coverage[pixel] = share + (1.0 - share) * coverage[pixel]
        share = share[:, None]
        out[pixel] = share * held.colour[turn] + (1.0 - share) * out[pixel]
    shape = view.height, view.width
    return Blended(out.reshape(*shape, 3), coverage.reshape(shape))


def pixel_fragments(
    pieces: Pieces, colour: Float[np.ndarray, "pieces 3"], view: View
) -> Fragments:
    """Return pieces of which those of one segment in one pixel are made one."""
    pixel = pieces.row * view.width + pieces.column
    order = np.lexsort((pieces.segment, pixel))
    pixel, segment = pixel[order], pieces.segment[order]
    new = (np.diff(pixel, prepend=-1) != 0) | (np.diff(segment, prepend=-1) != 0)
    first = np.flatnonzero(new)
    # Strips of a segment are equally wide: their lengths weigh them, and none is 0.
    length = (pieces.end - pieces.start)[order]
    count = np.diff(first, append=len(length))
    share = length / np.repeat(summed(length, first), count)
    return Fragments(
        pixel[first],
        segment[first],
        np.minimum(summed(pieces.area[order], first), 1.0),
        summed(share[:, None] * colour[order], first),
        summed(share * pieces.depth.mean(1)[order], first),
    )


def summed(values: np.ndarray, first: Int[np.ndarray, " groups"]) -> np.ndarray:
    """Return sums over groups that follow one another and start at given places."""
    # `reduceat` refuses to sum nothing.
    return np.add.reduceat(values, first) if len(first) else values
