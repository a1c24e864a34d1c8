"""Masks: which pixels of a photograph are hair, and which are the person."""

from pathlib import Path

import numpy as np
from jaxtyping import Bool

from ..errors import InputError
from .photos import decode_picture

# A mask that leaves less than this share free says nothing about the outline.
LEAST_OUTSIDE = 1e-3


def read_hair_mask(
    path: Path, width: int, height: int
) -> Bool[np.ndarray, "height width"]:
    """Return where a photograph shows hair.

    Args:
        path: A picture, white where there is hair.
        width: Width of the photograph, in pixels.
        height: Height of the photograph, in pixels.

    Raises:
        InputError: If the file is missing, of another size, empty or all white.
    """
    if not path.exists():
        raise InputError(
            f"no hair mask '{path}'; paint one in any picture editor, of "
            f"{width}x{height} pixels, white where there is hair and black elsewhere."
        )
    mask = read_mask(path, width, height)
    if not mask.any():
        raise InputError(
            f"the hair mask '{path}' is empty; paint the hair white in it, or leave "
            "this photograph out with --views."
        )
    return mask


def read_body_mask(
    path: Path, width: int, height: int
) -> Bool[np.ndarray, "height width"] | None:
    """Return where a photograph shows the person, None if there is no such file.

    Raises:
        InputError: If the file is of another size or all white.
    """
    return read_mask(path, width, height) if path.exists() else None


def read_mask(path: Path, width: int, height: int) -> Bool[np.ndarray, "height width"]:
    """Return the brighter half of a mask's values, at the size of its photograph."""
    import cv2

    mask = decode_picture(path, cv2.IMREAD_GRAYSCALE) > 127
    if mask.shape != (height, width):
        raise InputError(
            f"the mask '{path}' has {mask.shape[1]}x{mask.shape[0]} pixels but its "
            f"photograph {width}x{height}; make it again at that size."
        )
    if 1.0 - mask.mean() < LEAST_OUTSIDE:
        raise InputError(
            f"the mask '{path}' is all white; paint black what is outside."
        )
    return mask
