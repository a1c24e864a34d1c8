"""How much hair the fit takes to grow the wrong way, before any strand has grown.

Run `python benchmarks/sense.py CAPTURE ... [--views 00,01,...] [--quality normal]`; a
capture has a `truth.npz`. Of the true hair within the hull so much is within 30 degrees
of the field, and of that so much runs against the sense of growth; see `fit/sense.py`.
"""

import argparse
import pathlib
from typing import NamedTuple

import jax
import numpy as np
from accuracy_run import SUBSETS

from hairfit.capture import load_capture
from hairfit.capture.orientation import OrientationMap
from hairfit.evaluate.sample import sample_strands_evenly
from hairfit.fit.bridges import bridged
from hairfit.fit.checkpoint import Checkpoint
from hairfit.fit.consistency import carve_by_consistency
from hairfit.fit.corners import carve_corners
from hairfit.fit.cost import Quality
from hairfit.fit.curls import see_curls
from hairfit.fit.flow import hair_field, hair_flow
from hairfit.fit.hull import Hull, carve_sparse
from hairfit.fit.presets import PRESETS
from hairfit.fit.shots import Shots, look_at, trusted_shots, wrapped_scalp
from hairfit.io.strands import load_strands
from hairfit.model.scalp import Scalp, normals_on, points_on, sample_roots

RIGHT = np.cos(np.radians(30.0))


class Shares(NamedTuple):
    """Of true hair: in the hull; of that along the field; of that against its sense."""

    inside: float
    along: float
    against: float


def main() -> None:
    """Print a row for each capture."""
    given = parsed(__doc__)
    print("| | in the hull | along the field | against its sense |")
    print("| --- | --- | --- | --- |")
    for folder in given.captures:
        shares = measured(folder, given.views, given.quality)
        cells = " | ".join(f"{100 * share:.2f} %" for share in shares)
        print(f"| {folder.name} | {cells} |", flush=True)


def parsed(description: str | None) -> argparse.Namespace:
    """Return the captures, views and quality that the command line asks for."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("captures", nargs="+", type=pathlib.Path)
    parser.add_argument("--views", default=",".join(SUBSETS[8] or ()))
    parser.add_argument("--quality", default="normal", choices=PRESETS)
    return parser.parse_args()


class Start(NamedTuple):
    """What a fit knows of a capture before it compares photographs with each other.

    Attributes:
        shots: The photographs.
        maps: Their orientation maps.
        hull: Where their masks allow hair.
        scalp: Where hair grows.
    """

    shots: Shots
    maps: list[OrientationMap]
    hull: Hull
    scalp: Scalp


def start_of(folder: pathlib.Path, names: str, quality: Quality) -> Start:
    """Return what a fit of these photographs of a capture starts with."""
    capture = load_capture(folder, views=names)
    head, store = capture.head, Checkpoint(None)
    if head is None:
        raise SystemExit(f"'{folder}' has no head.obj; take a capture that has one.")
    shots = trusted_shots(capture.views, head, store)
    spacing = PRESETS[quality].spacing
    hull, gaps = carve_sparse(shots.views, shots.depths, head, spacing)
    hull = carve_corners(hull, shots.views, shots.depths)
    shots, maps = look_at(shots, store, lambda share: None)
    scalp = capture.scalp or wrapped_scalp(shots, head, gaps)
    return Start(shots, [maps[k] for k in shots.used], hull, scalp)


def measured(folder: pathlib.Path, names: str, quality: Quality) -> Shares:
    """Return the shares of a capture, of the photographs that are named."""
    shots, maps, hull, scalp = start_of(folder, names, quality)
    views, depths = shots.views, shots.depths
    allowed, curls = hull, see_curls(hull, views, maps)
    hull = carve_by_consistency(hull, views, maps, depths, curls.radius > 0.0)
    uv = sample_roots(scalp, PRESETS[quality].guides, jax.random.key(0))
    roots, normals = (
        np.asarray(on(scalp, uv), np.float64) for on in (points_on, normals_on)
    )
    hull = bridged(hull if curls.told else allowed, roots, views)
    field = hair_field(hull, views, depths, curls, roots, normals)
    flow = hair_flow(hull, field, roots, curly=curls.radius > 0.0)
    true = sample_strands_evenly(load_strands(folder / "truth.npz"))
    at, inside = hull.grid.locate(true.points)
    inside &= hull.hair[at]
    cosine = (field.direction[at] * true.directions).sum(axis=1)
    along = inside & (np.abs(cosine) > RIGHT)
    against = along & (cosine * (field.direction[at] * flow[at]).sum(axis=1) < 0.0)
    return Shares(
        float(inside.mean()),
        float(along.sum() / inside.sum()),
        float(against.sum() / along.sum()),
    )


if __name__ == "__main__":
    main()
