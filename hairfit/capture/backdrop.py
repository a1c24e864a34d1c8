"""What is seen behind drawn hair: photographs, and pictures with depth."""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from ..errors import InputError
from .cameras import CameraEntry, undistort
from .photos import decode_picture, find_photos, read_photo


def read_photograph(
    capture: Path, entry: CameraEntry, size: tuple[int, int]
) -> Float[np.ndarray, "height width 3"]:
    """Return a photograph of a capture without distortion, linear RGB.

    Args:
        capture: The capture's folder.
        entry: The photograph's camera.
        size: Width and height to bring it to, in pixels.

    Raises:
        InputError: If the photograph is missing or not of its camera's size.
    """
    import cv2

    photos = find_photos(capture / "images")
    if entry.name not in photos:
        raise InputError(
            f"no picture of camera '{entry.name}' in '{capture / 'images'}'; add it, "
            "or leave out --photo."
        )
    image = read_photo(photos[entry.name])
    own = entry.camera.width, entry.camera.height
    if image.shape[1::-1] != own:
        raise InputError(
            f"'{photos[entry.name]}' has {image.shape[1]}x{image.shape[0]} pixels but "
            f"its camera {own[0]}x{own[1]}; use the picture that the camera was made "
            "for."
        )
    image = undistort(image, entry)
    if size != own:
        method = cv2.INTER_AREA if size[0] < own[0] else cv2.INTER_CUBIC
        image = np.maximum(cv2.resize(image, size, interpolation=method), 0.0)
    return np.asarray(image)


def read_depth(path: Path) -> Float[np.ndarray, "height width"]:
    """Return a depth picture: metres along the optical axis, infinite for none.

    Raises:
        InputError: If it is no such picture.
    """
    import cv2

    if path.suffix.lower() == ".npy":
        try:
            depth = np.load(path, allow_pickle=False)
        except (OSError, ValueError, EOFError) as error:
            raise InputError(
                f"cannot read '{path}' ({error}); write it with `numpy.save`."
            ) from error
    elif path.suffix.lower() in (".tif", ".tiff"):
        depth = decode_picture(path, cv2.IMREAD_UNCHANGED)
    else:
        raise InputError(
            f"the depth '{path}' must be .npy or .tiff; convert it to one of them."
        )
    if depth.ndim != 2 or not np.issubdtype(depth.dtype, np.floating):
        raise InputError(
            f"'{path}' holds {depth.dtype} of shape {depth.shape}, not one depth in "
            "metres as a float for every pixel; convert it."
        )
    # Nothing is nearer than the camera: what programs write for `nothing here`.
    nothing = np.isnan(depth) | (depth <= 0.0)
    return np.where(nothing, np.inf, depth).astype(np.float64)
