"""Editing any cluster of a tree: all below it follow, and all that is bound to it."""

import dataclasses
import functools
import operator
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .bind import follow
from .cylinder import GeneralizedCylinder
from .tree import HairTree, cluster

# Followers are padded to a power of 2, at least to this: few programs are compiled.
FEWEST = 8


class Binding(NamedTuple):
    """To what a cluster is bound instead of its parent [Kim02, figure 4-17].

    Attributes:
        binder: Index of the cluster that it follows.
        knots: The control points that follow; None for all (temporary binding), some
            for local binding.
    """

    binder: int
    knots: Sequence[int] | None = None


Bindings = Mapping[int, Binding | int]


@dataclasses.dataclass(frozen=True)
class Grip:
    """What an edit takes hold of, and who follows.

    Attributes:
        knot: The control point that the user has picked; None for the whole cluster.
        reach: How many knots to either side of it the edit falls off to nothing.
        binder_of: Temporary and local bindings; see `edit_cluster`.
        whole_skeleton: How clusters follow; see `bind.follow`.
    """

    knot: int | float | None = None
    reach: float | int = 2.0
    binder_of: Bindings | None = None
    whole_skeleton: bool = False

    def weights(self, knots: int) -> Float[np.ndarray, " knots"]:
        """Return by how much each control point takes part, from 0 to 1.

        Raises:
            ValueError: If the reach is not positive, or there is no such knot.
        """
        if not self.reach > 0.0:
            raise ValueError(f"the reach of an edit is positive, got {self.reach}.")
        if self.knot is None:
            return np.ones(knots)
        if not 0.0 <= self.knot <= knots - 1:
            raise ValueError(
                f"there is no control point {self.knot}; they go from 0 to {knots - 1}."
            )
        apart = np.abs(np.arange(knots) - self.knot) / self.reach
        rest = np.clip(1.0 - apart, 0.0, 1.0)
        return rest * rest * (3.0 - 2.0 * rest)


class Plane(NamedTuple):
    """A plane in the world.

    Attributes:
        point: A point of it, in metres.
        normal: Its normal, of any length.
    """

    point: Sequence[float] | Array | np.ndarray
    normal: Sequence[float] | Array | np.ndarray


WHOLE = Grip()


def edit_cluster(
    tree: HairTree,
    index: int,
    cylinder: GeneralizedCylinder,
    binder_of: Bindings | None = None,
    *,
    whole_skeleton: bool = False,
) -> HairTree:
    """Return the tree in which a cluster has another cylinder and others follow it.

    All descendants, not only children, are bound to the cluster as it was and updated
    with it as it is [Kim02, section 4.6.1]; see `bind.follow`. Scalp contours do not
    change, so that the control point on the scalp stays for all that follow: their
    roots are where they were.

    The same goes for clusters that are bound to it, or to a cluster that follows it,
    instead of to their parents, and for all below them: temporary binding, until the
    user leaves them out. A cluster of which only some control points are bound follows
    with these alone (local binding); what is below it then follows itself.

    Differentiable in the arrays of the tree and in the cylinder; which cluster follows
    which is decided outside `jit`.

    Args:
        tree: The tree.
        index: The cluster that is edited.
        cylinder: Its new cylinder, with as many knots as before.
        binder_of: What is bound elsewhere than to its parent, by cluster.
        whole_skeleton: How clusters follow; see `bind.follow`.

    Raises:
        ValueError: If there is no such cluster, the number of knots differs, or the
            bindings go round in a circle.
    """
    check_cluster(tree, index)
    knots, given = tree.cylinder.skeleton.shape[1], cylinder.skeleton.shape[0]
    if given != knots:
        raise ValueError(
            f"the new cylinder has {given} knots and the tree {knots}; resample the "
            "skeleton first."
        )
    bound = binders(tree, binder_of or {})
    before = tree.cylinder
    after = replace_cluster(before, jnp.asarray(index, jnp.int32), cylinder)
    waiting = [index]
    while waiting:
        edited = waiting.pop()
        groups = followers(bound, edited)
        waiting += [i for i, part in groups.items() if part.knots is not None]
        many = np.array(sorted(groups), np.int32)
        if not len(many):
            continue
        held = np.zeros((len(many), knots), bool)
        held[:, 0] = True
        for row, i in enumerate(many):
            chosen = groups[i].knots
            if chosen is not None:
                held[row] |= ~np.isin(np.arange(knots), np.asarray(chosen, int))
        size = max(FEWEST, 1 << (len(many) - 1).bit_length())
        some = jnp.asarray(np.resize(many, size))  # repeats some, which does no harm
        fixed = jnp.asarray(np.resize(held, (size, knots)))
        one = jnp.asarray(edited, some.dtype)
        after = follow_among(before, after, one, some, fixed, whole_skeleton)
    return eqx.tree_at(lambda t: t.cylinder, tree, after)


