"""What the qualities of a fit mean."""

from typing import NamedTuple

from .cost import Quality
from .refine import RefineConfig

WAVY = 2  # times as many knots follow waves, of which a skeleton else has three each


class Preset(NamedTuple):
    """What a quality means. Metres."""

    spacing: float
    guides: int
    levels: int
    leaves: int
    knots: int
    refine: RefineConfig
    settles: bool = True
    """Whether clusters get pieces of scalp; a few large ones would move roots far."""


PRESETS: dict[Quality, Preset] = {
    "draft": Preset(
        0.005,
        2500,
        2,
        200,
        12,
        RefineConfig(rounds=1, steps=30, strands=1200, points=16),
        settles=False,
    ),
    "normal": Preset(0.003, 8000, 3, 400, 16, RefineConfig()),
    "high": Preset(
        0.0025,
        12000,
        3,
        800,
        20,
        RefineConfig(rounds=4, steps=25, strands=5000, points=32),
    ),
}


def for_waves(preset: Preset) -> Preset:
    """Return a preset for hair that waves: skeletons have more knots."""
    return preset._replace(knots=WAVY * preset.knots)
