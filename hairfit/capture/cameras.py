"""`cameras.json`: the camera of every photograph, read and checked."""

import dataclasses
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Shaped

from ..errors import InputError
from ..host import on_device
from ..render.camera import Camera
from ..render.raster import project_points
from .photos import stem

# How many numbers OpenCV's lens models have; none is a lens without distortion.
DISTORTION_LENGTHS = (0, 4, 5, 8, 12, 14)


@dataclasses.dataclass(frozen=True)
class CameraEntry:
    """One entry of `cameras.json`.

    Attributes:
        name: Name of the photograph, without suffix.
        camera: The camera, without the distortion of its lens.
        distortion: OpenCV's distortion coefficients; empty if the lens has none.
    """

    name: str
    camera: Camera
    distortion: tuple[float, ...] = ()


def read_cameras(path: Path) -> tuple[CameraEntry, ...]:
    """Return the entries of a `cameras.json`, in the file's order.

    Raises:
        InputError: If the file is missing or broken, or an entry is not a camera.
    """
    if not path.is_file():
        raise InputError(
            f"no 'cameras.json' in '{path.parent}'; hairfit needs the cameras of the "
            "photographs there (the README shows the format)."
        )
    try:
        entries = json.loads(path.read_text(encoding="utf-8"))["views"]
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"'{path}' is not JSON with a list 'views' ({error}); mend it as the "
            "README shows the format."
        ) from error
    if not isinstance(entries, list) or not entries:
        raise InputError(f"'{path}' lists no 'views'; add one for every photograph.")
    cameras = tuple(parse_entry(entry, path) for entry in entries)
    names = [camera.name for camera in cameras]
    for name in names:
        if names.count(name) > 1:
            raise InputError(
                f"'{path}' has more than one camera named '{name}'; keep one of them."
            )
    return cameras


def parse_entry(entry: Any, path: Path) -> CameraEntry:
    """Return one entry, refused if it is not a camera."""
    if not isinstance(entry, dict) or not isinstance(entry.get("name"), str):
        raise InputError(
            f"'{path}' has a view without a 'name'; give it its picture's name."
        )
    where = f"camera '{stem(entry['name'])}' in '{path}'"
    K = parse_matrix(entry, "K", (3, 3), where)
    cam_from_world = parse_matrix(entry, "cam_from_world", (4, 4), where)
    width, height = (parse_length(entry.get(key)) for key in ("width", "height"))
    if not width or not height:
        raise InputError(
            f"{where} has the size {entry.get('width')} x {entry.get('height')}; give "
            "'width' and 'height' in pixels."
        )
    check_intrinsics(K, where)
    check_pose(cam_from_world, where)
    camera = Camera(on_device(K), on_device(cam_from_world), width, height)
    distortion = parse_distortion(entry.get("distortion"), where)
    return CameraEntry(stem(entry["name"]), camera, distortion)


def parse_length(value: Any) -> int:
    """Return a length in pixels, 0 if it is none."""
    whole = isinstance(value, int | float) and 0 < value < 1e6 and value == int(value)
    return int(value) if whole else 0


def parse_matrix(
    entry: dict[str, Any], key: str, shape: tuple[int, int], where: str
) -> Float[np.ndarray, "rows columns"]:
    """Return the matrix `entry[key]`, refused if it is not one of finite numbers."""
    try:
        matrix = np.asarray(entry[key], np.float64)
    except (KeyError, ValueError, TypeError):
        matrix = np.empty(0)
    if matrix.shape != shape:
        raise InputError(
            f"{where} has no {shape[0]}x{shape[1]} matrix '{key}'; add it as a list of "
            "rows."
        )
    if not np.isfinite(matrix).all():
        raise InputError(
            f"{where} has numbers in '{key}' that are not finite (NaN or infinity); "
            "replace them, or remove this camera and its picture."
        )
    return matrix


def parse_distortion(value: Any, where: str) -> tuple[float, ...]:
    """Return the distortion coefficients, refused if OpenCV has no such lens."""
    try:
        coefficients = tuple(float(c) for c in (value or ()))
    except (TypeError, ValueError):
        coefficients = (math.nan,)
    finite = all(math.isfinite(c) for c in coefficients)
    if len(coefficients) not in DISTORTION_LENGTHS or not finite:
        raise InputError(
            f"{where} has a 'distortion' that is not a list of 4, 5, 8, 12 or 14 "
            "numbers in OpenCV's order; mend or remove it."
        )
    return coefficients if any(coefficients) else ()


