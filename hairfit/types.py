"""Plain containers that every part of hairfit passes around."""

import dataclasses

import numpy as np
from jaxtyping import Float, Int


@dataclasses.dataclass(frozen=True)
class Strands:
    """Hair strands as polylines, root first. Metres.

    Attributes:
        points: All points of all strands, one strand after the other.
        offsets: Where each strand starts in `points`, and at last the number of points.
    """

    points: Float[np.ndarray, "points 3"]
    offsets: Int[np.ndarray, " strands_and_one"]

    @classmethod
    def from_array(cls, points: Float[np.ndarray, "strands knots 3"]) -> "Strands":
        """Return the strands whose points are given as one array of equal counts."""
        count, knots, _ = points.shape
        flat = np.asarray(points, np.float32).reshape(-1, 3)
        return cls(flat, np.arange(count + 1, dtype=np.int64) * knots)

    @property
    def count(self) -> int:
        """The number of strands."""
        return len(self.offsets) - 1

    def resample(self, knots: int) -> Float[np.ndarray, "strands knots 3"]:
        """Return every strand with `knots` points at equal distances along it."""
        out = np.empty((self.count, knots, 3))
        share = np.linspace(0.0, 1.0, knots)
        for i, (first, last) in enumerate(
            zip(self.offsets[:-1], self.offsets[1:], strict=True)
        ):
            points = self.points[first:last].astype(np.float64)
            steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
            along = np.concatenate([[0.0], np.cumsum(steps)])
            at = share * along[-1]
            out[i] = np.stack([np.interp(at, along, points[:, k]) for k in range(3)], 1)
        return out


@dataclasses.dataclass(frozen=True)
class Mesh:
    """A triangle mesh. Metres."""

    vertices: Float[np.ndarray, "vertices 3"]
    faces: Int[np.ndarray, "faces 3"]


def along_paths(
    paths: Float[np.ndarray, "strands steps 3"],
) -> Float[np.ndarray, "strands steps"]:
    """Return the length of each polyline up to each of its points."""
    lengths = np.linalg.norm(np.diff(paths, axis=1), axis=2)
    return np.concatenate([np.zeros((len(paths), 1)), np.cumsum(lengths, axis=1)], 1)


def resample_paths(
    paths: Float[np.ndarray, "strands steps 3"], knots: int, kept: float = 1.0
) -> Float[np.ndarray, "strands knots 3"]:
    """Return polylines with equal distances; repeated last points do no harm.

    Args:
        paths: The polylines.
        knots: How many points come back.
        kept: Share of each one's length that is kept, from its first point on.
    """
    along = along_paths(paths)
    at = along[:, -1:] * np.linspace(0.0, kept, knots)
    # One search for all strands: each has its own interval of a common line.
    start = np.arange(len(paths))[:, None] * (along[:, -1].max(initial=0.0) + 1.0)
    flat = (along + start).ravel()
    index = np.searchsorted(flat, (at + start).ravel(), side="right").reshape(at.shape)
    low = index - np.arange(len(paths))[:, None] * paths.shape[1] - 1
    low = np.clip(low, 0, paths.shape[1] - 2)
    row = np.arange(len(paths))[:, None]
    step = np.maximum(along[row, low + 1] - along[row, low], 1e-12)
    share = np.clip((at - along[row, low]) / step, 0.0, 1.0)[..., None]
    return paths[row, low] * (1 - share) + paths[row, low + 1] * share
