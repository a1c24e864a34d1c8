"""How far orientation maps are off, and whether their confidence knows it.

Run `python benchmarks/orientation.py [CAPTURE ...] [--views 00,01 | --views 8]
[--shake 3]`, the last with photographs shaken by so many pixels, each another way. The
captures need `truth.npz`: the front-most strand in a pixel is its truth. Drawn waves,
whose direction is known, follow; they have no photograph's noise but turn quickly.
Errors are in degrees: the median over the visible hair with the confidence as weight
and without, and in ten bins of equal counts, best first, the expected error (1.4826
times the median) beside the actual one.
"""

import argparse
import pathlib
import time

import numpy as np
from corruptions import all_shaken
from scipy.ndimage import gaussian_filter, map_coordinates

from hairfit.capture import load_capture
from hairfit.capture.orientation import (
    OrientationMap,
    estimate_orientation,
    line_angle,
)
from hairfit.capture.shake import steady_orientation
from hairfit.evaluate.photographs import weigh
from hairfit.render.raster import mesh_depth, rasterise

CAPTURES = pathlib.Path(__file__).parents[2] / "shared" / "captures"
RING = "00,01,02,03,04,05,06,07"
WAVES = ((20, 80, 0.1), (20, 80, 0.4), (40, 80, 0.1), (40, 40, 0.1), (60, 50, 0.4))
# Strands go this deep into the head's mesh where it is coarser than the hair's roots.
SKIN = 2e-3


class Errors:
    """Errors with the confidence and the error that were expected, in degrees."""

    def __init__(self, found: OrientationMap, truth: np.ndarray, known: np.ndarray):
        self.error = np.degrees(line_angle(found.angle[known], truth[known]))
        self.weight = found.confidence[known].astype(float)
        self.sigma = np.degrees(found.sigma[known])


def print_row(name: str, parts: list[Errors], seconds: float) -> None:
    """Print one row of the table."""
    error, weight, sigma = (
        np.concatenate([getattr(part, key) for part in parts])
        for key in ("error", "weight", "sigma")
    )
    bins = np.array_split(np.argsort(sigma, kind="stable"), 10)
    pairs = (
        f"{np.median(sigma[b]):.0f}/{1.4826 * np.median(error[b]):.0f}" for b in bins
    )
    print(
        f"{name:<18}{weigh(error, weight).median:9.2f}{np.median(error):9.2f}"
        f"{seconds:9.2f}   {' '.join(f'{pair:>6}' for pair in pairs)}",
        flush=True,
    )


def measure_capture(folder: pathlib.Path, views: str, each: bool, shake: float) -> None:
    """Print the errors on a capture whose strands are known."""
    capture = load_capture(folder, views)
    with np.load(folder / "truth.npz") as file:
        count = len(file["offsets"]) - 1
        points = file["points"].reshape(count, -1, 3).astype(np.float64)
    parts, seconds = [], 0.0
    shown = all_shaken(capture.views, shake) if shake else capture.views
    for view in shown:
        hidden = None
        if capture.head is not None:
            hidden = mesh_depth(capture.head, view.camera) + SKIN
        truth = rasterise(points, view.camera, mesh_depth=hidden)
        start = time.perf_counter()
        found = steady_orientation(view.image, view.hair).found
        taken = time.perf_counter() - start
        parts.append(Errors(found, truth.orientation, view.hair & truth.coverage))
        seconds += taken / len(shown)
        if each:
            print_row(f"  {view.name}", parts[-1:], taken)
    print_row(folder.name, parts, seconds)


def draw_hair(theta: np.ndarray, noise: float, seed: int) -> np.ndarray:
    """Return a picture of hair along `theta`: grain, smeared along the direction."""
    rng = np.random.default_rng(seed)
    grain = gaussian_filter(rng.normal(size=theta.shape), 0.7)
    axis = np.stack([np.cos(2 * theta), np.sin(2 * theta)])
    streak = np.zeros(theta.shape)
    for way in (0.5, -0.5):
        at = np.mgrid[: theta.shape[0], : theta.shape[1]].astype(float)
        before = None
        for step in range(28):
            streak += np.exp(-0.5 * (step / 14) ** 2) * sample(grain, at)
            turn = 0.5 * np.arctan2(sample(axis[1], at), sample(axis[0], at))
            ahead = np.stack([np.sin(turn), np.cos(turn)])
            if before is not None:
                ahead = ahead * np.where((ahead * before).sum(0) < 0, -1.0, 1.0)
            before = ahead
            at = at + way * ahead
    brown = (
        np.array([0.06, 0.035, 0.02]) * np.exp(0.35 * streak / streak.std())[..., None]
    )
    image = brown * (1 + noise * rng.normal(size=brown.shape))
    return np.clip(image, 0, 1).astype(np.float32)


def sample(values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return values between pixels."""
    return map_coordinates(values, at, order=1, mode="reflect")


def measure_waves(swing_deg: float, wavelength: float, noise: float) -> None:
    """Print the errors on hair that hangs down in waves."""
    y, x = np.mgrid[:320, :320].astype(float)
    lock = gaussian_filter(np.random.default_rng(1).normal(size=y.shape), 40)
    phase = 2 * np.pi * (y + 0.3 * x) / wavelength + 1.5 * lock / lock.std()
    theta = np.arctan2(1.0, np.tan(np.radians(swing_deg)) * np.cos(phase))
    image = draw_hair(theta, noise, seed=2)
    start = time.perf_counter()
    found = estimate_orientation(image, np.ones(theta.shape, bool))
    seconds = time.perf_counter() - start
    name = f"{swing_deg} deg {wavelength} px {noise}"
    print_row(name, [Errors(found, theta, np.ones(theta.shape, bool))], seconds)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="Errors of orientation maps.")
    ruby, ponytail = CAPTURES / "ruby", CAPTURES / "ponytail"
    parser.add_argument(
        "captures", nargs="*", type=pathlib.Path, default=[ruby, ponytail]
    )
    parser.add_argument("--views", default=RING, help="names, or how many")
    parser.add_argument("--each", action="store_true", help="a row for every view, too")
    parser.add_argument("--shake", type=float, default=0.0, help="pixels")
    options = parser.parse_args()
    # The first call loads OpenCV and measures the filters' noise.
    estimate_orientation(np.ones((32, 32, 3), np.float32), np.ones((32, 32), bool))
    print(f"{'':<18}{'weighted':>9}{'median':>9}{'seconds':>9}   expected/actual")
    for folder in options.captures:
        measure_capture(folder, options.views, options.each, options.shake)
    print("drawn waves: swing, wavelength, noise")
    for swing, wavelength, noise in WAVES:
        measure_waves(swing, wavelength, noise)


if __name__ == "__main__":
    main()
