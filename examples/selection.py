"""Choose clusters in every way of section 4.6.3 (figure 4-20).

Run `python examples/selection.py`. Contours are green and skeletons yellow, as in the
thesis; what is chosen is red.
"""

import argparse
import pathlib
from collections.abc import Iterable, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.patches import Circle, Polygon, Rectangle
from sheet import PICTURES, SIZE, Sheet, draw_curves, look_from, photograph

from hairfit.model import HairTree, cylinder_knots, leaves, select
from hairfit.render.camera import Camera
from hairfit.render.raster import mesh_depth
from hairfit.synthetic import make_style
from hairfit.synthetic.gallery import make_subject

LASSO = np.array(
    [(0.1, 0.2), (0.5, 0.05), (0.9, 0.2), (0.75, 0.5), (0.5, 0.2), (0.25, 0.5)]
)
PLAIN, CHOSEN, OTHER = ("#20c040", "#f0d020"), ("red", "#ff7070"), ("cyan", "white")


class Scene:
    """A hairstyle before a camera.

    Attributes:
        tree: The hairstyle.
        camera: The camera.
        image_from_world: The same as a matrix.
        leaves: The leaf clusters.
        contours: The contours of all clusters in the world, closed; what the head
            hides is not a number.
        skeletons: The skeletons, likewise.
        backdrop: The head, darkened.
    """

    def __init__(self, tree: HairTree, camera: Camera):
        self.tree, self.camera, self.leaves = tree, camera, leaves(tree)
        self.image_from_world = np.asarray(camera.K @ camera.cam_from_world[:3])
        theta = jnp.linspace(0.0, 2.0 * jnp.pi, 33)
        around = jax.vmap(cylinder_knots, (None, None, 0), 1)
        every = jax.jit(jax.vmap(around, (0, None, None)))
        self.contours = self.seen(np.asarray(every(tree.cylinder, 1.0, theta)))
        self.skeletons = self.seen(np.asarray(tree.cylinder.skeleton))
        self.backdrop = (0.3 * photograph(np.zeros((0, 2, 3)), camera)).astype(np.uint8)

    def panel(self, sheet: Sheet, title: str, chosen: Sequence[int] | np.ndarray):
        """Add the leaf clusters to a sheet, some of them chosen; return the axes."""
        axes = sheet.add(title, self.backdrop)
        faint = 0.35 if len(chosen) else 1.0
        self.draw(axes, np.setdiff1d(self.leaves, chosen), PLAIN, alpha=faint)
        self.draw(axes, chosen, CHOSEN)
        return axes

    def seen(self, points: np.ndarray) -> np.ndarray:
        """Return points, with those behind the head as no numbers."""
        depth = mesh_depth(make_subject().head, self.camera)
        pixel, away = select.project(self.image_from_world, points)
        column, row = (np.clip(pixel, 0.0, np.array(SIZE) - 1.0)).astype(int).T
        hidden = away > depth[row.T, column.T]
        return np.where(hidden[..., None], np.nan, points)

    def draw(self, axes, clusters: Iterable[int], colours, alpha: float = 1.0) -> None:
        """Draw contours and skeletons."""
        for index in clusters:
            for curves, colour, width in (
                (self.contours[index, 1::3], colours[0], 0.3),
                (self.skeletons[index][None], colours[1], 0.9),
            ):
                style = {"color": colour, "linewidth": width, "alpha": alpha}
                draw_curves(axes, curves, self.camera, **style)

    def pixel(self, p: np.ndarray) -> np.ndarray:
        """Return where a point of the world is in the picture."""
        return np.asarray(self.camera.project(jnp.asarray(p)).pixel)


