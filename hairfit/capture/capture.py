"""Captures: photographs with cameras, masks and a head, loaded from a folder."""

import dataclasses
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ..errors import InputError
from ..model.scalp import Scalp
from ..render.camera import Camera, resized
from ..types import Mesh
from .cameras import CameraEntry, check_gaze, read_cameras, undistort
from .head import check_scalp, load_head
from .masks import read_body_mask, read_hair_mask
from .photos import find_photos, read_photo
from .scalp_file import load_scalp
from .select import choose_views, directions

# Photographs of a phone are reduced to this: a hair stays seen, memory stays small.
LONGEST_SIDE = 2048
# Views that differ by less than this hardly show depth. Radians.
LEAST_PARALLAX = np.radians(10.0)


@dataclasses.dataclass(frozen=True)
class View:
    """One photograph, without distortion.

    Attributes:
        name: Its name, without suffix.
        camera: Its camera.
        image: The photograph as linear RGB, 1 being white.
        hair: Which pixels are hair.
        body: Which pixels are the rest of the person; None if unknown.
    """

    name: str
    camera: Camera
    image: Float[np.ndarray, "height width 3"]
    hair: Bool[np.ndarray, "height width"]
    body: Bool[np.ndarray, "height width"] | None = None


@dataclasses.dataclass(frozen=True)
class Capture:
    """What was photographed.

    Attributes:
        folder: Where it was loaded from.
        views: The photographs, in the order of `cameras.json`.
        head: The head that the hair grows on, in metres; None if unknown.
        scalp: Where hair can grow, as kept in `scalp.json`; None if there is none.
        notes: Sentences on what was left aside, for the user to read.
    """

    folder: Path
    views: tuple[View, ...]
    head: Mesh | None = None
    scalp: Scalp | None = None
    notes: tuple[str, ...] = ()


def load_capture(
    folder: Path | str,
    views: str | Sequence[str] | None = None,
    *,
    longest_side: int = LONGEST_SIDE,
) -> Capture:
    """Return the capture in a folder.

    Only the chosen views are read and checked. A picture that has no camera is left
    aside with a note; all else that does not fit together is refused.

    Args:
        folder: A folder with `cameras.json`, `images/`, `masks/hair/` and, if known,
            `masks/body/`, `head.obj` and `scalp.json`.
        views: The views to load: as `choose_views` takes it, or names; None for all.
        longest_side: Larger photographs are reduced to this many pixels.

    Raises:
        InputError: If something is missing, broken or does not fit together.
    """
    folder = Path(folder)
    photos, entries, notes = find_entries(folder, views)
    # The head first: it says what is wrong with cameras before pictures are read.
    head, scalp = None, None
    if (folder / "head.obj").exists():
        head = load_head(folder / "head.obj", entries)
    else:
        check_gaze(entries, folder / "cameras.json")
    if (folder / "scalp.json").exists():
        scalp = load_scalp(folder / "scalp.json")
        if head is not None:
            check_scalp(scalp, head, folder / "scalp.json")
    with ThreadPoolExecutor() as pool:
        loaded = pool.map(
            lambda entry: load_view(folder, entry, photos[entry.name], longest_side),
            entries,
        )
        return Capture(folder, tuple(loaded), head, scalp, notes)


class Entries(NamedTuple):
    """What a capture lists: pictures by name, cameras of the chosen views, notes."""

    photos: dict[str, Path]
    cameras: tuple[CameraEntry, ...]
    notes: tuple[str, ...]


def find_entries(folder: Path, views: str | Sequence[str] | None) -> Entries:
    """Return what a capture lists, refused if pictures and cameras do not match."""
    if not folder.is_dir():
        raise InputError(
            f"no folder '{folder}'; give a capture: 'images/' and 'cameras.json'."
        )
    if not any(folder.iterdir()):
        raise InputError(
            f"'{folder}' is empty; put the photographs into '{folder / 'images'}' and "
            "their cameras into 'cameras.json'."
        )
    photos = find_photos(folder / "images")
    entries = read_cameras(folder / "cameras.json")
    known = {entry.name for entry in entries}
    notes = tuple(
        f"'{path}' has no camera in 'cameras.json' and is left aside."
        for name, path in photos.items()
        if name not in known
    )
    if views is not None:
        spec = views if isinstance(views, str) else ",".join(views) + ","
        names = choose_views(spec, entries)
        entries = tuple(entry for entry in entries if entry.name in names)
    for entry in entries:
        if entry.name not in photos:
            raise InputError(
                f"camera '{entry.name}' in '{folder / 'cameras.json'}' has no picture "
                f"in '{folder / 'images'}'; add it, or choose the others with --views."
            )
    return Entries(photos, entries, notes)


def load_view(folder: Path, entry: CameraEntry, photo: Path, longest_side: int) -> View:
    """Return one view, its picture and masks read, undistorted and reduced."""
    camera = entry.camera
    width, height = camera.width, camera.height
    image = read_photo(photo)
    if image.shape[:2] != (height, width):
        raise InputError(
            f"'{photo}' has {image.shape[1]}x{image.shape[0]} pixels but its camera "
            f"{width}x{height}; use the picture that the camera was made for."
        )
    masks = folder / "masks"
    hair = read_hair_mask(masks / "hair" / f"{entry.name}.png", width, height)
    body = read_body_mask(masks / "body" / f"{entry.name}.png", width, height)
    image, hair = undistort(image, entry), undistort(hair, entry)
    body = None if body is None else undistort(body, entry)
    view = View(entry.name, camera, image, hair, body)
    return reduce_view(view, longest_side)


def reduce_view(view: View, longest_side: int) -> View:
    """Return the view with its longest side reduced, if it is longer."""
    import cv2

    old = (view.camera.width, view.camera.height)
    if max(old) <= longest_side:
        return view
    size = (
        max(1, round(old[0] * longest_side / max(old))),
        max(1, round(old[1] * longest_side / max(old))),
    )

    def reduce(pixels: np.ndarray) -> np.ndarray:
        return cv2.resize(pixels.astype(np.float32), size, interpolation=cv2.INTER_AREA)

    return View(
        view.name,
        resized(view.camera, *size),
        reduce(view.image),
        reduce(view.hair) > 0.5,
        None if view.body is None else reduce(view.body) > 0.5,
    )


def require_for_fit(capture: Capture) -> Mesh:
    """Return the head, if the capture has all that a fit needs.

    Raises:
        InputError: If the head is missing, or the photographs show no depth.
    """
    if len(capture.views) < 2:
        raise InputError(
            f"only one photograph of '{capture.folder}' is used; depth needs at least "
            "two from different sides, and three or more all around are better."
        )
    towards = directions(capture.views)
    if np.arccos(np.clip(towards @ towards.T, -1, 1)).max() < LEAST_PARALLAX:
        raise InputError(
            f"the photographs in '{capture.folder}' are all taken from the same side; "
            "add some from other sides."
        )
    if capture.head is None:
        raise InputError(
            f"no 'head.obj' in '{capture.folder}'; put a mesh of the head there, in "
            "metres and in the frame of the cameras."
        )
    return capture.head
