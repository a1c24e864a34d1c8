"""Edit hair: figures 4-16 and 4-17 of the thesis, and the other tools.

Run `python examples/editing.py`. The first row edits the region around a control point
of one lock, which its five clusters follow; the second binds clusters to others; the
rest shows what else can be done to a cluster, on a whole hairstyle.
"""

import argparse
import functools
import pathlib

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from sheet import (
    PICTURES,
    Sheet,
    cross_sections,
    draw_curves,
    look_from,
    photograph,
)

from hairfit.capture.distance import head_field
from hairfit.model import HairTree, children, descendants, sample_strands, take
from hairfit.model.collide import push_out_tree
from hairfit.model.edit import Binding, Grip, Plane
from hairfit.model.parting import Parting, part
from hairfit.model.reflect import mirror
from hairfit.model.reshape import Curl, bend, curl, move, rotate, scale, twist
from hairfit.model.scalp import scalp_uv
from hairfit.model.stroke import attract, comb, smooth
from hairfit.model.style import resample_knots
from hairfit.model.trim import cut, lengthen
from hairfit.synthetic import make_style
from hairfit.synthetic.gallery import make_subject

SIZE = (300, 360)
BOX = {"low": (-0.08, -0.135, -0.08), "high": (0.08, 0.09, 0.06)}
CLOSE = {"low": (0.02, -0.11, -0.05), "high": (0.08, 0.05, 0.02)}
LOCK, AXIS = 18, 0  # root clusters: over the left ear, and at the back
YELLOW, RED, GREEN = "#e0b000", "#e02020", "#20a040"
ACROSS = (-0.08, 0.08, -0.04, 0.04, 0.0)  # strokes of a comb
X, Y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])


def view(azimuth_deg: float, box=BOX, elevation_deg: float = 8.0):
    """Return a camera from a side."""
    return look_from(azimuth_deg, elevation_deg, SIZE, **box)


def hair(tree: HairTree, strands: int) -> np.ndarray:
    """Return strands of a tree."""
    return np.asarray(sample_strands(tree, strands, 40, jax.random.key(0)))


def off_the_head(tree: HairTree) -> HairTree:
    """Return the tree with its skeletons out of the head."""
    return push_out_tree(field(), tree, 0.004)


@functools.cache
def field():
    """Return the distances around the head."""
    return head_field(make_subject().head)


def lock(tree: HairTree) -> HairTree:
    """Return one root cluster with what is below it, as cluster 0."""
    keep = np.zeros(tree.count, bool)
    keep[[LOCK, *descendants(tree, LOCK)]] = True
    return take(tree, keep)


def region(sheet: Sheet, tree: HairTree, strands: int) -> None:
    """Add figure 4-16: a control point of a high-level cluster, and what follows."""
    camera, knot = view(60.0, CLOSE), 9
    grip = Grip(knot=knot, reach=6.0)
    one = lock(tree)
    turned = twist(one, 0, 1.5 * np.pi, grip)
    for title, edited in (
        ("4-16 a: a control point of a lock", one),
        ("4-16 b: moved", move(one, 0, np.array([0.03, 0.02, 0.07]), grip)),
        ("4-16 c: scaled", scale(one, 0, (2.6, 2.6), grip)),
        ("4-16 d: twisted", turned),
    ):
        axes = sheet.add(title, photograph(hair(edited, strands), camera))
        around = cross_sections(edited, 0)
        draw_curves(axes, around[1::2], camera, color=GREEN, lw=0.8)
        skeletons = np.asarray(edited.cylinder.skeleton)
        draw_curves(axes, skeletons[:1], camera, color=YELLOW, lw=1.6)
        mark(axes, skeletons[0, knot], camera)


def mark(axes: Axes, p: np.ndarray, camera) -> None:
    """Draw a circle around a point of the world."""
    pixel = np.asarray(camera.project(jnp.asarray(p)).pixel)
    axes.plot(*pixel, "o", ms=13, mfc="none", mec="#2060ff", mew=1.6)


def binding(sheet: Sheet, tree: HairTree) -> None:
    """Add figure 4-17: clusters that follow another than their parent."""
    camera = view(60.0)
    tied = Grip(binder_of={16: LOCK})
    bent = bend(tree, LOCK, np.array([0.0, 0.0, 1.0]), 1.3, (0.3, 0.9), tied)
    for title, now in (
        ("4-17 a: red is bound to yellow", tree),
        ("... and follows when that is bent", bent),
    ):
        skeletons(sheet, title, now, camera, {LOCK: YELLOW, 16: RED})

    tree, camera, chosen = resample_knots(tree, 48), view(170.0), tuple(range(16, 48))
    ends = {2: Binding(AXIS, chosen), 12: Binding(AXIS, chosen)}
    wound = twist(tree, AXIS, 7.0 * np.pi, Grip(binder_of=ends))
    for title, now in (
        (
            "4-17 b: the red points are bound",
            tree,
        ),
        ("... and wind round the yellow", wound),
    ):
        colours = {AXIS: YELLOW, 2: GREEN, 12: GREEN}
        axes = skeletons(sheet, title, now, camera, colours)
        for index in ends:
            p = np.asarray(now.cylinder.skeleton[index])[list(chosen)]
            draw_curves(axes, p[:, None], camera, color=RED, marker="o", ms=2)


