"""Where opacity maps are put along the light [Kim02, section 6.2.1, figure 6-4]."""

import numpy as np
from jaxtyping import Float


def uniform_slices(
    nearest: float, farthest: float, count: int
) -> Float[np.ndarray, " n"]:
    """Return the depths of evenly spaced maps (figure 6-4a).

    Args:
        nearest: Depth of the first hair from the light, in metres: $D_0$.
        farthest: Depth of the last one.
        count: Number of maps; there is one depth more, as slabs lie between two.

    Raises:
        ValueError: If there is no map, or no depth between the first and the last hair.
    """
    check(nearest, farthest, count)
    return np.linspace(nearest, farthest, count + 1)


def gamma_slices(
    nearest: float, farthest: float, count: int, gamma: float = 2.0
) -> Float[np.ndarray, " n"]:
    """Return depths that lie closer near the light (figure 6-4c).

    Shadows vary less and less far from the light, so that even steps of perceived
    brightness are steps of depth that grow, as in gamma correction.

    Args:
        nearest: Depth of the first hair, in metres.
        farthest: Depth of the last one.
        count: Number of maps.
        gamma: Power of the even steps; 1 gives even slices.

    Raises:
        ValueError: As `uniform_slices`, or if `gamma` is not positive.
    """
    check(nearest, farthest, count)
    if not gamma > 0.0:
        raise ValueError(f"gamma must be positive, got {gamma}; 1 gives even slices.")
    return nearest + (farthest - nearest) * np.linspace(0.0, 1.0, count + 1) ** gamma


def density_slices(
    depth: Float[np.ndarray, " points"], count: int, even: float = 0.2
) -> Float[np.ndarray, " n"]:
    """Return depths that lie closer where there is more hair (figure 6-4b).

    The thesis splits the range in halves, a BSP in one dimension. Here as many points
    lie between any two depths, which is where such splits by the median end; a share of
    even spacing keeps slabs from becoming thin without limit.

    Args:
        depth: Depths of the hair's points from the light, in metres.
        count: Number of maps.
        even: Share of even spacing, from 0 to 1.

    Raises:
        ValueError: As `uniform_slices`, or if `even` is not in [0, 1].
    """
    if not 0.0 <= even <= 1.0:
        raise ValueError(f"`even` is a share from 0 to 1, got {even}.")
    nearest = float(np.min(depth, initial=np.inf))
    farthest = float(np.max(depth, initial=-np.inf))
    check(nearest, farthest, count)
    share = np.linspace(0.0, 1.0, count + 1)
    flat = nearest + (farthest - nearest) * share
    return even * flat + (1.0 - even) * np.quantile(depth, share)


def check(nearest: float, farthest: float, count: int) -> None:
    """Refuse ranges and numbers that make no slabs."""
    if count < 1 or not farthest > nearest:
        raise ValueError(
            f"opacity maps need at least 1 map and a range of depths, got {count} maps "
            f"from {nearest} to {farthest} m; give more than one point of hair."
        )


def slab_of(
    depth: Float[np.ndarray, " points"], slices: Float[np.ndarray, " n"]
) -> np.ndarray:
    r"""Return i with $D_i \le$ depth $< D_{i+1}$, line 5 of table 6-1, counted from 0.

    What lies before the first map is in the first slab, what lies beyond the last in
    the last.

    Args:
        depth: Depths of points from the light.
        slices: Depths of the maps, rising.
    """
    found = np.searchsorted(slices, depth, side="right") - 1
    return np.clip(found, 0, len(slices) - 2)
