"""What `hairfit render` can be asked for; the docstrings are its help."""

import dataclasses
from pathlib import Path
from typing import Literal

Shading = Literal["kajiya-kay", "marschner", "chiang"]
Quality = Literal["draft", "normal", "high"]
EngineName = Literal["auto", "gl", "jax"]


@dataclasses.dataclass(frozen=True)
class CameraOptions:
    """Where the hair is seen from."""

    view: str | None = None
    """Draw it as this photograph of the capture saw it; `all` for each of them."""
    scale: float = 1.0
    """With --view: the picture's size as a multiple of the photograph's."""
    azimuth: float = 0.0
    """Direction to look from, in degrees: 0 is the face, 90 the person's left."""
    elevation: float = 8.0
    """Height to look from, in degrees above the horizon."""
    turntable: int | None = None
    """Draw so many pictures once around the hair, as a folder, .gif or .mp4."""
    size: tuple[int, int] | None = None
    """Width and height in pixels, 16 to 8192; by default 768 960, or as --behind."""


@dataclasses.dataclass(frozen=True)
class HairOptions:
    """What the hair looks like."""

    strands: int = 10_000
    """How many strands to grow, if the hair is a tree."""
    colour: str | None = None
    """black, brown, blonde, red, grey or white, or sRGB as rrggbb in hexadecimal; by
    default as fitted or painted, else brown."""
    melanin: tuple[float, float] | None = None
    """Eumelanin and pheomelanin instead: 1.3 0.2 is brown, 0.5 1.2 red."""
    shading: Shading = "kajiya-kay"
    """How a hair scatters light; the slower two let it through as real hair does."""
    width_mm: float | None = None
    """Width of a hair; by default so that few hairs fill what many would, those of a
    result what its masks show."""
    alpha: float = 1.0
    """Opacity of what a hair covers, above 0, up to 1."""


@dataclasses.dataclass(frozen=True)
class LightOptions:
    """What shines on it."""

    light: tuple[tuple[float, float, float], ...] = ()
    """Azimuth, elevation (degrees) and strength of a far light; else two move along."""
    sky: float | None = None
    """Light from all sides, shadowed by hair unless it is kajiya-kay's."""
    no_shadows: bool = False
    """Let all light reach all hair."""


@dataclasses.dataclass(frozen=True)
class BackgroundOptions:
    """What is behind it; one of these at most, but --behind-depth."""

    background: str | None = None
    """An even colour, sRGB as rrggbb in hexadecimal."""
    transparent: bool = False
    """Write PNG with coverage as alpha."""
    photo: bool = False
    """With --view: the photograph itself; the head hides hair but is not drawn."""
    behind: Path | None = None
    """A picture of the same size, as another program rendered it."""
    behind_depth: Path | None = None
    """Its depth along the optical axis in metres: .npy, or .tiff of 32-bit floats."""


@dataclasses.dataclass(frozen=True)
class RenderOptions:
    """All that can be asked for.

    Attributes:
        camera: Where the hair is seen from.
        hair: What it looks like.
        light: What shines on it.
        background: What is behind.
        lines: Whether to draw it by pen instead.
        quality: What a picture may cost.
        engine: What draws it.
        quiet: Whether to show no progress.
    """

    camera: CameraOptions = CameraOptions()
    hair: HairOptions = HairOptions()
    light: LightOptions = LightOptions()
    background: BackgroundOptions = BackgroundOptions()
    lines: bool = False
    quality: Quality = "normal"
    engine: EngineName = "auto"
    quiet: bool = False