def skeletons(sheet: Sheet, title: str, tree: HairTree, camera, colours) -> Axes:
    """Add the head with the skeletons of some clusters."""
    axes = sheet.add(title, photograph(np.zeros((0, 2, 3)), camera))
    for index, colour in colours.items():
        below = [index, *descendants(tree, index)]
        curves = np.asarray(tree.cylinder.skeleton)
        draw_curves(axes, curves[below], camera, color=colour, lw=0.6, alpha=0.6)
        draw_curves(axes, curves[index][None], camera, color=colour, lw=2.2)
    return axes


def tools(sheet: Sheet, tree: HairTree, wavy: HairTree, strands: int) -> None:
    """Add what else can be done, to all root clusters of a hairstyle."""
    roots = children(tree, -1)
    parted = off_the_head(part(tree, middle(), Parting(0.05, 0.06, 0.8)))
    bob = cut(tree, roots, Plane((0.0, -0.05, 0.0), -Y - 0.5 * X))
    strokes = [
        [(x, 0.12, 0.09), (1.3 * x, 0.1, -0.04), (x, 0.0, -0.13)] for x in ACROSS
    ]
    combed = functools.reduce(
        lambda t, s: comb(t, roots, jnp.asarray(s), 0.07, 0.9), strokes, tree
    )
    tail = jnp.asarray([(0.0, 0.05, -0.13), (0.0, -0.05, -0.15), (0.0, -0.3, -0.15)])
    drawn = attract(tree, roots, tail, 0.8)
    lifted = tree
    for index in roots.tolist():
        side = np.sign(tree.cylinder.skeleton[index, -1, 0])
        lifted = rotate(lifted, index, np.array([0.0, 0.0, 1.0]), 0.45 * float(side))
    curls = curl(resample_knots(tree, 32), roots, Curl(0.012, 0.055, start=0.25))
    for title, azimuth, now in (
        ("a hairstyle", 35.0, tree),
        ("bend: ends turned out", 35.0, flipped(tree)),
        ("curl", 35.0, curls),
        ("cut by a slanting plane", 0.0, bob),
        ("mirror", 0.0, mirror(bob)),
        ("lengthen", 35.0, lengthen(tree, roots, 1.4)),
        ("comb: strokes to the back", 65.0, off_the_head(combed)),
        ("part along the middle", 20.0, parted),
        ("attract to a curve behind", 100.0, off_the_head(drawn)),
        ("rotate: lifted at the roots", 0.0, lifted),
        ("wavy hair", 35.0, wavy),
        ("... smoothed", 35.0, smooth(wavy, np.arange(wavy.count), rounds=12)),
    ):
        camera = view(azimuth, elevation_deg=40.0 if now is parted else 8.0)
        sheet.add(title, photograph(hair(now, strands), camera))


def middle() -> np.ndarray:
    """Return a line on the scalp, from the brow to the crown."""
    z = np.linspace(0.09, -0.06, 5)
    p = jnp.asarray(np.stack([0.005 + 0.0 * z, 0.11 + 0.0 * z, z], 1), jnp.float32)
    return np.asarray(jax.vmap(scalp_uv, (None, 0))(make_subject().scalp, p))


def flipped(tree: HairTree) -> HairTree:
    """Return hair whose ends are turned away from the head."""
    for index in children(tree, -1).tolist():
        out = np.asarray(tree.cylinder.skeleton[index, -1]) * (X + np.array([0, 0, 1]))
        axis = np.cross(-Y, out)
        tree = bend(tree, index, axis.astype(np.float32), 1.9, (0.6, 1.0))
    return tree


def main(out: pathlib.Path, strands: int = 5000) -> None:
    """Write the sheet."""
    tree = make_style("straight", 0, make_subject().scalp)
    sheet = Sheet(5, 4, SIZE)
    region(sheet, tree, strands // 4)
    binding(sheet, tree)
    tools(sheet, tree, make_style("wavy", 0, make_subject().scalp), strands)
    sheet.save(out)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=pathlib.Path, default=PICTURES / "editing.jpg")
    main(parser.parse_args().out)
