"""A hairstyle on another head: section 4.10 of the thesis.

Run `python examples/transfer.py [--out FILE] [--head MESH]`. Styles of the head of
`hairfit synth` are transferred to another one: by default its own, made wider and
longer in the face. Beside it, what comes of new roots alone.
"""

import argparse
import pathlib
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, UInt8
from sheet import PICTURES, Sheet, look_from

from hairfit.capture.distance import head_field
from hairfit.capture.scalp_wrap import wrap_scalp
from hairfit.io.mesh import load_mesh
from hairfit.model import HairTree, Scalp, sample_strands, scalp_point
from hairfit.model.collide import DistanceField, push_out_strands
from hairfit.model.warp import align_scalp, transfer
from hairfit.render.camera import Camera
from hairfit.report.drawing import draw_hair
from hairfit.synthetic import make_style
from hairfit.synthetic.gallery import make_subject
from hairfit.types import Mesh

OUT = PICTURES / "transfer.jpg"
SIZE = (380, 440)
GAP = 0.002


class OtherHead(NamedTuple):
    """A head that a style is transferred to.

    Attributes:
        mesh: The head.
        scalp: Its scalp.
        from_points: Points on the head of `subject` that are known on it too.
        to_points: These points on it.
    """

    mesh: Mesh
    scalp: Scalp
    from_points: Float[np.ndarray, "points 3"] | None = None
    to_points: Float[np.ndarray, "points 3"] | None = None


def deform(p: Float[np.ndarray, "*points 3"]) -> Float[np.ndarray, "*points 3"]:
    """Return points of the head made wider above, longer below, flatter behind."""
    x, y, z = np.moveaxis(np.asarray(p, float), -1, 0)
    above = 1.0 / (1.0 + np.exp(-y / 0.03))
    wide = 1.08 + 0.30 * above
    tall = np.where(y > 0.0, 1.05, 1.25)
    deep = np.where(z < 0.0, 0.82, 1.0)
    return np.stack([wide * x, tall * y, deep * z], axis=-1)


def deformed_head() -> OtherHead:
    """Return the head of `subject`, deformed; its face and neck are landmarks."""
    head, scalp = make_subject()
    control = jnp.asarray(deform(np.asarray(scalp.control)), scalp.control.dtype)
    low = head.vertices[head.vertices[:, 1] < -0.02][::6]
    mesh = Mesh(deform(head.vertices), head.faces)
    return OtherHead(mesh, Scalp(control), low, deform(low))


def roots_alone(tree: HairTree, scalp: Scalp) -> HairTree:
    """Return the tree moved to the roots that it has on another scalp, no more."""
    root = jax.jit(jax.vmap(scalp_point, (None, 0)))(scalp, tree.contour.centre)
    shift = root - tree.cylinder.skeleton[:, 0]
    skeleton = tree.cylinder.skeleton + shift[:, None]
    return eqx.tree_at(
        lambda t: (t.scalp, t.cylinder.skeleton), tree, (scalp, skeleton)
    )


def picture(
    tree: HairTree,
    head: Mesh,
    field: DistanceField | None,
    camera: Camera,
    strands: int,
) -> UInt8[np.ndarray, "height width 3"]:
    """Return a picture of a tree on a head, its strands kept out of it if wanted."""
    hair = sample_strands(tree, strands, 64, jax.random.key(1))
    if field is not None:
        hair = push_out_strands(field, hair, GAP)
    return draw_hair(np.asarray(hair, np.float64), head, [camera])[0]


def main(
    out: pathlib.Path = OUT,
    strands: int = 16000,
    other: OtherHead | None = None,
    styles: tuple[str, ...] = ("straight", "ponytail"),
) -> None:
    """Write the picture.

    Args:
        out: Where to.
        strands: Number of strands.
        other: The other head.
        styles: Names of styles of `hairfit synth`; one row each.
    """
    other = deformed_head() if other is None else other
    head, scalp = make_subject()
    fields = head_field(head), head_field(other.mesh)
    sheet = Sheet(len(styles), 3, SIZE)
    for style, azimuth in zip(styles, (28.0, 120.0), strict=False):
        low, high = (-0.08, -0.17, -0.08), (0.08, 0.11, 0.08)
        camera = look_from(azimuth, 8.0, SIZE, low, high)
        tree = make_style(style, 0, scalp)
        shot = picture(tree, head, fields[0], camera, strands)
        sheet.add(f"4.10: {style} hair on its own head", shot)
        shot = picture(
            roots_alone(tree, other.scalp), other.mesh, None, camera, strands
        )
        sheet.add(f"{style} hair: its roots alone moved", shot)
        moved = transfer(
            tree,
            other.scalp,
            from_points=other.from_points,
            to_points=other.to_points,
            field=fields[1],
            gap=GAP,
        )
        shot = picture(moved, other.mesh, fields[1], camera, strands)
        sheet.add(f"{style} hair transferred", shot)
    sheet.save(out)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Transfer hair to another head.")
    parser.add_argument("--out", type=pathlib.Path, default=OUT)
    parser.add_argument("--head", type=pathlib.Path, help="another head, in metres")
    given = parser.parse_args()
    target = None
    if given.head is not None:
        mesh = load_mesh(given.head)
        scalp = align_scalp(wrap_scalp(mesh), make_subject().scalp)
        target = OtherHead(mesh, scalp)
    main(given.out, other=target)
