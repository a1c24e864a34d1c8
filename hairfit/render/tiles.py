"""Large pictures in parts that fit into memory."""

import dataclasses
from collections.abc import Iterator
from typing import NamedTuple

from .camera import Camera, shifted
from .scene import Background


class Tile(NamedTuple):
    """A part of a picture, in pixels.

    Attributes:
        column: Its first column.
        row: Its first row.
        width: Its width.
        height: Its height.
    """

    column: int
    row: int
    width: int
    height: int

    @property
    def slices(self) -> tuple[slice, slice]:
        """Its rows and columns."""
        rows = slice(self.row, self.row + self.height)
        return rows, slice(self.column, self.column + self.width)


def tiles(width: int, height: int, most: int) -> Iterator[Tile]:
    """Yield the parts of a picture, none longer than `most` pixels a side."""
    for row in range(0, height, most):
        for column in range(0, width, most):
            across, down = min(most, width - column), min(most, height - row)
            yield Tile(column, row, across, down)


def halves(tile: Tile) -> tuple[Tile, Tile]:
    """Return the two halves of a tile, cut across its longer side.

    Raises:
        ValueError: If it is a single pixel.
    """
    if tile.width * tile.height <= 1:
        raise ValueError("a tile of one pixel has no halves.")
    if tile.width >= tile.height:
        first = tile._replace(width=tile.width // 2)
        column = tile.column + first.width
        rest = tile._replace(column=column, width=tile.width - first.width)
        return first, rest
    first = tile._replace(height=tile.height // 2)
    row = tile.row + first.height
    return first, tile._replace(row=row, height=tile.height - first.height)


def camera_of(tile: Tile, camera: Camera) -> Camera:
    """Return the camera that takes a part of another one's picture."""
    K = shifted(camera.K, -float(tile.column), -float(tile.row))
    return Camera(K, camera.cam_from_world, tile.width, tile.height)


def background_of(tile: Tile, background: Background) -> Background:
    """Return the background of a part of a picture."""

    def part(picture):
        return None if picture is None else picture[tile.slices]

    return dataclasses.replace(
        background, picture=part(background.picture), depth=part(background.depth)
    )
