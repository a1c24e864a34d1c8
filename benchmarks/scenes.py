"""Synthetic captures with their truth, that fits are judged by.

Run `python benchmarks/scenes.py CACHE [SCENE ...]` to make them.
Each scene is another hairstyle under another light, in another hair colour, resolution
and noise, in 12 views: 8 on a ring and 4 higher. The same recipe gives the same bytes.
"""

import argparse
import dataclasses
import hashlib
import subprocess
import sys
import time
from pathlib import Path

from hairfit.errors import InputError
from hairfit.model import HairTree
from hairfit.synthetic import Light, Look, Scene, make_style, write_capture
from hairfit.synthetic.gallery import make_gallery_tree, make_subject

VIEWS = 12

Colour = tuple[float, float, float]

BLACK: Colour = (0.016, 0.012, 0.010)
DARK: Colour = (0.055, 0.028, 0.016)
BROWN: Colour = (0.160, 0.075, 0.034)
RED: Colour = (0.300, 0.082, 0.024)
DARK_BLOND: Colour = (0.330, 0.205, 0.090)
BLOND: Colour = (0.560, 0.400, 0.190)
GREY: Colour = (0.300, 0.290, 0.280)

PALE: Colour = (0.62, 0.42, 0.33)
TAN: Colour = (0.42, 0.25, 0.16)
DEEP: Colour = (0.15, 0.078, 0.050)

STUDIO = Look()
WINDOW = Look(
    lights=(
        Light((0.95, 0.35, 0.30), (1.70, 1.75, 1.85)),
        Light((-0.70, 0.50, -0.50), (0.25, 0.23, 0.20)),
    ),
    background=(0.52, 0.51, 0.48),
    sky=0.30,
)
OVERCAST = Look(
    lights=(Light((0.10, 1.00, 0.15), (0.75, 0.78, 0.82)),),
    background=(0.22, 0.27, 0.20),
    sky=0.95,
)
EVENING = Look(
    lights=(
        Light((-0.75, 0.25, 0.60), (1.70, 1.25, 0.80)),
        Light((0.60, 0.40, -0.70), (0.55, 0.62, 0.80)),
    ),
    background=(0.30, 0.22, 0.17),
    sky=0.38,
)
FLASH = Look(
    lights=(
        Light((0.05, 0.20, 1.00), (1.55, 1.55, 1.55)),
        Light((0.00, 0.50, -0.90), (0.80, 0.80, 0.80)),
    ),
    background=(0.09, 0.09, 0.10),
    sky=0.30,
)


@dataclasses.dataclass(frozen=True)
class Recipe:
    """How a synthetic capture is made.

    Attributes:
        style: A style of `make_style`, or one of the gallery after `gallery:`.
        hair: Colour of the hair, linear RGB.
        skin: Colour of the head, linear RGB.
        light: Lights, sky and background.
        size: Width and height of the photographs, in pixels.
        noise: Standard deviation of the sensor's noise, against white.
        strands: Number of strands.
        points: Points of each strand.
        seed: Of the hairstyle, the roots and the noise.
    """

    style: str
    hair: Colour
    skin: Colour
    light: Look
    size: tuple[int, int]
    noise: float
    strands: int = 9000
    points: int = 64
    seed: int = 0

    def tree(self) -> HairTree:
        """Return the hairstyle."""
        name = self.style.removeprefix("gallery:")
        if name != self.style:
            return make_gallery_tree(name, self.seed, make_subject())
        return make_style(name, self.seed, make_subject().scalp)

    def scene(self) -> Scene:
        """Return how it is photographed."""
        look = dataclasses.replace(
            self.light, hair=self.hair, skin=self.skin, noise=self.noise
        )
        return Scene(VIEWS, self.size, self.strands, self.points, self.seed, look=look)


SMALL, MIDDLE, LARGE, HUGE = (384, 512), (480, 640), (600, 800), (768, 960)

