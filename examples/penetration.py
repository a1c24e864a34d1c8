"""Keep hair out of the head by the closest-point transform (figures 4-21 and 4-22).

Run `python examples/penetration.py`. The first column shows the distance field in two
planes, the others hair that was pressed into the head, and what equation (4-9) makes
of it.
"""

import argparse
import pathlib

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from sheet import PICTURES, Sheet, look_from, photograph

from hairfit.capture.distance import head_field
from hairfit.model import HairTree, sample_strands
from hairfit.model.collide import (
    DistanceField,
    field_distance,
    push_out_strands,
    push_out_tree,
)
from hairfit.synthetic import make_style
from hairfit.synthetic.gallery import make_subject

GAP = 0.001
SLAB = 0.004  # half of the thickness of the hair that a section shows
NAMES = ("x", "y", "z")


def pressed(tree: HairTree) -> HairTree:
    """Return the tree with its hair pressed sideways into head and neck."""
    skeleton = tree.cylinder.skeleton
    along = jnp.linspace(0.0, 1.0, skeleton.shape[1])[None, :, None]
    squeeze = jnp.array([0.45, 0.0, 0.35])[None, None] * jnp.minimum(2.0 * along, 1.0)
    middle = jnp.array([0.0, 0.0, -0.01])[None, None]
    pressed = middle + (1.0 - squeeze) * (skeleton - middle)
    return eqx.tree_at(lambda t: t.cylinder.skeleton, tree, pressed)


def draw_field(axes, field: DistanceField, across: int, at: float) -> list[int]:
    """Draw the field in a plane, and return the two axes of the drawing.

    Args:
        axes: Of matplotlib.
        field: The field.
        across: The axis that the plane is across.
        at: Where the plane is along it, in metres.
    """
    shown = [2, 1] if across == 0 else [0, 1]
    origin, cell = np.asarray(field.origin), float(field.cell)
    count = np.array(field.distance.shape)
    sides = [
        np.linspace(origin[i], origin[i] + (count[i] - 1) * cell - 1e-6, 240)
        for i in shown
    ]
    plane = np.full((240, 240, 3), at)
    plane[..., shown[0]], plane[..., shown[1]] = np.meshgrid(*sides)
    look = jax.jit(jax.vmap(field_distance, (None, 0)))
    found = look(field, jnp.asarray(plane.reshape(-1, 3), field.origin.dtype))
    distance = 1e3 * np.asarray(found.distance).reshape(240, 240)
    axes.contourf(*sides, distance, np.arange(-76.0, 61.0, 4.0), cmap="autumn")
    axes.contour(*sides, distance, [0.0], colors="black", linewidths=1.2)
    axes.set_aspect("equal")
    axes.set_xlabel(f"{NAMES[shown[0]]} (m)", fontsize=7)
    axes.set_ylabel(f"{NAMES[shown[1]]} (m)", fontsize=7)
    axes.tick_params(labelsize=6)
    return shown


def draw_section(axes, field: DistanceField, strands: np.ndarray) -> None:
    """Draw the field from the side, and over it the hair in the head's middle plane."""
    shown = draw_field(axes, field, 0, 0.0)
    near = np.abs(strands[..., 0]) < SLAB
    for strand, inside in zip(strands, near, strict=True):
        line = np.where(inside[:, None], strand, np.nan)[:, shown]
        axes.plot(*line.T, color="navy", linewidth=0.5)


def main(out: pathlib.Path, strands: int = 12_000) -> None:
    """Write the sheet.

    Args:
        out: The picture.
        strands: Number of strands of the hairstyle.
    """
    head, scalp = make_subject()
    field = head_field(head)
    tree = pressed(make_style("straight", 3, scalp))
    before = sample_strands(tree, strands, 60, jax.random.key(0))
    tree = push_out_tree(field, tree, GAP)
    after = sample_strands(tree, strands, 60, jax.random.key(0))
    after = push_out_strands(field, after, GAP)
    camera = look_from(50.0, low=(-0.07, -0.13, -0.09), high=(0.07, 0.10, 0.08))

    sheet = Sheet(2, 3)
    draw_field(
        sheet.add("Figure 4-21: distance from the head, from the side", None),
        field,
        0,
        0.0,
    )
    sheet.add(
        "Figure 4-22: hair pressed into the head",
        photograph(np.asarray(before), camera),
    )
    sheet.add(
        "Skeletons, then strands, moved out by (4-9)",
        photograph(np.asarray(after), camera),
    )
    draw_field(
        sheet.add("The same from the front, through the ears", None), field, 2, -0.01
    )
    draw_section(
        sheet.add("Hair within 4 mm of the middle plane, before", None),
        field,
        np.asarray(before),
    )
    draw_section(sheet.add("The same hair after (4-9)", None), field, np.asarray(after))
    sheet.save(out)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--out", type=pathlib.Path, default=PICTURES / "penetration.jpg"
    )
    main(parser.parse_args().out)
