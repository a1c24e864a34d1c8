"""Combed hair as the detail of a cluster of a tree."""

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray, ScalarLike, UInt32

from .combing import Comb, comb_repeatedly
from .contour import contour_radius
from .curve import EXACT
from .cylinder import GeneralizedCylinder, cylinder_frames
from .ownership import LocalCoordinates
from .section import section_maps
from .shell import ShellGrid, ShellHair, even_hair
from .tree import HairTree, ScalpContour, cluster, leaves
from .vector import norm, unit
from .wisp import Wisps


@dataclasses.dataclass(frozen=True)
class CombedShell:
    """How a cluster is taken for a thin shell.

    Attributes:
        columns: Cells across the comb's way, as those of `ShellGrid`.
        layers: Cells along the depth.
        angle: Where in the contour the outermost hair lies, which the comb enters
            first, in radians; None for the side away from the head, `outward_angle`.
    """

    columns: int = 12
    layers: int = 10
    angle: float | None = None


def comb_cluster(
    tree: HairTree,
    index: int,
    comb: Comb | Sequence[Comb],
    key: PRNGKeyArray | UInt32[Array, " 2"],
    count: int,
    shell: CombedShell = CombedShell(),
) -> HairTree:
    """Return a tree in which the hair of one leaf cluster is combed.

    The contour's plane is the cross-section of a thin shell: the square of (s, u) goes
    to the unit disc without a change of area, the disc to the contour, and t runs along
    the knots. Combing moves the strands in the square, so all of them stay in the
    contour; what it moves them by becomes the cluster's wisps. Strands that grow from
    the tree take the displacement of the nearest wisp of their cluster.

    Wisps that the cluster had are replaced. Runs outside `jit`.

    Args:
        tree: The tree.
        index: A leaf cluster.
        comb: The comb, or several for one stroke each.
        key: Randomness.
        count: Number of wisps: strands that are combed.
        shell: How the cluster is taken for a shell.

    Raises:
        ValueError: If the cluster has children, or no wisp is wanted.
    """
    if index not in leaves(tree):
        raise ValueError(
            f"cluster {index} is no leaf, and only leaves own strands; comb one of "
            "the clusters below it."
        )
    if count < 1:
        raise ValueError(f"combing needs at least 1 strand, got {count}.")
    contour, cylinder = cluster(tree.contour, index), cluster(tree.cylinder, index)
    knots, dtype = cylinder.skeleton.shape[0], cylinder.skeleton.dtype
    angle = outward_angle(tree, index) if shell.angle is None else shell.angle

    grid = ShellGrid(shell.columns, knots, shell.layers)
    even_key, comb_key = jax.random.split(key)
    hair = even_hair(count, grid, even_key)
    t = jnp.linspace(0.0, 1.0, knots, dtype=dtype)
    hair = ShellHair(hair.s.astype(dtype), hair.u.astype(dtype), t)
    combs = [comb] if isinstance(comb, Comb) else list(comb)
    combs = jax.tree.map(lambda leaf: leaf.astype(dtype), combs)
    combed = comb_repeatedly(hair, combs, grid, comb_key)
    turn = jnp.asarray(angle - 0.5 * np.pi, dtype)
    uv = shell_roots(contour, hair, turn)
    offset = combed_offsets(cylinder, hair, combed, turn)
    return with_cluster_wisps(tree, index, uv, offset)


def square_to_disc(s: Float[Array, ""], u: Float[Array, ""]) -> LocalCoordinates:
    """Return the place in the unit disc of a point of the unit square.

    Squares about the middle become circles, and areas stay in proportion [Shirley and
    Chiu 1997, A low distortion map between disk and square]. u runs towards a quarter
    turn from the zero angle.
    """
    a, b = 2.0 * s - 1.0, 2.0 * u - 1.0
    flat = jnp.abs(a) >= jnp.abs(b)
    r = jnp.where(flat, a, b)
    some = jnp.where(r == 0.0, 1.0, r)
    eighth = 0.25 * jnp.pi
    theta = jnp.where(flat, eighth * b / some, 2.0 * eighth - eighth * a / some)
    # Negative where it lies on the other side of the middle.
    theta = jnp.where(r < 0.0, theta + jnp.pi, theta)
    return LocalCoordinates(jnp.abs(r), jnp.mod(theta, 2.0 * jnp.pi))


