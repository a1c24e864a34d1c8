"""Hairstyles as hair trees, from a seed: the truth that synthetic captures hold."""

import dataclasses
import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..errors import InputError
from ..model import (
    Frames,
    GeneralizedCylinder,
    HairTree,
    Scalp,
    ScalpContour,
    find_owner,
    grow_strands,
    plant,
    sample_roots,
)
from ..model.cylinder import frames_of
from ..model.scalp import points_on
from .guides import TIE, Fall, falling_guides, smooth_step, tied_guides
from .head import head_distance, head_normal
from .tiling import scatter, tile_contours

CLEAR = 0.0015  # how far off the head every strand is kept, in metres


@dataclasses.dataclass(frozen=True)
class Style:
    """What makes a hairstyle. Metres.

    Attributes:
        knots: Knots of every skeleton.
        roots: Number of root clusters.
        children: Number of clusters under each of them.
        fall: How loose hair falls; None ties it.
        tail: Length behind the tie.
        wave: Half of the width of waves or curls.
        pitch: Length of one wave or turn.
        curl: Share of the third dimension: 0 for waves in a plane, 1 for a helix.
        thickness: Thickness of a root cluster's hair against its root's width.
        gather: Share of its width that a leaf cluster keeps at the tip.
    """

    knots: int = 16
    roots: int = 36
    children: int = 5
    fall: Fall | None = None
    tail: float = 0.2
    wave: float = 0.0
    pitch: float = 0.03
    curl: float = 0.0
    thickness: float = 0.30
    gather: float = 0.6


CONFIGS = {
    "straight": Style(fall=Fall(0.028, 0.011, -0.120, 0.11, 0.30)),
    "wavy": Style(
        knots=32,
        fall=Fall(0.024, 0.015, -0.135, 0.11, 0.30),
        wave=0.0040,
        pitch=0.045,
        curl=0.25,
        gather=0.5,
    ),
    "curly": Style(
        knots=40,
        children=6,
        fall=Fall(0.004, 0.030, -0.080, 0.12, 0.24),
        wave=0.0065,
        pitch=0.030,
        curl=1.0,
        thickness=0.5,
        gather=0.45,
    ),
    "ponytail": Style(knots=28, thickness=0.25, gather=0.7),
}
STYLES = tuple(CONFIGS)


def make_style(name: str, seed: int, scalp: Scalp) -> HairTree:
    """Return a hairstyle of two levels: root clusters, and wisps that follow them.

    Args:
        name: One of `STYLES`.
        seed: The same seed gives the same tree.
        scalp: The scalp of `make_scalp`.

    Raises:
        InputError: If there is no such style.
    """
    if name not in CONFIGS:
        raise InputError(
            f"there is no style {name!r}; take one of {', '.join(STYLES)}."
        )
    # Float64 makes rounding independent of the machine; what is stored is float32.
    with jax.enable_x64(True):
        exact = jax.tree.map(lambda x: jnp.asarray(x, jnp.float64), scalp)
        tree = grow_tree(CONFIGS[name], exact, seed)
        return jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), tree)


def grow_tree(style: Style, scalp: Scalp, seed: int) -> HairTree:
    """Return the tree of a style; root clusters first, then all of their children."""
    key = jax.random.key(seed)
    rng = np.random.default_rng(seed)
    uv = np.asarray(sample_roots(scalp, 6000, key))
    p = np.asarray(points_on(scalp, jnp.asarray(uv)))
    centres = uv[scatter(p, style.roots, rng)]
    contour = tile_contours(centres)
    root = style_cylinder(style, scalp, contour)
    parent = (-1,) * style.roots
    vary = np.full(style.roots, 0.12)
    tree = HairTree(scalp, contour, root, jnp.asarray(vary), parent)

    owner = np.asarray(find_owner(tree, jnp.asarray(uv)))
    seeds = []
    for i in range(style.roots):
        mine = np.flatnonzero(owner == i)
        count = min(style.children, len(mine))
        seeds.append(mine[scatter(p[mine], count, rng)])
    above = np.repeat(np.arange(style.roots), [len(one) for one in seeds])
    inner = uv[np.concatenate(seeds)]
    contour_below = tile_contours(inner)
    below = child_cylinder(style, tree, contour_below, above, rng)
    join = functools.partial(jax.tree.map, lambda a, b: jnp.concatenate([a, b]))
    tree = HairTree(
        scalp,
        join(contour, contour_below),
        join(root, below),
        jnp.full(style.roots + len(above), 0.12),
        parent + tuple(above.tolist()),
    )
    return lift_out(tree, key)


