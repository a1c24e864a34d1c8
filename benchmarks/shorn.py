"""How far streaks run in hair that lies thin on the skin: whether it is shorn.

Run `python benchmarks/shorn.py CAPTURE ... [--views 00,01,...] [--quality normal]`. So
much hair lies thin, photographs tell of so much of it, in so large a share of that
streaks end, and so much is taken for shorn; the last three with noise of 6 % of white,
too. See `fit/shorn.py`.
"""

import dataclasses

import numpy as np
from sense import parsed, start_of

from hairfit.capture.orientation import estimate_orientation
from hairfit.fit.consistency import carve_by_consistency
from hairfit.fit.curls import see_curls
from hairfit.fit.evidence import find_planes
from hairfit.fit.grid import uphill
from hairfit.fit.hull import Hull, pixel_sizes, walls_of
from hairfit.fit.shorn import KINDS, Ends, find_shorn, streak_ends, streaks_at
from hairfit.fit.shots import Shots
from hairfit.fit.stubble import thin_hair

NOISE = 0.06
CM3 = 1e6  # in a cubic metre


def main() -> None:
    """Print a row for each capture."""
    given = parsed(__doc__)
    print("| | thin | told | streaks end | shorn | with noise: told | end | shorn |")
    print(f"|{8 * ' --- |'}")
    for folder in given.captures:
        shots, maps, hull, _ = start_of(folder, given.views, given.quality)
        curly = see_curls(hull, shots.views, maps).radius > 0.0
        hull = carve_by_consistency(hull, shots.views, maps, shots.depths, curly)
        voxel = CM3 * hull.grid.spacing**3
        cells = [f"{voxel * thin_hair(hull).sum():.0f} cm³"]
        for noise in (0.0, NOISE):
            found = told_of(hull, shots, noise)
            share = (found.ends & found.told).sum() / max(found.told.sum(), 1)
            told, shorn = (
                f"{voxel * some.sum():.0f} cm³"
                for some in (found.told, find_shorn(hull, found))
            )
            cells += [told, f"{100 * share:.0f} %", shorn]
        print(f"| {folder.name} | {' | '.join(cells)} |", flush=True)


def told_of(hull: Hull, shots: Shots, noise: float) -> Ends:
    """Return where streaks end, with so much noise in all photographs."""
    thin, walls, skin = thin_hair(hull), walls_of(hull), uphill(hull.head)[hull.hair]
    points, sums = hull.grid.centres(hull.hair), np.zeros((len(thin), KINDS))
    rng, pixels = np.random.default_rng(0), pixel_sizes(hull, shots.views)
    for view, depth, pixel in zip(shots.views, shots.depths, pixels, strict=True):
        image = view.image + rng.normal(0.0, noise, view.image.shape)
        image = np.clip(image, 0.0, 1.0).astype(view.image.dtype)
        noisy = dataclasses.replace(view, image=image)
        found = estimate_orientation(image, view.hair)
        planes = find_planes(walls, points, noisy, found, depth)
        sums += streaks_at(points, skin, noisy, found, pixel, planes.seen, planes.at)
    return streak_ends(hull, thin, sums)


if __name__ == "__main__":
    main()
