"""How near photographs that were drawn again from a result come to the photographs.

Run `python benchmarks/redrawn.py RESULT [RESULT ...]`, with results of `hairfit fit`
whose captures are where they were. Prints for each the mean absolute difference between
`preview/` and the photographs within the hair's masks and on the head beside, both
without their finest texture, in sRGB levels of 255; and the colour that the hair was
found to have.
"""

import argparse
import pathlib

import numpy as np
from jaxtyping import Float
from scipy import ndimage

from hairfit.capture import load_capture
from hairfit.capture.capture import View
from hairfit.capture.photos import read_photo, srgb_from_linear
from hairfit.render import mesh_depth
from hairfit.report.result import captured_from, read_report
from hairfit.types import Mesh

SMOOTH = 2.0  # pixels of a preview


def main() -> None:
    """Print a line for each result."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("results", nargs="+", type=pathlib.Path)
    for result in parser.parse_args().results:
        report, folder = read_report(result), captured_from(result)
        if folder is None:
            parser.error(f"the capture of '{result}' is gone; put it where it was.")
        capture = load_capture(folder, ",".join(report["views"]))
        views, head = capture.views, capture.head
        off = np.nanmean([differences(result, view, head) for view in views], axis=0)
        looks = report["looks"]
        colour = "unknown" if looks is None else np.round(looks["linear_rgb"], 3)
        print(
            f"{result.name}: off by {off[0]:.1f} of 255, the head by {off[1]:.1f}, "
            f"linear RGB {colour}",
            flush=True,
        )


def differences(
    result: pathlib.Path, view: View, head: Mesh | None
) -> tuple[float, float]:
    """Return how far a photograph drawn again is off where it shows hair, and the head.

    In levels; not a number where nothing is seen.
    """
    drawn = srgb_from_linear(read_photo(result / "preview" / f"{view.name}.png"))
    drawn = ndimage.gaussian_filter(drawn, (SMOOTH, SMOOTH, 0))
    share, shape = drawn.shape[0] / view.image.shape[0], drawn.shape[:2]
    off = np.abs(drawn - smaller(srgb_from_linear(view.image), share, shape))
    hair = view.hair.astype(np.float64)
    bare = np.zeros_like(hair)
    if head is not None:
        bare = (np.isfinite(mesh_depth(head, view.camera)) & ~view.hair).astype(float)
    parts = smaller(np.stack([hair, bare], axis=-1), share, shape)
    # Whole pixels of the head alone: beside hair and background both may be off.
    parts = parts > [0.5, 0.99]
    levels = [
        255.0 * off[part].mean() if part.any() else np.nan
        for part in np.moveaxis(parts, -1, 0)
    ]
    return levels[0], levels[1]


def smaller(
    picture: Float[np.ndarray, "height width channels"],
    share: float,
    shape: tuple[int, ...],
) -> Float[np.ndarray, "rows columns channels"]:
    """Return a picture of the size of a preview, without its finest texture."""
    smooth = ndimage.gaussian_filter(picture, (SMOOTH / share, SMOOTH / share, 0))
    centres = [(np.arange(count) + 0.5) / share - 0.5 for count in shape]
    nearest = [
        np.clip(np.round(at), 0, size - 1).astype(int)
        for at, size in zip(centres, picture.shape[:2], strict=True)
    ]
    return smooth[np.ix_(*nearest)]


if __name__ == "__main__":
    main()
