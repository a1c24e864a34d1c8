"""How near photographs that were drawn again from a result come to the photographs.

Run `python benchmarks/redrawn.py RESULT [RESULT ...]`, with results of `hairfit fit`
whose captures are where they were. Prints for each the mean absolute difference between
`preview/` and the photographs within the hair's masks, both without their finest
texture, in sRGB levels of 255; and the colour that the hair was found to have.
"""

import argparse
import pathlib

import numpy as np
from jaxtyping import Float
from scipy import ndimage

from hairfit.capture import load_capture
from hairfit.capture.capture import View
from hairfit.capture.photos import read_photo, srgb_from_linear
from hairfit.report.result import captured_from, read_report

SMOOTH = 2.0  # pixels of a preview


def main() -> None:
    """Print a line for each result."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("results", nargs="+", type=pathlib.Path)
    for result in parser.parse_args().results:
        report, folder = read_report(result), captured_from(result)
        if folder is None:
            parser.error(f"the capture of '{result}' is gone; put it where it was.")
        views = load_capture(folder, ",".join(report["views"])).views
        off = np.mean([difference(result, view) for view in views])
        looks = report["looks"]
        colour = "unknown" if looks is None else np.round(looks["linear_rgb"], 3)
        print(
            f"{result.name}: off by {off:.1f} of 255, linear RGB {colour}", flush=True
        )


def difference(result: pathlib.Path, view: View) -> float:
    """Return how far one photograph drawn again is from the photograph, in levels."""
    drawn = srgb_from_linear(read_photo(result / "preview" / f"{view.name}.png"))
    drawn = ndimage.gaussian_filter(drawn, (SMOOTH, SMOOTH, 0))
    share = drawn.shape[0] / view.image.shape[0]
    photo = smaller(srgb_from_linear(view.image), share, drawn.shape[:2])
    mask = smaller(view.hair[..., None].astype(np.float64), share, drawn.shape[:2])
    return float(255.0 * np.abs(drawn - photo)[mask[..., 0] > 0.5].mean())


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
