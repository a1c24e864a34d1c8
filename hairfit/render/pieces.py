"""Segments of hair cut at the borders of pixels and of slabs: exact, in NumPy.

The slow and certain side of what graphics hardware does with lines in opacity shadow
maps (6.2.1) and in antialiased drawing (6.3.1): a thin hair covers of a pixel what it
is wide times how long it runs inside.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from .view import View, see_all


class Pieces(NamedTuple):
    """What single pixels hold of segments, in the order of segments and from the root.

    Attributes:
        column: Column of the piece's pixel.
        row: Row of the pixel.
        segment: Which segment it is of: strand times segments a strand, plus which.
        start: Where the piece starts on the whole segment in the picture, from 0 to 1.
        end: Where it ends.
        depth: Depths at start and end, in metres, linear along the picture.
        area: Share of the pixel that it covers: the opacity that it adds, no unit.
    """

    column: Int[np.ndarray, " pieces"]
    row: Int[np.ndarray, " pieces"]
    segment: Int[np.ndarray, " pieces"]
    start: Float[np.ndarray, " pieces"]
    end: Float[np.ndarray, " pieces"]
    depth: Float[np.ndarray, "pieces 2"]
    area: Float[np.ndarray, " pieces"]


class Parts(NamedTuple):
    """Pieces cut further, where slabs of depth meet.

    Attributes:
        piece: Which piece each part is of.
        slab: In which slab it lies; 0 is before the first border.
        area: Share of the pixel that it covers.
    """

    piece: Int[np.ndarray, " parts"]
    slab: Int[np.ndarray, " parts"]
    area: Float[np.ndarray, " parts"]


class Lines(NamedTuple):
    """Straight lines in a picture, in pixels, and what of them lies in the picture.

    Attributes:
        p: Start of the whole line.
        step: From its start to its end; not zero.
        enter: Where it enters the picture, from 0 to 1.
        leave: Where it leaves it.
        depth: Depths of both whole ends, in metres.
        width: Width in pixels.
        segment: Which segment it draws.
    """

    p: Float[np.ndarray, "lines 2"]
    step: Float[np.ndarray, "lines 2"]
    enter: Float[np.ndarray, " lines"]
    leave: Float[np.ndarray, " lines"]
    depth: Float[np.ndarray, "lines 2"]
    width: Float[np.ndarray, " lines"]
    segment: Int[np.ndarray, " lines"]


def hair_pieces(
    points: Float[np.ndarray, "strands knots 3"],
    width: float,
    view: View,
    strips: int = 1,
) -> Pieces:
    """Return the segments of strands, cut where they cross borders of pixels.

    Segments that reach behind the eye are left out, as are those seen end on, which
    cover nothing. Width and depth change evenly along a segment in the picture; with
    perspective this holds for segments that are short beside their depth.

    Args:
        points: Strands of equal counts of points, in metres.
        width: Width of a hair, in metres.
        view: Where it is seen from.
        strips: Into how many thinner lines side by side each segment is split; a hair
            wider than half a pixel needs `strips_needed`.

    Raises:
        ValueError: If there is not at least one strip.
    """
    if strips < 1:
        raise ValueError(f"a hair needs at least 1 strip, got {strips}.")
    lines = clip(side_by_side(picture_lines(points, width, view), strips), view)
    at, line = crossings(lines)
    inner = np.flatnonzero((line[1:] == line[:-1]) & (at[1:] > at[:-1]))
    start, end, line = at[inner], at[inner + 1], line[inner]
    middle = lines.p[line] + (0.5 * (start + end))[:, None] * lines.step[line]
    size = np.array([view.width, view.height])
    column, row = np.clip(np.floor(middle).astype(np.int64), 0, size - 1).T
    ends = np.stack([start, end], 1)
    depth = lines.depth[line, :1] + ends * np.diff(lines.depth[line])
    length = (end - start) * np.linalg.norm(lines.step[line], axis=1)
    area = lines.width[line] * length
    return Pieces(column, row, lines.segment[line], start, end, depth, area)


def strips_needed(
    points: Float[np.ndarray, "strands knots 3"], width: float, view: View
) -> int:
    """Return how many strips a hair needs: one up to half a pixel, else four a pixel.

    A thin line is in one pixel or another, and so are strips: those of a quarter of a
    pixel show how a wide hair lies between them.
    """
    widest = width * float(see_all(points, view)[..., 3].max(initial=0.0))
    return 1 if widest <= 0.5 else int(np.ceil(4.0 * widest))


def picture_lines(
    points: Float[np.ndarray, "strands knots 3"], width: float, view: View
) -> Lines:
    """Return the segments before the eye as lines, not clipped."""
    seen = see_all(np.asarray(points, np.float64), view)
    a, b = seen[:, :-1].reshape(-1, 4), seen[:, 1:].reshape(-1, 4)
    ahead = (a[:, 3] > 0.0) & (b[:, 3] > 0.0)
    segment = np.flatnonzero(ahead & (a[:, :2] != b[:, :2]).any(1))
    a, b = a[segment], b[segment]
    depth = np.stack([a[:, 2], b[:, 2]], 1)
    enter, leave = np.zeros(len(segment)), np.ones(len(segment))
    width_px = 0.5 * width * (a[:, 3] + b[:, 3])
    step = b[:, :2] - a[:, :2]
    return Lines(a[:, :2], step, enter, leave, depth, width_px, segment)


def side_by_side(lines: Lines, strips: int) -> Lines:
    """Return lines that are each split into thinner ones which fill its width."""
    if strips == 1:
        return lines
    many = Lines(*(np.repeat(field, strips, 0) for field in lines))
    share = np.tile((np.arange(strips) + 0.5) / strips - 0.5, len(lines.p))
    normal = many.step[:, ::-1] * np.array([-1.0, 1.0])
    normal /= np.linalg.norm(many.step, axis=1, keepdims=True)
    p = many.p + (share * many.width)[:, None] * normal
    return many._replace(p=p, width=many.width / strips)


def clip(lines: Lines, view: View) -> Lines:
    """Return the lines that touch the picture, clipped as Liang and Barsky do."""
    size = np.array([view.width, view.height], np.float64)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        low, high = -lines.p / lines.step, (size - lines.p) / lines.step
    level = lines.step == 0.0
    beside = (level & ((lines.p < 0.0) | (lines.p > size))).any(1)
    enter = np.where(level, -np.inf, np.minimum(low, high)).max(1).clip(0.0, None)
    leave = np.where(level, np.inf, np.maximum(low, high)).min(1).clip(None, 1.0)
    keep = ~beside & (enter < leave)
    kept = Lines(*(field[keep] for field in lines))
    return kept._replace(enter=enter[keep], leave=leave[keep])


class Crossings(NamedTuple):
    """Where lines start, cross borders of pixels and end, sorted by line and place.

    Attributes:
        at: Where on the whole line, from 0 to 1.
        line: Which line.
    """

    at: Float[np.ndarray, " crossings"]
    line: Int[np.ndarray, " crossings"]


def crossings(lines: Lines) -> Crossings:
    """Return all places where lines are to be cut."""
    every = np.arange(len(lines.p))
    at, line = [lines.enter, lines.leave], [every, every]
    for axis in range(2):
        p, step = lines.p[:, axis], lines.step[:, axis]
        a, b = p + lines.enter * step, p + lines.leave * step
        first = np.floor(np.minimum(a, b)).astype(np.int64) + 1
        last = np.ceil(np.maximum(a, b)).astype(np.int64) - 1
        count = np.maximum(last - first + 1, 0)
        index = np.repeat(every, count)
        border = first[index] + place_in_group(count)
        found = (border - p[index]) / step[index]
        at.append(np.clip(found, lines.enter[index], lines.leave[index]))
        line.append(index)
    at, line = np.concatenate(at), np.concatenate(line)
    order = np.lexsort((at, line))
    return Crossings(at[order], line[order])


def place_in_group(count: Int[np.ndarray, " groups"]) -> Int[np.ndarray, " all"]:
    """Return 0, 1, ... in each of groups of given sizes that follow one another."""
    first = np.cumsum(count) - count
    return np.arange(int(count.sum())) - np.repeat(first, count)


def cut_at_depths(
    pieces: Pieces,
    borders: Float[np.ndarray, " borders"] | Float[np.ndarray, "pieces borders"],
) -> Parts:
    """Return pieces cut where slabs of depth meet.

    A piece at one depth lies in the slab that starts there, line 5 of table 6-1.

    Args:
        pieces: What is cut.
        borders: Depths at which slabs meet, rising, in metres; the same for all pieces
            or a row for each. There is one slab more than there are borders.
    """
    low, high = pieces.depth.min(1), pieces.depth.max(1)
    if borders.ndim == 1:
        first = np.searchsorted(borders, low, side="right")
        last = np.searchsorted(borders, high, side="left")
    else:
        first = (borders <= low[:, None]).sum(1)
        last = (borders < high[:, None]).sum(1)
    count = np.maximum(last - first, 0) + 1
    piece = np.repeat(np.arange(len(first)), count)
    slab = first[piece] + place_in_group(count)
    begin = np.maximum(low[piece], border_of(borders, piece, slab - 1))
    end = np.minimum(high[piece], border_of(borders, piece, slab))
    whole = (high - low)[piece]
    share = np.where(count[piece] == 1, 1.0, (end - begin) / np.where(whole, whole, 1))
    return Parts(piece, slab, share * pieces.area[piece])


def area_in_layers(
    pieces: Pieces,
    parts: Parts,
    layer: Int[np.ndarray, " parts"],
    layers: int,
    view: View,
) -> Float[np.ndarray, "layers height width"]:
    """Return the area of hair in each layer of each pixel.

    Args:
        pieces: Segments cut at the borders of pixels.
        parts: The same cut further.
        layer: Where each part counts.
        layers: Number of layers.
        view: What the pixels are of.
    """
    shape = layers, view.height, view.width
    at = layer, pieces.row[parts.piece], pieces.column[parts.piece]
    cell = np.ravel_multi_index(at, shape)
    return np.bincount(cell, parts.area, int(np.prod(shape))).reshape(shape)


def border_of(
    borders: np.ndarray, piece: Int[np.ndarray, " parts"], which: np.ndarray
) -> Float[np.ndarray, " parts"]:
    """Return depths of borders of pieces, infinite before the first and behind all."""
    number = borders.shape[-1]
    if number == 0:
        return np.where(which < 0, -np.inf, np.inf)
    safe = np.clip(which, 0, number - 1)
    found = borders[safe] if borders.ndim == 1 else borders[piece, safe]
    return np.where(which < 0, -np.inf, np.where(which >= number, np.inf, found))
