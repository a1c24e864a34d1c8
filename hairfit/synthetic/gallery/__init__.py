"""A gallery of named hairstyles as hair trees, built by the model's own operations.

"Providing a gallery of rough style templates would greatly speed up the production of
various hairstyles" [Kim02, section 4.9]. Figures 4-24 to 4-27 show some.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp

from ...errors import InputError
from ...model import HairTree, Scalp
from . import loose, short, tied
from .base import Subject as Subject
from .base import make_subject as make_subject

BUILDERS: dict[str, Callable[[Scalp, int], HairTree]] = {
    "long-straight": loose.long_straight,
    "long-wavy": loose.long_wavy,
    "tight-curls": loose.tight_curls,
    "afro": short.afro,
    "bob": loose.bob,
    "fringe": loose.fringe,
    "parted": loose.parted,
    "pixie": short.pixie,
    "undercut": short.undercut,
    "mohawk": short.mohawk,
    "buzz-cut": short.buzz_cut,
    "dreadlocks": loose.dreadlocks,
    "ponytail": tied.ponytail,
    "pigtails": tied.pigtails,
    "braid": tied.braid,
    "bun": tied.bun,
}
GALLERY = tuple(BUILDERS)


def make_gallery_tree(
    name: str, seed: int = 0, subject: Subject | None = None
) -> HairTree:
    """Return a hairstyle of the gallery as a tree in float32, valid and off the head.

    Guides of the styles follow the head of `make_head`; for another one, transfer the
    tree (`model.transfer`).

    Args:
        name: One of `GALLERY`.
        seed: The same seed gives the same tree.
        subject: Whom to style; None for `make_subject()`.

    Raises:
        InputError: If there is no such style.
    """
    if name not in BUILDERS:
        raise InputError(
            f"the gallery has no style {name!r}; take one of {', '.join(GALLERY)}."
        )
    scalp = (make_subject() if subject is None else subject).scalp
    # Float64 makes rounding independent of the machine; what is stored is float32.
    with jax.enable_x64(True):
        exact = jax.tree.map(lambda x: jnp.asarray(x, jnp.float64), scalp)
        tree = BUILDERS[name](exact, seed)
        return jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), tree)
