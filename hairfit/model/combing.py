"""Virtual combing: teeth that part, sweep and lift the hair of a thin shell."""

import functools
from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray, ScalarLike, UInt32

from .curve import EXACT, catmull_rom_weights
from .shell import ShellGrid, ShellHair, cell_of, check_rows


class Comb(eqx.Module):
    """A comb on its way through a shell: paths and shape of its teeth [Kim02, 3.2].

    The cross-section of a tooth in the plane of s and u is a trapezoid, which reaches
    from the outermost hair down to the tooth's depth.

    Attributes:
        path: Where the middle of each tooth is, $s = C(t)$: a Catmull-Rom curve
            through values at even t, from 0 to 1.
        bottom: $Z_0$, width of the teeth at their lower end.
        top: $Z_1$, their width at u = 1.
        depth: $l$, how far they reach in; 1 is all of the shell.
    """

    path: Float[Array, "teeth knots"]
    bottom: Float[Array, ""]
    top: Float[Array, ""]
    depth: Float[Array, ""]


class Influence(NamedTuple):
    """How the nearest tooth acts on one particle.

    Attributes:
        tooth: Index of the tooth.
        pickup: $Z(s, u)$ in [-1, 1]: its size is the probability of being picked up,
            its sign the side on which the particle leaves the tooth.
        reach: $Z(u)$, half the tooth's width at the particle's depth.
    """

    tooth: Int[Array, ""]
    pickup: Float[Array, ""]
    reach: Float[Array, ""]


class Draws(NamedTuple):
    """The random numbers of one stroke of a comb, one a strand.

    Attributes:
        threshold: A tooth picks a strand up where its influence is above this.
        place: Where in the tooth's zone a picked particle goes, 0 (middle) to 1.
        order: The strands in the order in which they find partners to swap with.
    """

    threshold: Float[Array, " strands"]
    place: Float[Array, " strands"]
    order: Int[Array, " strands"]


def even_comb(
    teeth: int,
    sway: Float[Array, " knots"],
    key: PRNGKeyArray | UInt32[Array, " 2"],
    *,
    taper: float = 0.5,
    depth: float = 0.5,
    variation: float = 0.3,
) -> Comb:
    """Return a comb of even teeth that fill the shell's width and do not interfere.

    As for figure 3-11: the teeth are as wide as they are apart, reach half-way in and
    wander a little on their paths.

    Args:
        teeth: Number of teeth.
        sway: How the comb moves sideways along the hair, at even t, 2 knots or more.
        key: Randomness.
        taper: Width at the lower end as a share of that at the top.
        depth: How far the teeth reach in; 1 is all of the shell.
        variation: How far paths wander, as a share of the distance of the teeth.

    Raises:
        ValueError: If there is no tooth.
    """
    if teeth < 1:
        raise ValueError(f"a comb needs at least 1 tooth, got {teeth}.")
    dtype = sway.dtype
    middle = (jnp.arange(teeth, dtype=dtype) + 0.5) / teeth
    wander = jax.random.uniform(key, (teeth, sway.shape[0]), dtype, -0.5, 0.5)
    path = middle[:, None] + sway[None] + (variation / teeth) * wander
    top = jnp.asarray(1.0 / teeth, dtype)
    return Comb(path, taper * top, top, jnp.asarray(depth, dtype))


def tooth_reach(comb: Comb, u: Float[Array, ""]) -> Float[Array, ""]:
    r"""Return half the width of a tooth at a depth, $Z(u)$ of (3-3).

    $Z_0$ and $Z_1$ are whole widths, hence the factor 1/2, since $Z(u)$ divides a
    distance from the middle. $u' = 1 + (u - 1) / l$ is 0 at the tooth's lower end and
    1 at u = 1. Below the tooth the thesis sets a small $\varepsilon$ against the
    division by zero; the reach is 0 here, and `tooth_influence` takes care of it.
    """
    along = 1.0 + (u - 1.0) / comb.depth
    width = (1.0 - along) * comb.bottom + along * comb.top
    return jnp.where(along >= 0.0, 0.5 * width, 0.0)