SCENES: dict[str, Recipe] = {
    "straight": Recipe("straight", BLACK, TAN, STUDIO, LARGE, 0.004),
    "wavy": Recipe("wavy", DARK_BLOND, PALE, WINDOW, MIDDLE, 0.008, seed=1),
    "curly": Recipe("curly", RED, PALE, STUDIO, HUGE, 0.003, 8000, seed=2),
    "tied": Recipe("ponytail", BROWN, TAN, EVENING, MIDDLE, 0.006, seed=3),
    "bob": Recipe("gallery:bob", DARK, PALE, OVERCAST, LARGE, 0.004, seed=4),
    "pixie": Recipe(
        "gallery:pixie", BLOND, PALE, STUDIO, MIDDLE, 0.005, 14_000, 32, seed=5
    ),
    "afro": Recipe(
        "gallery:afro", BLACK, DEEP, WINDOW, LARGE, 0.004, 12_000, 96, seed=6
    ),
    "long-wavy": Recipe(
        "gallery:long-wavy", BROWN, TAN, OVERCAST, HUGE, 0.003, 8000, 80, seed=7
    ),
    "parted": Recipe("gallery:parted", GREY, TAN, FLASH, SMALL, 0.005, seed=8),
    "buzz-cut": Recipe(
        "gallery:buzz-cut", DARK, TAN, EVENING, MIDDLE, 0.006, 18_000, 12, seed=9
    ),
    "mohawk": Recipe(
        "gallery:mohawk", RED, PALE, FLASH, MIDDLE, 0.004, 12_000, 32, seed=10
    ),
    "bun": Recipe("gallery:bun", BLOND, TAN, EVENING, MIDDLE, 0.005, seed=11),
    "tight-curls": Recipe(
        "gallery:tight-curls", DARK, DEEP, STUDIO, LARGE, 0.003, 8000, 96, seed=12
    ),
    # These joined last: but for how lines leave the braid, no fit was made by them.
    "fringe": Recipe("gallery:fringe", BROWN, PALE, WINDOW, LARGE, 0.004, seed=21),
    "undercut": Recipe(
        "gallery:undercut", DARK, PALE, STUDIO, MIDDLE, 0.005, 12_000, 40, seed=22
    ),
    "dreadlocks": Recipe(
        "gallery:dreadlocks", DARK, DEEP, OVERCAST, LARGE, 0.004, seed=23
    ),
    "pigtails": Recipe("gallery:pigtails", RED, PALE, OVERCAST, LARGE, 0.004, seed=24),
    "braid": Recipe("gallery:braid", DARK_BLOND, TAN, EVENING, LARGE, 0.004, seed=25),
    "long-straight": Recipe(
        "gallery:long-straight", BLOND, PALE, WINDOW, MIDDLE, 0.006, seed=26
    ),
}


def scene_folder(name: str, cache: Path) -> Path:
    """Return where the capture of a scene is, or will be.

    The folder's name is the scene's; the one above it is a checksum of the recipe, so
    that a changed recipe is not answered with an old capture.

    Args:
        name: One of `SCENES`.
        cache: Folder of all scenes.

    Raises:
        InputError: If there is no such scene.
    """
    if name not in SCENES:
        raise InputError(
            f"there is no scene {name!r}; take one of {', '.join(SCENES)}."
        )
    digest = hashlib.sha256(repr(SCENES[name]).encode()).hexdigest()[:12]
    return Path(cache) / digest / name


def make_scene(name: str, cache: Path) -> Path:
    """Return the folder of a synthetic capture, which is made if it is not there yet.

    Args:
        name: One of `SCENES`.
        cache: Folder of all scenes.

    Raises:
        InputError: If there is no such scene.
    """
    folder = scene_folder(name, cache)
    if not folder.is_dir():
        recipe = SCENES[name]
        folder.parent.mkdir(parents=True, exist_ok=True)
        write_capture(recipe.tree(), make_subject().head, folder, recipe.scene())
    return folder


def make_apart(name: str, cache: Path) -> Path:
    """Make a scene in a process of its own, which gives back the memory it took.

    Raises:
        InputError: If there is no such scene.
        CalledProcessError: If it could not be made.
    """
    folder = scene_folder(name, cache)
    if not folder.is_dir():
        words = [sys.executable, __file__, str(cache), name]
        subprocess.run(words, check=True, stdout=sys.stderr)
    return folder


def main() -> None:
    """Make scenes, and say where they are."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cache", type=Path)
    parser.add_argument("scenes", nargs="*", default=list(SCENES))
    given = parser.parse_args()
    for name in given.scenes:
        start = time.monotonic()
        folder = make_scene(name, given.cache)
        print(f"{folder}, {time.monotonic() - start:.0f} s", flush=True)


if __name__ == "__main__":
    main()
