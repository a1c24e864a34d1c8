"""Whether clusters that are said to be certain are right more often.

Run `python benchmarks/confidence.py [RESULT ...] [--strands 3000]`. A result is a
folder of `hairfit fit` whose capture has a `truth.npz`; without any, styles are drawn
and fitted as drafts. Confidence is computed anew, for results of any age.

A point of recovered hair is right if true hair lies within 3 mm and runs within 30
degrees of it. Printed are the shares of right points in the thirds of the clusters from
the most to the least certain, and in ten bins of clusters what is predicted beside what
is: the share of right points; the distance and the angle to the nearest true hair, each
as a standard deviation in one of the two directions across, which of two Gaussian
directions is the median of their length divided by 1.177.
"""

import argparse
import pathlib
import tempfile
import time
from collections.abc import Iterator
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial import KDTree

from hairfit.capture import load_capture
from hairfit.capture.capture import Capture, require_for_fit
from hairfit.capture.orientation import estimate_orientation
from hairfit.evaluate.match import find_matches
from hairfit.evaluate.sample import sample_strands_evenly
from hairfit.fit import FitConfig, fit_capture
from hairfit.fit.confidence import with_confidence
from hairfit.fit.samples import Samples
from hairfit.io.tree import load_tree
from hairfit.model import HairTree, TreeConfidence, sample_hair
from hairfit.model.tree import leaves
from hairfit.render import mesh_depth
from hairfit.report.result import captured_from, read_report
from hairfit.synthetic import Scene, make_head, make_scalp, make_style, write_capture
from hairfit.types import Strands

STYLES = ("straight", "wavy", "ponytail")
RIGHT = (3e-3, 30.0)
MEDIAN_LENGTH = 1.1774
POINTS, SPACING = 40, 2e-3
FEWEST = 50  # points of a cluster that is counted


class Case(NamedTuple):
    """A recovered tree, and the capture that it is recovered from."""

    name: str
    capture: Capture
    tree: HairTree


class Found(NamedTuple):
    """What a tree says of its clusters, and what is: shares, millimetres, degrees."""

    chance: np.ndarray
    right: np.ndarray
    place: np.ndarray
    distance: np.ndarray
    way: np.ndarray
    angle: np.ndarray
    photographed: np.ndarray
    points: np.ndarray


def main() -> None:
    """Print what was found of every result."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("results", nargs="*", type=pathlib.Path)
    parser.add_argument("--strands", type=int, default=3000)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        cases = fitted(given.results) if given.results else drawn(pathlib.Path(folder))
        for case in cases:
            measure(case, given.strands)


def fitted(results: list[pathlib.Path]) -> Iterator[Case]:
    """Load results and their captures."""
    for folder in results:
        source = captured_from(folder)
        if source is None or not (source / "truth.npz").is_file():
            raise SystemExit(f"the capture of '{folder}' is gone, or has no truth.npz.")
        capture = load_capture(source, read_report(folder)["views"])
        yield Case(folder.name, capture, load_tree(folder / "tree.hairtree"))


def drawn(folder: pathlib.Path) -> Iterator[Case]:
    """Draw hairstyles and fit them."""
    head = make_head()
    for style in STYLES:
        scene = Scene(8, (288, 384), strands=6000)
        tree = make_style(style, 0, make_scalp(head))
        write_capture(tree, head, folder / style, scene)
        capture = load_capture(folder / style)
        yield Case(style, capture, fit_capture(capture, FitConfig("draft")).tree)


def measure(case: Case, strands: int) -> None:
    """Print how far the confidence of one tree is true."""
    head, views = require_for_fit(case.capture), case.capture.views
    hair = sample_hair(case.tree, strands, POINTS, jax.random.key(1))
    samples = Samples(jnp.asarray(hair.uv), jnp.asarray(hair.owner))
    depths = [mesh_depth(head, view.camera) for view in views]
    maps = [estimate_orientation(view.image, view.hair) for view in views]
    start = time.perf_counter()
    tree = with_confidence(case.tree, samples, views, depths, maps)
    taken = time.perf_counter() - start
    assert tree.confidence is not None
    owner, grown = np.asarray(hair.owner), np.asarray(hair.strands)
    found = compare(tree, tree.confidence, owner, grown, case.capture.folder)
    print(
        f"{case.name}: {len(found.right)} leaves, {len(views)} views, {taken:.1f} s, "
        f"{share(found, np.arange(len(found.right))):.1f} % right, photographed "
        f"{100 * np.average(found.photographed, weights=found.points):.0f} %"
    )
    order = np.argsort(-found.chance, kind="stable")
    thirds = [share(found, part) for part in np.array_split(order, 3)]
    print("  thirds, right:   " + " ".join(f"{third:.1f} %" for third in thirds))
    bins("chance/right, %", 100 * found.chance, 100 * found.right, -1, found.points)
    bins("place/distance, mm", found.place, found.distance, 1, found.points)
    bins("way/angle, degrees", found.way, found.angle, 1, found.points)


def compare(
    tree: HairTree,
    said: TreeConfidence,
    owner: np.ndarray,
    strands: np.ndarray,
    folder: pathlib.Path,
) -> Found:
    """Return what is said of each leaf beside what is."""
    points = sample_strands_evenly(Strands.from_array(strands), SPACING)
    with np.load(folder / "truth.npz") as file:
        truth = sample_strands_evenly(Strands(file["points"], file["offsets"]))
    right = find_matches(points, truth, (RIGHT,)).unsigned[0]
    distance, nearest = KDTree(truth.points).query(points.points)
    cosine = np.abs(np.sum(points.directions * truth.directions[nearest], axis=1))
    angle = np.degrees(np.arccos(np.minimum(cosine, 1.0)))
    cluster = owner[points.strand]
    count = np.bincount(cluster, minlength=tree.count)
    some = leaves(tree)[count[leaves(tree)] >= FEWEST]
    own = [np.flatnonzero(cluster == leaf) for leaf in some]

    def sigma(values: np.ndarray) -> np.ndarray:
        return np.array([np.median(values[one]) for one in own]) / MEDIAN_LENGTH

    radius, degrees = RIGHT
    return Found(
        np.asarray(said.chance(radius, np.radians(degrees)))[some],
        np.array([right[one].mean() for one in own]),
        1e3 * np.asarray(said.sigma_position)[some],
        1e3 * sigma(distance),
        np.degrees(np.asarray(said.sigma_angle))[some],
        sigma(angle),
        np.asarray(said.photographed)[some],
        count[some],
    )


def share(found: Found, part: np.ndarray) -> float:
    """Return the share of right points in some clusters, in per cent."""
    return 100 * float(np.average(found.right[part], weights=found.points[part]))


def bins(
    name: str, said: np.ndarray, true: np.ndarray, sign: int, points: np.ndarray
) -> None:
    """Print the means of what is said and of what is in ten bins, surest first."""
    pairs = []
    for part in np.array_split(np.argsort(sign * said, kind="stable"), 10):
        if len(part):
            both = [np.average(x[part], weights=points[part]) for x in (said, true)]
            pairs.append("/".join(f"{value:.2g}" for value in both))
    print(f"  {name:<19}" + " ".join(f"{pair:>9}" for pair in pairs), flush=True)


if __name__ == "__main__":
    main()