def lift_out(tree: HairTree, key) -> HairTree:
    """Return the tree with knots moved outwards where its strands enter the head."""
    knots = tree.cylinder.skeleton.shape[1]
    for round_key in jax.random.split(key, 8):
        # Other roots each time: what one round leaves, the next one meets.
        uv = sample_roots(tree.scalp, 6000, round_key)
        owner = find_owner(tree, np.asarray(uv))
        eta = jnp.ones(len(uv), uv.dtype)
        p = np.asarray(grow_strands(tree, uv, owner, eta, 3 * knots - 2))
        missing = np.maximum(CLEAR - head_distance(p), 0.0)
        # Each knot answers for the points up to its neighbours.
        near = np.pad(missing[:, 1:], ((0, 0), (0, 3))).reshape(len(p), knots, 3).max(2)
        near = np.maximum(near, np.pad(near, ((0, 0), (1, 0)))[:, :-1])
        move = np.zeros((tree.count, knots))
        np.maximum.at(move, np.asarray(owner), near)
        move[:, 0] = 0.0
        skeleton = np.asarray(tree.cylinder.skeleton)
        skeleton = skeleton + 1.3 * move[..., None] * head_normal(skeleton)
        tree = eqx.tree_at(lambda t: t.cylinder.skeleton, tree, jnp.asarray(skeleton))
    return tree


def style_cylinder(
    style: Style, scalp: Scalp, contour: ScalpContour
) -> GeneralizedCylinder:
    """Return the root clusters, planted and bent to the style's guides."""
    planted = plant_all(scalp, contour, style.knots)
    roots = np.asarray(planted.skeleton[:, 0])
    if style.fall is None:
        guides = tied_guides(roots, style.knots, style.tail)
    else:
        guides = falling_guides(roots, style.knots, style.fall)
    return shape_sections(style, planted, guides, keep=0.8)


def child_cylinder(
    style: Style, tree: HairTree, contour: ScalpContour, above, rng
) -> GeneralizedCylinder:
    """Return the children: they run along their parent, with waves of their own."""
    scalp = tree.scalp
    planted = plant_all(scalp, contour, style.knots)
    owner = jnp.asarray(above, jnp.int32)
    eta = jnp.asarray(rng.uniform(0.88, 1.0, len(above)))
    follow = grow_strands(tree, contour.centre, owner, eta, style.knots)
    frames = frames_of(bend(planted, follow))
    guides = np.asarray(follow) + waves(style, np.asarray(follow), frames, rng)
    out = np.maximum(0.0025 - head_distance(guides), 0.0)
    out[:, 0] = 0.0
    guides = guides + out[..., None] * head_normal(guides)
    return shape_sections(style, planted, guides, keep=style.gather)


def waves(
    style: Style, follow: Float[np.ndarray, "clusters knots 3"], frames: Frames, rng
) -> Float[np.ndarray, "clusters knots 3"]:
    """Return the offsets of waves or curls from the curves they follow.

    Neighbours have nearly the same phase in waves, and any phase in curls.
    """
    count = len(follow)
    steps = np.linalg.norm(np.diff(follow, axis=1), axis=2)
    along = np.concatenate([np.zeros((count, 1)), np.cumsum(steps, 1)], 1)
    azimuth = np.arctan2(follow[:, 0, 0], follow[:, 0, 2] + 0.02)
    loose = 0.35 + style.curl
    phase = 3.0 * azimuth + loose * rng.uniform(-np.pi, np.pi, count)
    pitch = style.pitch * rng.uniform(0.88, 1.12, count)
    turn = np.where(rng.uniform(size=count) < 0.5, -1.0, 1.0)
    angle = phase[:, None] + 2.0 * np.pi * along / pitch[:, None]
    size = style.wave * rng.uniform(0.8, 1.2, count)[:, None]
    size = (size * smooth_step(along / 0.06))[..., None]
    across = np.asarray(frames.normal) * np.cos(angle)[..., None]
    depth = np.asarray(frames.binormal) * (turn[:, None] * np.sin(angle))[..., None]
    outward = head_normal(follow)
    side = np.cross(np.asarray(frames.tangent), outward)
    flat = side * np.cos(angle)[..., None] + 0.3 * outward * np.sin(angle)[..., None]
    return size * (style.curl * (across + depth) + (1.0 - style.curl) * flat)


