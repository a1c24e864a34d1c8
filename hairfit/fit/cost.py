"""What a fit will take, said before it starts, and how it keeps a limit."""

import contextlib
import os
from collections.abc import Sequence
from typing import Literal, NamedTuple

from ..capture.capture import View

Quality = Literal["draft", "normal", "high"]
QUALITIES: tuple[Quality, ...] = ("draft", "normal", "high")


class Cost(NamedTuple):
    """Time and memory of a fit, from photographs to the report."""

    seconds: float
    gigabytes: float


class Rate(NamedTuple):
    """What a fit takes: fixed, and for each megapixel of all photographs.

    Attributes:
        seconds: Seconds without any photograph, programs compiled anew.
        per_area: Seconds a megapixel.
        after: Seconds of what comes after the refinement, and before a fit can start.
        gigabytes: Memory without any photograph.
        memory_per_area: Gigabytes a megapixel.
    """

    seconds: float
    per_area: float
    after: float
    gigabytes: float
    memory_per_area: float


# Those of `benchmarks/cost.py` on two cores of an AMD EPYC, seconds times 1.7: so much
# slower the same kind of machine counts at other hours.
RATES: dict[Quality, Rate] = {
    "draft": Rate(37.0, 1.6, 21.0, 1.8, 0.05),
    "normal": Rate(56.0, 4.7, 25.0, 1.9, 0.07),
    "high": Rate(102.0, 10.0, 26.0, 2.3, 0.07),
}
# A machine may be this much slower than the one of the rates before a limit is broken.
SAFETY = 1.15


def expected_cost(views: Sequence[View], quality: Quality) -> Cost:
    """Return what a fit takes on two cores."""
    rate, area = RATES[quality], megapixels(views)
    return Cost(
        rate.seconds + rate.per_area * area,
        rate.gigabytes + rate.memory_per_area * area,
    )


def megapixels(views: Sequence[View]) -> float:
    """Return the area of all photographs, in millions of pixels."""
    return sum(view.camera.width * view.camera.height for view in views) / 1e6


def affordable(
    views: Sequence[View], quality: Quality, time_limit: float | None
) -> Quality:
    """Return the finest quality that a time limit allows, no finer than asked for.

    What only the refinement keeps from being in time counts as allowed: its last rounds
    are left out. The coarsest quality is always allowed.

    Args:
        views: The photographs.
        quality: What was asked for.
        time_limit: Seconds; None for no limit.
    """
    if time_limit is None:
        return quality
    asked = QUALITIES.index(quality)
    for at in range(asked, 0, -1):
        if SAFETY * expected_cost(views, QUALITIES[at]).seconds <= time_limit:
            return QUALITIES[at]
    return QUALITIES[0]


def refine_until(quality: Quality, time_limit: float | None) -> float | None:
    """Return how many seconds after its start a fit stops refining, None if never."""
    if time_limit is None:
        return None
    return time_limit - SAFETY * RATES[quality].after


def free_gigabytes() -> float | None:
    """Return the memory that no program uses, None if the system does not say."""
    with contextlib.suppress(ValueError, OSError, AttributeError):
        return os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 1e9
    return None
