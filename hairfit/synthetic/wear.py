"""Hairstyles of the gallery on other heads."""

from ..capture.distance import head_field
from ..capture.scalp_wrap import wrap_scalp
from ..model import HairTree, Scalp
from ..model.warp import align_scalp, transfer
from ..types import Mesh


def wear(tree: HairTree, head: Mesh) -> HairTree:
    """Return a hairstyle of `make_scalp`'s head on another head.

    The scalp is wrapped over the head, and the hair transferred to it and kept out of
    the head, by `model.transfer`.

    Args:
        tree: A hairstyle of the gallery.
        head: The head; +y up, +z to the face, anywhere in the world, in metres.

    Raises:
        InputError: If no scalp can be wrapped over the head.
    """
    control = align_scalp(wrap_scalp(head), tree.scalp).control
    scalp = Scalp(control.astype(tree.scalp.control.dtype))
    return transfer(tree, scalp, field=head_field(head))
