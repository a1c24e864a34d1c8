"""What `hairfit render` can do: colours, backgrounds, pen and ink, and two engines.

Run `python examples/render.py [--out FILE]`. Above: hair of named colours in the
model of Chiang et al. 2016. Below: a picture with coverage as alpha over squares, hair
between the posts of a picture that has depth, figure 7-4 of the thesis drawn anew, and
one scene by OpenGL and by JAX (both by JAX where there is no OpenGL).
"""

import argparse
import pathlib
import tempfile

import jax
import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image
from sheet import PICTURES, Sheet

from hairfit.io.mesh import save_mesh
from hairfit.io.strands import save_strands
from hairfit.model import sample_strands
from hairfit.report.orbit import orbit_camera
from hairfit.report.render_command import render
from hairfit.report.render_options import (
    BackgroundOptions,
    CameraOptions,
    HairOptions,
    RenderOptions,
)
from hairfit.synthetic.gallery import make_gallery_tree, make_subject
from hairfit.types import Strands

SIZE = (400, 460)
NAMES = ("black", "brown", "blonde", "red", "grey")
AZIMUTH, ELEVATION = 32.0, 8.0


class Studio:
    """Hairstyles as files, and the pictures that the command makes of them."""

    def __init__(self, folder: pathlib.Path, strands: int):
        self.folder = folder
        save_mesh(folder / "head.obj", make_subject().head)
        self.points = {}
        for style in ("bob", "ponytail"):
            grown = sample_strands(
                make_gallery_tree(style), strands, 40, jax.random.key(0)
            )
            self.points[style] = np.asarray(grown, np.float64)
            strands_of = Strands.from_array(self.points[style])
            save_strands(folder / f"{style}.hair", strands_of)

    def picture(
        self, style: str = "bob", azimuth: float = AZIMUTH, **options
    ) -> UInt8[np.ndarray, "height width channels"]:
        """Return a picture as `hairfit render` writes it."""
        out = self.folder / "picture.png"
        camera = CameraOptions(azimuth=azimuth, elevation=ELEVATION, size=SIZE)
        render(
            self.folder / f"{style}.hair",
            out,
            RenderOptions(camera, quality="normal", quiet=True, **options),
            head=self.folder / "head.obj",
        )
        return cut(np.asarray(Image.open(out)))

    def posts(self) -> BackgroundOptions:
        """Write a picture of posts before and behind the hair, with its depth."""
        angles = np.radians([AZIMUTH, ELEVATION])
        camera = orbit_camera(
            self.points["bob"], float(angles[0]), float(angles[1]), SIZE
        )
        points = self.points["bob"].reshape(-1, 3)
        axis = np.asarray(camera.cam_from_world, np.float64)[2]
        middle = float((points @ axis[:3] + axis[3]).mean())
        depth = np.full(SIZE[::-1], middle + 1.0, np.float32)
        y, x = np.mgrid[: SIZE[1], : SIZE[0]]
        sky = np.array([196, 208, 220]) - 0.12 * y[..., None]
        for k, left in enumerate(range(45, SIZE[0], 62)):
            post = (x >= left) & (x < left + 22)
            round_ = np.sqrt(np.maximum(1.0 - ((x - left - 11) / 11.5) ** 2, 0.0))
            wood = (0.35 + 0.65 * round_)[..., None] * [150, 112, 74]
            sky = np.where(post[..., None], wood, sky)
            depth[post] = middle + (-0.3 if k % 2 else 0.3)
        Image.fromarray(sky.astype(np.uint8)).save(self.folder / "posts.png")
        np.save(self.folder / "posts.npy", depth)
        return BackgroundOptions(
            behind=self.folder / "posts.png", behind_depth=self.folder / "posts.npy"
        )


def cut(picture: UInt8[np.ndarray, "height width channels"]) -> np.ndarray:
    """Return a picture without the empty rows above and below a head."""
    return picture[70:, :]


def over_squares(
    picture: UInt8[np.ndarray, "height width 4"],
) -> UInt8[np.ndarray, "height width 3"]:
    """Return a picture with alpha over a chequered ground."""
    y, x = np.mgrid[: picture.shape[0], : picture.shape[1]]
    ground = np.where((x // 20 + y // 20) % 2, 150.0, 235.0)[..., None]
    alpha: Float[np.ndarray, "height width 1"] = picture[..., 3:] / 255.0
    return np.round(alpha * picture[..., :3] + (1.0 - alpha) * ground).astype(np.uint8)


def main(out: pathlib.Path, strands: int = 20_000) -> None:
    """Draw the sheet.

    Args:
        out: The JPEG.
        strands: Strands of each hairstyle.
    """
    sheet = Sheet(2, 5, (SIZE[0], SIZE[1] - 70))
    with tempfile.TemporaryDirectory() as folder:
        studio = Studio(pathlib.Path(folder), strands)
        for name in NAMES:
            hair = HairOptions(colour=name, shading="chiang")
            sheet.add(f"--colour {name} --shading chiang", studio.picture(hair=hair))
        clear = studio.picture(background=BackgroundOptions(transparent=True))
        sheet.add("--transparent, over squares", over_squares(clear))
        between = studio.picture(background=studio.posts())
        sheet.add("--behind posts.png --behind-depth posts.npy", between)
        sheet.add("7-4: --lines", studio.picture("ponytail", 75.0, lines=True))
        for engine in ("auto", "jax"):
            drawn = studio.picture("ponytail", 100.0, engine=engine)
            sheet.add(f"--engine {engine}", drawn)
        sheet.save(out)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=pathlib.Path, default=PICTURES / "render.jpg")
    main(parser.parse_args().out)
