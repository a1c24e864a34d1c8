"""How sure orientation maps are in the mean, with noise and smoothed.

Run `python benchmarks/sureness.py CAPTURE ...`. Four photographs of each, as they
are and with noise of 3 % of white, sharp and smoothed. Afros and ringlets stay unsure,
straight hair becomes sure when what noise hides is brought out; see `fit/curls.py`.
"""

import dataclasses
import pathlib
import sys

import numpy as np
from scipy import ndimage

from hairfit.capture import View, load_capture
from hairfit.capture.orientation import estimate_orientation
from hairfit.fit.curls import GRAIN, mean_confidence

NOISE = 0.03
VIEWS = slice(0, 8, 2)


def taken(view: View, noise: float, blur: float) -> View:
    """Return a photograph with noise, smoothed by so many pixels."""
    grain = np.random.default_rng(0).normal(0.0, noise, view.image.shape)
    image = np.clip(view.image + grain, 0.0, 1.0).astype(view.image.dtype)
    smooth = ndimage.gaussian_filter(image, (blur, blur, 0)) if blur else image
    return dataclasses.replace(view, image=smooth)


def main() -> None:
    """Print a row for each capture."""
    print("| | clean | with noise |\n| --- | --- | --- |")
    for name in sys.argv[1:]:
        views = load_capture(pathlib.Path(name)).views[VIEWS]
        cells = []
        for noise in (0.0, NOISE):
            sure = []
            for blur in (0.0, GRAIN):
                now = [taken(view, noise, blur) for view in views]
                maps = [estimate_orientation(v.image, v.hair) for v in now]
                sure.append(f"{mean_confidence(now, maps):.2f}")
            cells.append(", ".join(sure))
        print(f"| {pathlib.Path(name).name} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
