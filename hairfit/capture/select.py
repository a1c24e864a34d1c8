"""Which photographs of a capture are used."""

import itertools
import math
from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from ..errors import InputError
from ..render.camera import Camera
from .photos import stem

# So many choices of views are all tried.
MOST_CHOICES = 5000


@runtime_checkable
class Posed(Protocol):
    """Anything with a name and a camera."""

    @property
    def name(self) -> str:
        """Name of the photograph, without suffix."""
        ...

    @property
    def camera(self) -> Camera:
        """Its camera."""
        ...


def choose_views(spec: str, views: Sequence[Posed]) -> tuple[str, ...]:
    """Return the names of the views that a user asks for.

    Args:
        spec: Names with commas between, with or without suffix ("00,02.png"), or how
            many views to take ("4"): they are then spread evenly over the directions
            from which the photographs were taken, with the front-most among them. A
            number that is itself a view's name, or ends with a comma, is a name.
        views: The views to choose from.

    Returns:
        The names, in the order of `views`.

    Raises:
        InputError: If a name is unknown, or there are fewer views than asked for.
    """
    known = [view.name for view in views]
    wanted = [stem(part.strip()) for part in spec.split(",") if part.strip()]
    if "," not in spec and spec.strip().isdecimal() and wanted[0] not in known:
        count = int(spec)
        if not 1 <= count <= len(views):
            raise InputError(
                f"--views {count} asks for {count} views, but the capture has "
                f"{len(views)}; ask for 1 to {len(views)}."
            )
        chosen = spread(directions(views), count)
        return tuple(known[i] for i in sorted(chosen))
    unknown = [name for name in wanted if name not in known]
    if unknown or not wanted:
        what = f"no view '{unknown[0]}'" if unknown else "--views names no view"
        raise InputError(f"{what}; the capture has {', '.join(known)}.")
    return tuple(name for name in known if name in wanted)


def directions(views: Sequence[Posed]) -> Float[np.ndarray, "views 3"]:
    """Return the unit vectors against which the cameras look."""
    return -np.stack(
        [np.asarray(v.camera.cam_from_world, np.float64)[2, :3] for v in views]
    )


def spread(towards: Float[np.ndarray, "views 3"], count: int) -> list[int]:
    """Return `count` of the directions, the front-most (+z) and others far from it.

    The closest pair is as far apart as can be, then the next closest, and so on. Where
    there are too many choices to try, the farthest is added again and again, and then
    single ones are exchanged as long as that helps.
    """
    # Nearly equal angles are made equal, so that rounding does not decide.
    apart = np.round(np.arccos(np.clip(towards @ towards.T, -1.0, 1.0)), 6)
    front = int(np.argmax(towards[:, 2]))
    others = [k for k in range(len(towards)) if k != front]
    if math.comb(len(others), count - 1) <= MOST_CHOICES:
        choices = itertools.combinations(others, count - 1)
        return max(
            ([front, *choice] for choice in choices),
            key=lambda chosen: closeness(apart, chosen),
        )
    chosen = [front]
    while len(chosen) < count:
        nearest = apart[:, chosen].min(axis=1)
        nearest[chosen] = -1.0
        chosen.append(int(np.argmax(nearest)))
    return exchanged(apart, chosen)


def exchanged(apart: Float[np.ndarray, "views views"], chosen: list[int]) -> list[int]:
    """Return the chosen after all exchanges of one, not the first, that help."""
    best = closeness(apart, chosen)
    improved = True
    while improved:
        improved = False
        for place in range(1, len(chosen)):
            for other in range(len(apart)):
                trial = [*chosen[:place], other, *chosen[place + 1 :]]
                if other in chosen or closeness(apart, trial) <= best:
                    continue
                chosen, best, improved = trial, closeness(apart, trial), True
    return chosen


def closeness(
    apart: Float[np.ndarray, "views views"], chosen: list[int]
) -> tuple[float, ...]:
    """Return the angles between all pairs of the chosen, the closest pair first."""
    pairs = apart[np.ix_(chosen, chosen)][np.triu_indices(len(chosen), 1)]
    return tuple(np.sort(pairs).tolist())
