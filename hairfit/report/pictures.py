"""The pictures of a report: photographs, orientation maps, strands over photographs."""

import numpy as np
from jaxtyping import Bool, Float, UInt8

from ..capture.capture import View
from ..capture.orientation import OrientationMap
from ..capture.photos import linear_from_srgb, srgb_from_linear
from ..render.raster import Raster

# How much of the photograph's colour stays under the strands.
UNDERLAY = 0.6

# How much is shown around the hair, as a share of its size.
MARGIN = 0.2


def hexadecimal(colour: Float[np.ndarray, " 3"]) -> str:
    """Return a linear RGB colour as screens have it: `#7a4a2b`."""
    pixel = to_bytes(srgb_from_linear(colour[None, None]))
    return "#" + pixel.tobytes().hex()


def exposed(
    picture: UInt8[np.ndarray, "height width 3"], gain: float
) -> UInt8[np.ndarray, "height width 3"]:
    """Return a picture with so much more light."""
    linear = linear_from_srgb(picture.astype(np.float64) / 255.0)
    return to_bytes(srgb_from_linear(np.minimum(gain * linear, 1.0)))


def photo_picture(view: View) -> UInt8[np.ndarray, "height width 3"]:
    """Return the photograph as a screen shows it."""
    return to_bytes(srgb_from_linear(view.image))


def orientation_picture(
    found: OrientationMap, hair: Bool[np.ndarray, "height width"]
) -> UInt8[np.ndarray, "height width 3"]:
    """Return an orientation map: hue is angle, brightness grows with confidence."""
    brightness = np.sqrt(np.clip(np.asarray(found.confidence), 0.0, 1.0)) * hair
    return to_bytes(angle_colour(np.asarray(found.angle)) * brightness[..., None])


def overlay_picture(view: View, drawn: Raster) -> UInt8[np.ndarray, "height width 3"]:
    """Return the strands over their photograph, coloured as the orientation map is."""
    under = srgb_from_linear(view.image).mean(axis=2, keepdims=True) * UNDERLAY
    strands = angle_colour(drawn.orientation)
    over = np.where(drawn.coverage[..., None], strands, under)
    return to_bytes(over)


def angle_colour(
    angle: Float[np.ndarray, "height width"],
) -> Float[np.ndarray, "height width 3"]:
    """Return a colour for lines of an angle in [0, pi): the same for 0 and pi."""
    shift = np.array([0.0, 2 * np.pi / 3, 4 * np.pi / 3])
    return 0.5 + 0.5 * np.cos(2.0 * angle[..., None] - shift)


def to_bytes(
    value: Float[np.ndarray, "height width channels"],
) -> UInt8[np.ndarray, "height width 3"]:
    """Return a picture with values in [0, 1] as three bytes a pixel."""
    value = np.broadcast_to(value, (*value.shape[:2], 3))
    return np.round(255.0 * np.clip(value, 0.0, 1.0)).astype(np.uint8)


def hair_window(hair: Bool[np.ndarray, "height width"]) -> tuple[slice, slice]:
    """Return the rows and columns that hold the hair, and some more around it."""
    spans = []
    for across in (1, 0):
        found = np.flatnonzero(hair.any(axis=across))
        size = hair.shape[1 - across]
        low, high = (int(found[0]), int(found[-1]) + 1) if len(found) else (0, size)
        more = round(MARGIN * (high - low)) + 4
        spans.append(slice(max(0, low - more), min(size, high + more)))
    return spans[0], spans[1]