def edit_each(
    tree: HairTree,
    index: int | Sequence[int] | np.ndarray,
    change: Callable[[GeneralizedCylinder], GeneralizedCylinder],
    grip: Grip = WHOLE,
) -> HairTree:
    """Return the tree after a change of one cluster, or of several in their order.

    Args:
        tree: The tree.
        index: The cluster, or clusters.
        change: What happens to the cylinder of each.
        grip: Who follows.
    """
    for i in np.atleast_1d(np.asarray(index, int)):
        check_cluster(tree, int(i))
        new = change(cluster(tree.cylinder, int(i)))
        tree = edit_cluster(
            tree, int(i), new, grip.binder_of, whole_skeleton=grip.whole_skeleton
        )
    return tree


def check_cluster(tree: HairTree, index: int) -> None:
    """Raise if a tree has no cluster of the index."""
    if not 0 <= operator.index(index) < tree.count:
        raise ValueError(
            f"there is no cluster {index}; the tree has clusters 0 to {tree.count - 1}."
        )


def binders(tree: HairTree, binder_of: Bindings) -> list[Binding]:
    """Return what each cluster of a tree is bound to, its parent if nothing is said.

    Raises:
        ValueError: If there is no such cluster or control point, or bindings go round
            in a circle.
    """
    knots = tree.cylinder.skeleton.shape[1]
    bound = [Binding(parent) for parent in tree.parent]
    for index, binding in binder_of.items():
        if not isinstance(binding, Binding):
            binding = Binding(binding)
        check_cluster(tree, index)
        check_cluster(tree, binding.binder)
        if not set(binding.knots or ()) <= set(range(knots)):
            raise ValueError(
                f"cluster {index} is bound with the control points "
                f"{sorted(binding.knots or ())}; they go from 0 to {knots - 1}."
            )
        bound[index] = binding
    for index in binder_of:
        above, steps = index, 0
        while above >= 0 and steps <= tree.count:
            above, steps = bound[above].binder, steps + 1
        if above >= 0:
            raise ValueError(
                f"cluster {index} would follow itself; bind it to a cluster that does "
                "not follow it."
            )
    return bound


def followers(bound: list[Binding], index: int) -> dict[int, Binding]:
    """Return the clusters that are moved with one, and how.

    Clusters below a locally bound one are not among them: they follow that one.
    """
    below: dict[int, list[int]] = {}
    for i, binding in enumerate(bound):
        below.setdefault(binding.binder, []).append(i)
    found: dict[int, Binding] = {}
    waiting = [index]
    while waiting:
        for i in below.get(waiting.pop(), []):
            found[i] = bound[i]
            if bound[i].knots is None:
                waiting.append(i)
    return found


@jax.jit
def replace_cluster(
    stacked: GeneralizedCylinder, index: Int[Array, ""], one: GeneralizedCylinder
) -> GeneralizedCylinder:
    """Return stacked clusters, one of them replaced."""
    return jax.tree.map(lambda leaf, new: leaf.at[index].set(new), stacked, one)


@functools.partial(jax.jit, static_argnames="whole_skeleton")
def follow_among(
    before: GeneralizedCylinder,
    after: GeneralizedCylinder,
    binder: Int[Array, ""],
    many: Int[Array, " some"],
    held: Bool[Array, "some knots"],
    whole_skeleton: bool,
) -> GeneralizedCylinder:
    """Return the clusters of a tree, some of which have followed one of them."""
    was, now = jax.tree.map(lambda leaf: leaf[binder], (before, after))
    bound = jax.tree.map(lambda leaf: leaf[many], before)
    there = follow(was, now, bound, whole_skeleton=whole_skeleton, held=held)
    return jax.tree.map(lambda leaf, new: leaf.at[many].set(new), after, there)
