"""How well the hull holds the hair: as masks allow it, and carved by contradictions.

Run `python benchmarks/hulls.py CAPTURE ... [--views 00,01,...] [--quality normal]`; a
capture has a `truth.npz`. Of the hull's voxels so many are within 3 mm of true hair, so
many are 6 mm and more from it; of the true hair so much is inside, and within 2 mm.
"""

import numpy as np
from scipy.spatial import KDTree
from sense import parsed, start_of

from hairfit.evaluate.sample import sample_strands_evenly
from hairfit.fit import consistency
from hairfit.fit.curls import see_curls
from hairfit.fit.hull import Hull
from hairfit.io.strands import load_strands


def main() -> None:
    """Print three rows for each capture."""
    given = parsed(__doc__)
    print("| | voxels | within 3 mm | beyond 6 mm | hair inside | within 2 mm |")
    print("| --- | --- | --- | --- | --- | --- |")
    shadows = consistency.UNLIKE
    for folder in given.captures:
        shots, maps, hull, _ = start_of(folder, given.views, given.quality)
        true = sample_strands_evenly(load_strands(folder / "truth.npz")).points
        print(f"| {folder.name}: masks | {cells(hull, true)} |", flush=True)
        curly = see_curls(hull, shots.views, maps).radius > 0.0
        for name, unlike in (("directions", np.inf), ("and shadows", shadows)):
            consistency.UNLIKE = unlike
            carved = consistency.carve_by_consistency(
                hull, shots.views, maps, shots.depths, curly
            )
            print(f"| {name} | {cells(carved, true)} |", flush=True)


def cells(hull: Hull, true: np.ndarray) -> str:
    """Return the cells of a hull."""
    apart, _ = KDTree(true).query(hull.grid.centres(hull.hair))
    outside = hull.distance_at(true)
    shares = apart < 0.003, apart > 0.006, outside < 0.0, outside < 0.002
    texts = (f"{100 * share.mean():.1f} %" for share in shares)
    return f"{int(hull.hair.sum())} | {' | '.join(texts)}"


if __name__ == "__main__":
    main()
