"""What is behind drawn hair: nothing special, a photograph, or a picture with depth."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from scipy.ndimage import minimum_filter

from ..capture.backdrop import read_depth, read_photograph
from ..capture.cameras import CameraEntry
from ..capture.photos import read_photo
from ..errors import InputError
from ..render.raster import mesh_depth
from ..render.scene import Background
from ..types import Mesh
from .engines import Shot
from .render_options import BackgroundOptions

# How much nearer than itself a head that is not drawn hides hair, in metres: none of
# its skin shows at its outline.
HIDING = 0.0005


class Backdrops:
    """Finds what is behind each picture.

    Attributes:
        asked: What was asked for.
        capture: The folder of the photographs, or None.
        entries: Their cameras.
        head: The head, which hides hair in photographs, or None.
    """

    def __init__(
        self,
        asked: BackgroundOptions,
        capture: Path | None,
        entries: Sequence[CameraEntry],
        head: Mesh | None,
    ):
        self.asked, self.capture, self.head = asked, capture, head
        self.entries = {entry.name: entry for entry in entries}

    def put(self, shots: Sequence[Shot]) -> Iterator[Shot]:
        """Yield shots with their backgrounds, read when their turn comes."""
        for shot in shots:
            yield shot._replace(background=self.behind(shot))

    def behind(self, shot: Shot) -> Background | None:
        """Return what is behind one picture, None for the scene's own."""
        if self.asked.photo:
            return self.photograph(shot)
        if self.asked.behind is None:
            return None
        picture = of_size(read_photo(self.asked.behind), shot, self.asked.behind)
        depth = None
        if self.asked.behind_depth is not None:
            depth = read_depth(self.asked.behind_depth)
            depth = of_size(depth, shot, self.asked.behind_depth)
        return Background(picture=picture, depth=depth)

    def photograph(self, shot: Shot) -> Background:
        """Return the photograph, in which the head hides hair but is not drawn."""
        assert self.capture is not None
        size = shot.camera.width, shot.camera.height
        picture = read_photograph(self.capture, self.entries[shot.name], size)
        depth = None
        if self.head is not None:
            # The least of each pixel's neighbours: nothing of the head is before it.
            depth = minimum_filter(mesh_depth(self.head, shot.camera), 3) - HIDING
        return Background(picture=picture, depth=depth)


def of_size(picture: np.ndarray, shot: Shot, path: Path) -> np.ndarray:
    """Return a picture, refused if it is not as large as what is drawn over it."""
    size = shot.camera.width, shot.camera.height
    if picture.shape[1::-1] != size:
        raise InputError(
            f"'{path}' has {picture.shape[1]}x{picture.shape[0]} pixels and not "
            f"{size[0]}x{size[1]}; render it in that size, or set --size."
        )
    return picture