def tooth_influence(
    comb: Comb,
    centres: Float[Array, " teeth"],
    s: Float[Array, ""],
    u: Float[Array, ""],
) -> Influence:
    r"""Return how the nearest tooth acts on a particle [Kim02, section 3.2.1].

    $Z(s,u) = \mathrm{sign}(R) \cos(\frac{\pi}{2} \mathrm{clamp}(R / Z(u)))$, with R
    the distance from the tooth's middle. The thesis has clamp(x) = 0 where |x| > 1,
    whose cosine is 1: all hair outside of the teeth would be picked up, all hair below
    them too. Influence must end at the tooth's side, so clamp(x) is 1 or -1 there and
    the cosine vanishes.

    "The nearest trapezoid" is the one whose middle is closest in s at the particle's t.

    Args:
        comb: The comb.
        centres: Middles of the teeth at the particle's t.
        s: The particle.
        u: The same.
    """
    tooth = jnp.argmin(jnp.abs(s - centres))
    away = s - centres[tooth]
    reach = tooth_reach(comb, u)
    some = reach > 0.0
    share = jnp.abs(away) / jnp.where(some, reach, 1.0)
    # Not by a cosine clipped at 90 degrees: rounding leaves more than 0 of that.
    inside = some & (share < 1.0)
    size = jnp.where(inside, jnp.cos(0.5 * jnp.pi * share), 0.0)
    return Influence(tooth, jnp.where(away >= 0.0, size, -size), reach)


def comb_draws(strands: int, key: PRNGKeyArray | UInt32[Array, " 2"]) -> Draws:
    """Return the random numbers of one stroke of a comb."""
    threshold, place, order = jax.random.split(key, 3)
    dtype = jnp.result_type(float)
    return Draws(
        jax.random.uniform(threshold, (strands,), dtype),
        jax.random.uniform(place, (strands,), dtype),
        jax.random.permutation(order, strands),
    )


@functools.partial(jax.jit, static_argnums=2)
def comb_hair(
    hair: ShellHair,
    comb: Comb,
    grid: ShellGrid,
    key: PRNGKeyArray | UInt32[Array, " 2"],
) -> ShellHair:
    r"""Return the hair after one stroke of a comb [Kim02, section 3.2].

    - **Pickup (3.2.1).** A tooth picks up a particle with probability $|Z(s, u)|$. A
      strand has one random threshold for all its particles. With a new one for each,
      some of the 20 particles of almost every strand under a tooth would be picked up,
      even at its side, and the parting in the middle of the zone, which section 3.2.2
      and figure 3-5 describe, would be gone.
    - **Redistribution (3.2.2).** The first picked particle of a strand goes to a random
      place in the tooth's zone, on the side that the sign of Z says.
    - **Sweep (3.2.3).** All later ones keep its distance r from the tooth's path,
      $s' = C(t) + r$. The thesis has $r = |s' - C|$, which would throw all hair that
      the tooth pushed to its left over to its right; r has a sign here.
    - **Vertical motion (3.2.4)**, `lift_combed`: all these particles move up a layer.
    - What leaves the volume is reflected back into it.

    Combing again is calling this again, with other combs: `comb_repeatedly`.

    Args:
        hair: The particles.
        comb: The comb.
        grid: The cells; its rows are those of the hair.
        key: Randomness.

    Raises:
        ValueError: If grid and hair differ in rows.
    """
    check_rows(hair, grid)
    draws = comb_draws(hair.s.shape[0], key)
    weights = catmull_rom_weights(comb.path.shape[1], hair.t)
    centres = jnp.matmul(weights, comb.path.T, precision=EXACT)
    a_row = jax.vmap(tooth_influence, (None, None, 0, 0))
    found = jax.vmap(a_row, (None, 0, 1, 1), 1)(comb, centres, hair.s, hair.u)

    picked = jnp.abs(found.pickup) > draws.threshold.astype(hair.s.dtype)[:, None]
    first = jnp.argmax(picked, axis=1)

    def at_first(values):
        return jnp.take_along_axis(values, first[:, None], axis=1)

    rows = jnp.arange(grid.rows)
    combed = jnp.any(picked, axis=1)[:, None] & (rows[None] >= first[:, None])
    side = jnp.where(at_first(found.pickup) >= 0.0, 1.0, -1.0).astype(hair.s.dtype)
    place = draws.place.astype(hair.s.dtype)[:, None]
    r = side * place * at_first(found.reach)
    swept = centres[rows[None], at_first(found.tooth)] + r
    s = jnp.where(combed, reflect(swept), hair.s)
    lift = jax.vmap(lift_combed, (1, 1, 1, None, None), 1)
    return ShellHair(s, lift(s, hair.u, combed, draws.order, grid), hair.t)