def shape_sections(
    style: Style,
    planted: GeneralizedCylinder,
    guides: Float[np.ndarray, "clusters knots 3"],
    keep: float,
) -> GeneralizedCylinder:
    """Return planted clusters along `guides`: flat on the head, thin at the tip.

    Each cross-section is the scalp's own map at the root, followed by a stretch along
    the outward direction and one across it: `upper_and_turn` makes scales, shear and
    twist of it. It is never so thick that hair would enter the head.
    """
    bent = bend(planted, guides)
    frames = frames_of(bent)
    outward = head_normal(guides)
    distance = head_distance(guides)
    steps = np.linalg.norm(np.diff(guides, axis=1), axis=2)
    along = np.concatenate([np.zeros((len(guides), 1)), np.cumsum(steps, 1)], 1)
    share = along / along[:, -1:]
    wide = 1.0 + (keep - 1.0) * smooth_step(share)
    flat = 1.0 + (style.thickness - 1.0) * smooth_step(along / 0.05)
    if style.fall is None:
        wide, flat = tie_widths(guides, wide, flat)
    reach = np.asarray((planted.radius[..., None] + planted.offset).max(-1))
    room = np.maximum(distance - 0.0015, 0.0) / np.maximum(reach, 1e-6)
    room[:, 0] = 1.0
    thick = np.minimum(wide * flat, room)
    g = np.stack(
        [
            np.einsum("ijk,ijk->ij", outward, np.asarray(frames.normal)),
            np.einsum("ijk,ijk->ij", outward, np.asarray(frames.binormal)),
        ],
        -1,
    )
    stretch = wide[..., None, None] * np.eye(2) + (thick - wide)[..., None, None] * (
        g[..., :, None] * g[..., None, :]
    )
    scale, shear = np.asarray(planted.scale), np.asarray(planted.shear)
    own = np.zeros((*shear.shape, 2, 2))
    own[..., 0, 0], own[..., 0, 1], own[..., 1, 1] = scale[..., 0], shear, scale[..., 1]
    return upper_and_turn(bent, stretch @ own)


def tie_widths(guides, wide, flat):
    """Return the widths of tied hair: narrow at the tie, wider behind it."""
    distance = np.linalg.norm(guides - TIE, axis=2)
    at = distance.argmin(1)
    behind = np.arange(guides.shape[1])[None] >= at[:, None]
    pinch = 0.22 + 0.78 * smooth_step((distance - 0.01) / 0.08)
    tail = 0.22 + 0.25 * smooth_step(distance / 0.08)
    tail = tail * (1.0 - 0.5 * smooth_step(distance / 0.25))
    wide = np.where(behind, tail, pinch * wide)
    return wide, np.where(behind, 1.0, np.maximum(flat, 0.3))


def upper_and_turn(
    cylinder: GeneralizedCylinder, maps: Float[np.ndarray, "clusters knots 2 2"]
) -> GeneralizedCylinder:
    r"""Return cylinders whose cross-sections are mapped by `maps`.

    A linear map is an upper triangular one (scales and shear) after a turn (twist).
    """
    low = maps[..., 1, :]
    twist = np.unwrap(np.arctan2(low[..., 0], low[..., 1]), axis=1)
    cos, sin = np.cos(twist), np.sin(twist)
    a, b = maps[..., 0, 0], maps[..., 0, 1]
    scale = np.stack([a * cos - b * sin, np.linalg.norm(low, axis=-1)], -1)
    return eqx.tree_at(
        lambda c: (c.scale, c.twist, c.shear),
        cylinder,
        (jnp.asarray(scale), jnp.asarray(twist), jnp.asarray(a * sin + b * cos)),
    )


def bend(
    cylinder: GeneralizedCylinder,
    skeleton: Float[Array | np.ndarray, "clusters knots 3"],
) -> GeneralizedCylinder:
    """Return stacked cylinders with other skeletons."""
    return eqx.tree_at(lambda c: c.skeleton, cylinder, jnp.asarray(skeleton))


@eqx.filter_jit
def plant_all(scalp: Scalp, contour: ScalpContour, knots: int) -> GeneralizedCylinder:
    """Return one straight cluster for each contour."""
    return jax.vmap(lambda one: plant(scalp, one, 0.1, knots))(contour)