def check_intrinsics(K: Float[np.ndarray, "3 3"], where: str) -> None:
    """Refuse an intrinsic matrix that no camera has."""
    if K[0, 0] <= 0 or K[1, 1] <= 0:
        raise InputError(
            f"{where} has the focal lengths {K[0, 0]:g} and {K[1, 1]:g} in 'K'; they "
            "must be positive, in pixels."
        )
    if not np.allclose(K[[1, 2, 2, 2], [0, 0, 1, 2]], [0, 0, 0, 1], atol=1e-6):
        raise InputError(
            f"{where} has a 'K' that is not [[fx, s, cx], [0, fy, cy], [0, 0, 1]]; "
            "write it by rows."
        )


def check_pose(cam_from_world: Float[np.ndarray, "4 4"], where: str) -> None:
    """Refuse a pose that is not a rotation and a translation."""
    rotation = cam_from_world[:3, :3]
    orthonormal = np.allclose(rotation @ rotation.T, np.eye(3), atol=2e-3)
    if not orthonormal or np.linalg.det(rotation) < 0:
        raise InputError(
            f"{where} has a 'cam_from_world' whose upper left 3x3 is not a rotation; "
            "it must have no scale and no mirroring."
        )
    if not np.allclose(cam_from_world[3], [0, 0, 0, 1], atol=1e-6):
        raise InputError(
            f"{where} has a 'cam_from_world' whose last row is not 0 0 0 1; write it "
            "by rows."
        )


def check_gaze(entries: Sequence[CameraEntry], path: Path) -> None:
    """Refuse cameras of which most have behind them what all look at together."""
    target = common_point(entries)
    if target is None:
        return
    ahead = [project_points(target, entry.camera).depth > 0 for entry in entries]
    if sum(ahead) * 2 <= len(ahead):
        raise InputError(
            f"the cameras in '{path}' look away from each other instead of at one "
            "head; 'cam_from_world' must map the world to the camera, with z forward."
        )


def common_point(entries: Sequence[CameraEntry]) -> Float[np.ndarray, " 3"] | None:
    """Return the point that is nearest to the lines of sight of all cameras.

    Lines that are nearly parallel do not fix it; then it is None.
    """
    normal, right = np.zeros((3, 3)), np.zeros(3)
    centres = camera_centres(entries)
    for entry, centre in zip(entries, centres, strict=True):
        forward = np.asarray(entry.camera.cam_from_world)[2, :3]
        across = np.eye(3) - np.outer(forward, forward)
        normal += across
        right += across @ (centre - centres.mean(axis=0))
    # The least eigenvalue is the mean squared sine of the angles to their mean line.
    if np.linalg.eigvalsh(normal)[0] < 0.005 * len(entries):
        return None
    return np.linalg.solve(normal, right) + centres.mean(axis=0)


def camera_centres(entries: Sequence[CameraEntry]) -> Float[np.ndarray, "views 3"]:
    """Return where the cameras stand."""
    return np.stack([np.asarray(entry.camera.centre, np.float64) for entry in entries])


def undistort(
    pixels: Shaped[np.ndarray, "height width *channels"], entry: CameraEntry
) -> Shaped[np.ndarray, "height width *channels"]:
    """Return a picture as the entry's camera sees it without its lens's distortion.

    Masks stay yes or no. What the photograph does not show is black.
    """
    import cv2

    if not entry.distortion:
        return pixels
    K = np.array(entry.camera.K, np.float64)
    K[:2, 2] -= 0.5  # OpenCV has the first pixel's centre at 0.
    coefficients = np.array(entry.distortion)
    size = (entry.camera.width, entry.camera.height)
    maps = cv2.initUndistortRectifyMap(
        K, coefficients, np.eye(3), K, size, cv2.CV_32FC1
    )
    is_mask = pixels.dtype == bool
    method = cv2.INTER_NEAREST if is_mask else cv2.INTER_CUBIC
    source = pixels.astype(np.uint8) if is_mask else pixels
    out = cv2.remap(source, maps[0], maps[1], method)
    return out.astype(bool) if is_mask else np.maximum(out, 0)
