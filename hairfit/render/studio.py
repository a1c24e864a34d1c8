"""Lights and looks that show a hairstyle when nobody asks for others."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..types import Mesh
from .camera import Camera
from .lights import DistantLight
from .scene import Colour, HairLook, Scene
from .shadow_style import PREVIEW_SHADOWS

# Towards the lights, in the camera's axes (y down, z forward), and their strength: the
# key light over the camera's left shoulder, and one behind the head for its outline.
TOWARDS = ((-0.55, -0.75, -0.70), (0.60, -0.80, 0.55))
STRENGTH = (1.5, 0.9)
# Many hairs of their true width; few ones stand for more, and are drawn wider.
WIDTH_OF_10_000 = 0.00018
WIDEST, NARROWEST = 0.001, 0.00006
SMALLEST, HEAD_OF_HAIR, LARGEST = 0.03, 0.5, 3.0  # diagonals of a box around it


def studio_lights(camera: Camera) -> tuple[DistantLight, ...]:
    """Return two lights that move with the camera."""
    turn = np.asarray(camera.cam_from_world, np.float64)[:3, :3]
    towards = np.array(TOWARDS) / np.linalg.norm(TOWARDS, axis=1, keepdims=True) @ turn
    return tuple(
        DistantLight(jnp.asarray(way), jnp.full(3, strength))
        for way, strength in zip(towards, STRENGTH, strict=True)
    )


def shown_width(strands: Float[np.ndarray, "strands knots 3"]) -> float:
    """Return the width that strands are shown with, in metres.

    Files of others may have other units than metres: hair that would be larger than a
    person or smaller than a finger is as thick as if it were on a head.
    """
    count = max(len(strands), 1)
    width = WIDTH_OF_10_000 * float(np.sqrt(10_000 / count))
    width = float(np.clip(width, NARROWEST, WIDEST))
    if strands.size == 0:
        return width
    flat = strands.reshape(-1, 3)
    size = float(np.linalg.norm(flat.max(0) - flat.min(0)))
    usual = SMALLEST <= size <= LARGEST
    return width if usual or size == 0.0 else width * size / HEAD_OF_HAIR


def shared_width(total: float, count: int) -> float:
    """Return the width that so many strands are shown with to hide what others hid.

    Args:
        total: The widths of all strands that cover the hair, in metres.
        count: How many are shown.
    """
    return float(np.clip(total / max(count, 1), NARROWEST, WIDEST))


def preview_scene(
    strands: Float[np.ndarray, "strands knots 3"], head: Mesh | None
) -> Scene:
    """Return hair on a head as previews show it; `studio_lights` light it."""
    look = HairLook(width=shown_width(strands))
    return Scene(
        strands, look=look, head=head, sky=(0.45, 0.45, 0.45), shadows=PREVIEW_SHADOWS
    )


def sky_lights(radiance: Colour, count: int = 14) -> tuple[DistantLight, ...]:
    """Return far lights in all directions, that hair can shadow, instead of a sky.

    Args:
        radiance: Light from every direction.
        count: Number of lights.
    """
    # A spiral from pole to pole covers the ball evenly.
    height = 1.0 - 2.0 * (np.arange(count) + 0.5) / count
    turn = np.pi * (1.0 + 5.0**0.5) * np.arange(count)
    level = np.sqrt(1.0 - height**2)
    towards = np.stack([level * np.cos(turn), height, level * np.sin(turn)], 1)
    # All of them light a white matt surface as the sky does: pi over half a ball.
    colour = jnp.asarray(radiance) * 4.0 / count
    return tuple(DistantLight(jnp.asarray(way), colour) for way in towards)