def comb_repeatedly(
    hair: ShellHair,
    combs: Sequence[Comb],
    grid: ShellGrid,
    key: PRNGKeyArray | UInt32[Array, " 2"],
) -> ShellHair:
    """Return the hair after several strokes, each with a comb of its own.

    Args:
        hair: The particles.
        combs: The combs, the first one first.
        grid: The cells; its rows are those of the hair.
        key: Randomness.
    """
    for i, comb in enumerate(combs):
        hair = comb_hair(hair, comb, grid, jax.random.fold_in(key, i))
    return hair


def lift_combed(
    s: Float[Array, " strands"],
    u: Float[Array, " strands"],
    combed: Bool[Array, " strands"],
    order: Int[Array, " strands"],
    grid: ShellGrid,
) -> Float[Array, " strands"]:
    """Return the depths of one row's particles after combed ones moved up (3.2.4).

    A combed particle swaps its depth with a particle of the cell above that was not
    combed, so that combed hair comes to lie on top and other hair is pushed under it.
    Each particle swaps once: the first combed ones of a cell, in the order given, take
    the first others of the cell above. Who finds no partner, or has no cell above,
    moves up by the size of a cell and is reflected at the top.

    The thesis swaps with "a particle from the upper cell". Were that another combed
    particle, it would be pushed down again; it is left out. The order is that of the
    whole stroke, so that strands that run side by side swap the same way in all rows.

    Args:
        s: Where the particles are, after the sweep.
        u: Their depths before.
        combed: Which ones the comb moved.
        order: All strands in the order in which they find partners.
        grid: The cells.
    """
    cells = grid.columns * grid.layers
    cell = cell_of(s, grid.columns) * grid.layers + cell_of(u, grid.layers)
    group = 2 * cell + combed.astype(jnp.int32)
    # Sorted by group, in the given order inside each.
    strand = order[jnp.argsort(group[order], stable=True)]
    mine, lifted, depth = group[strand], combed[strand], u[strand]
    start = jnp.searchsorted(mine, jnp.arange(2 * cells + 1, dtype=mine.dtype))
    rank = jnp.arange(s.shape[0], dtype=start.dtype) - start[mine]
    # Above: those not combed. Below: those combed. A column's layers are in sequence.
    layer = (mine // 2) % grid.layers
    other = jnp.where(lifted, mine + 1, mine - 1)
    has_cell = jnp.where(lifted, layer < grid.layers - 1, layer > 0)
    other = jnp.where(has_cell, other, 0)
    partners = start[other + 1] - start[other]
    swaps = has_cell & (rank < partners)
    partner = jnp.where(swaps, start[other] + rank, 0)
    alone = jnp.where(lifted, reflect(depth + 1.0 / grid.layers), depth)
    return u.at[strand].set(jnp.where(swaps, depth[partner], alone))


def reflect(x: ScalarLike | Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """Return coordinates reflected into [0, 1] at both ends, as often as it takes."""
    return 1.0 - jnp.abs(1.0 - jnp.mod(jnp.asarray(x), 2.0))
