"""Hair coloured by how sure the fit is of it."""

import dataclasses
import math

import numpy as np
from jaxtyping import Float, Int, UInt8

from ..model.certainty import TreeConfidence
from ..render.scene import HairLook, Scene
from .drawing import draw_preview, orbit_cameras

# Hair is right that lies so near to where it is said to run. Metres, radians.
RIGHT_PLACE, RIGHT_WAY = 0.003, math.radians(30.0)
VIEWS = 4
SIZE = (360, 450)
# Linear RGB from a guess to what is sure, at even steps.
RAMP = np.array([[0.60, 0.02, 0.01], [0.62, 0.52, 0.36], [0.02, 0.10, 0.62]])

LEGEND = (
    "How likely hair lies within 3 mm and 30° of where it is shown, cluster by "
    "cluster: blue is sure, pale is as likely right as wrong, red is a guess. From the "
    "front, the person's left, the back and the right."
)


def certainty_pictures(
    scene: Scene,
    owner: Int[np.ndarray, " strands"],
    confidence: TreeConfidence | None,
) -> list[UInt8[np.ndarray, "height width 3"]]:
    """Return pictures of the hair in the colours of `LEGEND`, from four sides.

    None at all if it is not known how sure the fit is.

    Args:
        scene: Hair on a head, as previews show it.
        owner: The cluster of each strand.
        confidence: How sure the fit is of the clusters.
    """
    if confidence is None:
        return []
    look = HairLook(width=scene.look.width, specular=(0.0, 0.0, 0.0), variation=0.1)
    tint = certainty_colour(confidence)[owner]
    scene = dataclasses.replace(scene, look=look, tint=tint)
    return draw_preview(scene, orbit_cameras(scene.strands, VIEWS, SIZE))


def certainty_colour(confidence: TreeConfidence) -> Float[np.ndarray, "clusters 3"]:
    """Return the colour of each cluster, linear RGB."""
    chance = np.asarray(confidence.chance(RIGHT_PLACE, RIGHT_WAY), np.float64)
    at = np.linspace(0.0, 1.0, len(RAMP))
    return np.stack([np.interp(chance, at, channel) for channel in RAMP.T], axis=-1)
