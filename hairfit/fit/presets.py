"""What the qualities of a fit mean."""

import dataclasses
from typing import NamedTuple

from .cost import Quality
from .refine import RefineConfig

WAVY_POINTS = 40  # of each strand, where waves are compared with photographs
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


def by_photographs(config: RefineConfig) -> RefineConfig:
    """Return how waves are refined: by photographs, as the field smooths them."""
    points = max(config.points, WAVY_POINTS)
    return dataclasses.replace(
        config, steps=20, points=points, field=0.0, lowest_alone=True
    )


def for_waves(preset: Preset) -> Preset:
    """Return a preset for hair that waves: skeletons have more knots."""
    return preset._replace(knots=WAVY * preset.knots)