def contour_place(
    radius: Float[Array, ""],
    offset: Float[Array, " 32"],
    s: Float[Array, ""],
    u: Float[Array, ""],
    turn: ScalarLike,
) -> Float[Array, " 2"]:
    """Return the point of a contour's plane for a point of the unit square.

    Args:
        radius: Global radius of the contour.
        offset: Its offsets.
        s: The point.
        u: The same.
        turn: How far the square is turned in the plane, in radians.
    """
    r, theta = square_to_disc(s, u)
    theta = theta + turn
    reach = r * contour_radius(radius, offset, theta)
    return reach * jnp.stack([jnp.cos(theta), jnp.sin(theta)])


@jax.jit
def shell_roots(
    contour: ScalpContour, hair: ShellHair, turn: ScalarLike
) -> Float[Array, "strands 2"]:
    """Return where on the scalp the strands of a cluster's shell are rooted."""
    place = jax.vmap(contour_place, (None, None, 0, 0, None))
    around = place(contour.radius, contour.offset, hair.s[:, 0], hair.u[:, 0], turn)
    return contour.centre[None] + around


@jax.jit
def combed_offsets(
    cylinder: GeneralizedCylinder,
    before: ShellHair,
    after: ShellHair,
    turn: ScalarLike,
) -> Float[Array, "strands knots 3"]:
    r"""Return the offsets of wisps that say how combing moved strands, in metres.

    By (4-4) a point q of the contour's plane lies at $L\,Rot(W)\,q$ along normal and
    binormal, with L = [[S_N, H], [0, S_B]]. Wisps are turned by the twist but not
    mapped by L, so that a displacement d of the plane is the offset
    $Rot(-W)\,L\,Rot(W)\,d$. It is 0 at the root.

    Args:
        cylinder: The cluster.
        before: The strands of its shell, one row a knot.
        after: The same strands combed.
        turn: How far the shell is turned in the contour's plane, in radians.
    """
    cos, sin = jnp.cos(cylinder.twist), jnp.sin(cylinder.twist)
    back = jnp.stack([jnp.stack([cos, sin], -1), jnp.stack([-sin, cos], -1)], -2)
    maps = jnp.matmul(back, section_maps(cylinder), precision=EXACT)
    at_knots = jax.vmap(contour_place, (0, 0, 0, 0, None))
    places = jax.vmap(at_knots, (None, None, 0, 0, None))

    def plane(hair):
        return places(cylinder.radius, cylinder.offset, hair.s, hair.u, turn)

    d = plane(after) - plane(before)
    across = jnp.einsum("kij,skj->ski", maps, d, precision=EXACT)
    offset = jnp.concatenate([jnp.zeros_like(across[..., :1]), across], axis=-1)
    return offset.at[:, 0].set(0.0)


def outward_angle(tree: HairTree, index: int) -> float:
    """Return where in a cluster's contour the side away from the head lies, in radians.

    Away is from the middle of the scalp patch's points, which lies under it; seen in
    the cross-sections of all knots, of which those count most that lie along the head.
    """
    cylinder = cluster(tree.cylinder, index)
    _, normal, binormal = jax.jit(cylinder_frames)(cylinder)
    rest = cylinder.skeleton - jnp.mean(tree.scalp.control, axis=(0, 1))[None]
    away = unit(rest, jnp.zeros_like(rest))
    n, b = jnp.sum(away * normal, axis=1), jnp.sum(away * binormal, axis=1)
    maps = section_maps(cylinder)
    # The inverse of the map, but for its size: a direction is all that is asked for.
    x = maps[:, 1, 1] * n - maps[:, 0, 1] * b
    y = maps[:, 0, 0] * b - maps[:, 1, 0] * n
    det = maps[:, 0, 0] * maps[:, 1, 1] - maps[:, 0, 1] * maps[:, 1, 0]
    inner = jnp.sign(det)[:, None] * jnp.stack([x, y], axis=1)
    weight = norm(jnp.stack([n, b], axis=1))[:, None]
    x, y = jnp.sum(weight * unit(inner, jnp.zeros_like(inner)), axis=0)
    return float(jnp.arctan2(y, x))


def with_cluster_wisps(
    tree: HairTree,
    index: int,
    uv: Float[Array, "strands 2"],
    offset: Float[Array, "strands knots 3"],
) -> HairTree:
    """Return the tree in which a cluster's wisps are these, those of others kept."""
    new = Wisps(uv, jnp.full(uv.shape[0], index, jnp.int32), offset)
    if tree.wisps is not None:
        other = np.flatnonzero(np.asarray(tree.wisps.owner) != index)
        kept = jax.tree.map(lambda leaf: leaf[other], tree.wisps)
        new = jax.tree.map(
            lambda old, own: jnp.concatenate([old, own.astype(old.dtype)]), kept, new
        )
    return eqx.tree_at(lambda t: t.wisps, tree, new, is_leaf=lambda x: x is None)
