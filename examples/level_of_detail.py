"""Draw hair in less detail: strands, segments, opacity and cuts (figure 4-23).

Run `python examples/level_of_detail.py`. The first row trades strands and segments for
opacity, the second one clusters for distance.
"""

import argparse
import dataclasses
import pathlib

import jax
import numpy as np
from sheet import PICTURES, Sheet, look_from

from hairfit.model import HairTree, leaves, sample_strands
from hairfit.model.detail import (
    Detail,
    cut_by_width,
    segments_needed,
    tree_of_cut,
    with_strands,
)
from hairfit.render.camera import Camera
from hairfit.render.scene import HairLook
from hairfit.render.studio import preview_scene
from hairfit.report.drawing import draw_preview
from hairfit.synthetic import STYLES, make_style
from hairfit.synthetic.gallery import make_subject

SEGMENTS_FEW = 20


def draw(strands: np.ndarray, camera: Camera, detail: Detail) -> np.ndarray:
    """Return a picture of hair in some detail.

    Args:
        strands: The strands.
        camera: The camera.
        detail: How opaque and wide the strands are.
    """
    # One strand stands for several, as heads have 100 000 hairs.
    look = HairLook(width=3.0 * detail.width, alpha=detail.opacity)
    scene = preview_scene(np.asarray(strands, np.float64), make_subject().head)
    return draw_preview(dataclasses.replace(scene, look=look), [camera])[0]


def by_strands(sheet: Sheet, tree: HairTree, camera: Camera, fine: Detail) -> None:
    """Add the panels of fewer strands and segments."""
    key = jax.random.key(0)
    hair = np.asarray(sample_strands(tree, fine.strands, fine.segments + 1, key))
    few = with_strands(fine, max(fine.strands // 4, 1))
    step = fine.segments // SEGMENTS_FEW
    levels = ((fine, hair), (few, hair[: few.strands, ::step]))
    for detail, strands in levels:
        count, points, _ = strands.shape
        title = (
            f"Figure 4-23 (a): {count} strands, {points - 1} segments, "
            f"alpha {detail.opacity:.1f}"
        )
        sheet.add(title, draw(strands, camera, detail))


def by_segments(sheet: Sheet, camera: Camera, strands: int) -> None:
    """Add a graph of the segments that hairstyles need in pictures of many sizes."""
    matrix = np.asarray(camera.K @ camera.cam_from_world[:3])
    axes = sheet.add("Segments that keep 95 % of the strands within half a pixel", None)
    sizes = camera.height / 2.0 ** np.arange(-2, 5)
    for style in STYLES:
        tree = make_style(style, 3, make_subject().scalp)
        hair = np.asarray(sample_strands(tree, strands, 321, jax.random.key(0)))
        # Half a pixel of a picture of that size, in pixels of this one.
        errors = 0.5 * camera.height / sizes
        needed = [segments_needed(hair, matrix, float(error)) for error in errors]
        axes.plot(sizes, np.quantile(needed, 0.95, axis=1), "o-", label=style)
    axes.set_xscale("log", base=2)
    axes.set_yscale("log", base=2)
    axes.set_xlabel("height of the picture in pixels", fontsize=7)
    axes.set_ylabel("segments", fontsize=7)
    axes.tick_params(labelsize=6)
    axes.legend(fontsize=7)


def by_clusters(sheet: Sheet, tree: HairTree, camera: Camera, fine: Detail) -> None:
    """Add the panels of cuts through the tree."""
    matrix = np.asarray(camera.K @ camera.cam_from_world[:3])
    for pixels in (5.0, 60.0, 1000.0):
        few = tree_of_cut(tree, cut_by_width(tree, matrix, pixels))
        key = jax.random.key(0)
        hair = np.asarray(sample_strands(few, fine.strands, fine.segments + 1, key))
        title = f"Cut at {pixels:.0f} pixels: {len(leaves(few))} leaf clusters"
        sheet.add(title, draw(hair, camera, fine))


def main(out: pathlib.Path, strands: int = 20_000) -> None:
    """Write the sheet.

    Args:
        out: The picture.
        strands: Number of strands in full detail.
    """
    low, high = (-0.08, -0.14, -0.10), (0.08, 0.12, 0.09)
    camera = look_from(50.0, low=low, high=high)
    tree = make_style("curly", 3, make_subject().scalp)
    fine = Detail(strands, 3 * SEGMENTS_FEW, 0.3, 1e-4)
    sheet = Sheet(2, 3)
    by_strands(sheet, tree, camera, fine)
    by_segments(sheet, camera, max(strands // 20, 1))
    by_clusters(sheet, tree, camera, fine)
    sheet.save(out)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    default = PICTURES / "level_of_detail.jpg"
    parser.add_argument("--out", type=pathlib.Path, default=default)
    main(parser.parse_args().out)