def in_the_picture(scene: Scene, sheet: Sheet) -> None:
    """Add the panels of what is chosen in the world and in the picture."""
    tree = scene.tree
    title = f"Figure 4-20: contours and skeletons of {len(scene.leaves)} leaf clusters"
    scene.panel(sheet, title, [])
    centre, radius = np.array([0.075, -0.01, 0.03]), 0.03
    inside = select.knots_in_sphere(tree, centre, radius)
    chosen = np.intersect1d(select.clusters_of(inside), scene.leaves)
    axes = scene.panel(sheet, f"A sphere of 3 cm takes {len(chosen)}", chosen)
    rim = scene.pixel(centre + radius * np.array([0.0, 1.0, 0.0]))
    size = float(np.linalg.norm(rim - scene.pixel(centre)))
    axes.add_patch(
        Circle(tuple(scene.pixel(centre)), size, fill=False, color="white", zorder=9)
    )
    low, high = np.array([225.0, 330.0]), np.array([300.0, 420.0])
    seen = select.knots_in_rectangle(tree, scene.image_from_world, low, high)
    chosen = np.intersect1d(select.clusters_of(seen), scene.leaves)
    axes = scene.panel(sheet, f"A rectangle in the camera takes {len(chosen)}", chosen)
    axes.add_patch(
        Rectangle(tuple(low), *(high - low), fill=False, color="white", zorder=9)
    )


def on_the_scalp(scene: Scene, sheet: Sheet) -> None:
    """Add the panels of what a lasso on the scalp chooses."""
    tree = scene.tree
    chosen = np.intersect1d(select.clusters_in_polygon(tree, LASSO), scene.leaves)
    axes = sheet.add("A lasso in scalp space, by the contours' centres", None)
    angle = np.append(np.arange(32), 0) * (2.0 * np.pi / 32)
    spoke = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    offset = np.asarray(tree.contour.offset)[:, np.arange(33) % 32]
    reach = np.asarray(tree.contour.radius)[:, None] + offset
    for index in scene.leaves:
        around = tree.contour.centre[index] + reach[index][:, None] * spoke
        colour = "red" if index in chosen else "#109030"
        axes.plot(*np.asarray(around).T, color=colour, linewidth=0.8)
    axes.add_patch(Polygon(LASSO, fill=False, color="black", linewidth=1.5))
    axes.set_xlabel("u", fontsize=7)
    axes.set_ylabel("v", fontsize=7)
    axes.tick_params(labelsize=6)
    axes.set_aspect("equal")
    axes.invert_yaxis()  # the forehead is at v = 0
    scene.panel(sheet, f"The same {len(chosen)} on the head", chosen)


def on_a_walk(scene: Scene, sheet: Sheet) -> None:
    """Add the panel of a pick in the picture, and of steps through the tree."""
    tree = scene.tree
    pixel = np.array([270.0, 250.0])
    pick = select.pick_knot(tree, scene.image_from_world, pixel, 40.0, scene.leaves)
    if pick is None:
        raise ValueError(f"there is no control point near the pixel {pixel}.")
    walk = [select.next_sibling(tree, pick.cluster)]
    while walk[-1] != pick.cluster:
        walk.append(select.next_sibling(tree, walk[-1]))
    title = f"One picked at the cross, and a walk past its {len(walk) - 1} siblings"
    axes = scene.panel(sheet, title, [pick.cluster])
    scene.draw(axes, walk[:-1], OTHER)
    scene.draw(axes, walk[-1:], CHOSEN)
    axes.plot(*pixel, "+", color="white", markersize=12)


def main(out: pathlib.Path, style: str = "wavy") -> None:
    """Write the sheet.

    Args:
        out: The picture.
        style: The hairstyle of `make_style`.
    """
    low, high = (-0.075, -0.125, -0.085), (0.075, 0.105, 0.085)
    camera = look_from(40.0, 12.0, low=low, high=high)
    scene = Scene(make_style(style, 3, make_subject().scalp), camera)
    sheet = Sheet(2, 3)
    in_the_picture(scene, sheet)
    on_the_scalp(scene, sheet)
    on_a_walk(scene, sheet)
    sheet.save(out)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=pathlib.Path, default=PICTURES / "selection.jpg")
    main(parser.parse_args().out)
