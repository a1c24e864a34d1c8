"""How well photographs tell which way the locks of curls run, and how large a turn is.

Run `python benchmarks/curls.py CAPTURE ... [--views 00,01,...]`; a capture has a
`truth.npz` of hair that curls. A true lock is the line about which a strand curls,
where three quarters of a turn and more are left to either end. Errors are in degrees,
at the points of hair that a photograph shows: the median, and what is within 20 and 30,
of the hair's own orientation, of its mean over a turn, and of the maps of locks.
"""

import argparse
import pathlib

import numpy as np
from accuracy_run import SUBSETS
from jaxtyping import Float

from hairfit.capture import load_capture
from hairfit.capture.orientation import (
    angle_of_line,
    estimate_orientation,
    line_angle,
)
from hairfit.evaluate.curls import (
    LEAST_PERIODS,
    SAMPLES,
    centre_line,
    find_curls,
    median_of,
    strongest_period,
)
from hairfit.evaluate.visibility import SEE_INTO, even_strands, look
from hairfit.fit.curls import mean_line, see_locks
from hairfit.fit.hull import carve, pixel_sizes
from hairfit.fit.presets import PRESETS
from hairfit.fit.repeats import find_pitch, repeats
from hairfit.fit.slopes import radius_at
from hairfit.io.strands import load_strands
from hairfit.render import project_points
from hairfit.render.raster import cells, rasterise, visible_points
from hairfit.types import resample_paths

AHEAD = 1e-3  # metres by which the direction in a picture is found


def main() -> None:
    """Print a row for each capture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("captures", nargs="+", type=pathlib.Path)
    parser.add_argument("--views", default=",".join(SUBSETS[8] or ()))
    given = parser.parse_args()
    print("| | pitch, true | radius, true | hair | mean | locks |")
    print("| --- | --- | --- | --- | --- | --- |")
    for folder in given.captures:
        print(f"| {folder.name} | {row(folder, given.views)} |", flush=True)


def row(folder: pathlib.Path, names: str) -> str:
    """Return the cells of a capture."""
    capture = load_capture(folder, views=names)
    if capture.head is None:
        raise SystemExit(f"'{folder}' has no head.obj; take a capture that has one.")
    sights = look(capture.head, capture.views)
    depths = [np.asarray(sight.behind) for sight in sights]
    hull = carve(capture.views, depths, capture.head, PRESETS["normal"].spacing)
    pixels = pixel_sizes(hull, capture.views)
    masks = [view.hair for view in capture.views]
    maps = [estimate_orientation(view.image, view.hair) for view in capture.views]
    pitch = find_pitch([repeats(*one) for one in zip(masks, maps, pixels, strict=True)])
    truth = load_strands(folder / "truth.npz")
    curls = find_curls(truth)
    true = median_of(curls.pitch, curls.curled)
    size = median_of(curls.radius, curls.curled)
    start = f"{text_of(pitch)}, {text_of(true)}"
    if pitch is None:
        return f"{start} | {text_of(None)}, {text_of(size)} | – | – | –"
    locks = see_locks(masks, maps, pixels, pitch)
    start += f" | {text_of(radius_at(locks.slope, pitch))}, {text_of(size)}"
    strands = even_strands(truth)
    hair = resample_paths(strands[curls.curled], SAMPLES)
    rows = np.asarray(hair - hair[:, :1], np.float32)
    period = strongest_period(rows, strands.shape[1]).period
    period = np.clip(period, 2.0, (SAMPLES - 1) / LEAST_PERIODS).astype(np.float32)
    from_end = np.minimum(np.arange(SAMPLES), np.arange(SAMPLES)[::-1])
    whole = from_end >= 0.75 * period[:, None]
    along = np.gradient(centre_line(rows, period), axis=1)[whole]
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    points = hair[whole]
    errors: list[list[Float[np.ndarray, " points"]]] = [[], [], []]
    photographs = zip(sights, maps, locks.maps, pixels, strict=True)
    for sight, found, lock, pixel in photographs:
        camera, mask = sight.view.camera, sight.view.hair
        front = rasterise(strands, camera, mesh_depth=sight.behind).depth
        seen = visible_points(points, camera, front, sight.behind, SEE_INTO)
        here = project_points(points[seen], camera)
        ahead = project_points(points[seen] + AHEAD * along[seen], camera)
        y, x = np.moveaxis(ahead.pixel - here.pixel, 1, 0)[::-1]
        at, column, inside = cells(here, camera.width, camera.height)
        inside &= mask[at, column]
        mean = mean_line(mask, found, pixel)
        told = found.angle, angle_of_line(mean[..., 0], mean[..., 1]), lock.angle
        for kept, angle in zip(errors, told, strict=True):
            gap = line_angle(angle[at, column], np.arctan2(y, x))
            kept.append(np.degrees(gap[inside]))
    return " | ".join([start, *(share_text(np.concatenate(kept)) for kept in errors)])


def text_of(length: float | None) -> str:
    """Return a length in millimetres."""
    return "none" if length is None else f"{1000 * length:.1f} mm"


def share_text(errors: Float[np.ndarray, " points"]) -> str:
    """Return the median error and the shares within 20 and 30 degrees."""
    shares = " and ".join(f"{100 * (errors < most).mean():.0f}" for most in (20, 30))
    return f"{np.median(errors):.1f}°, {shares} %"


if __name__ == "__main__":
    main()
