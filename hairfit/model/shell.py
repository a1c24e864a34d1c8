"""Thin shell volumes: hair in a layer over a surface."""

import dataclasses
import functools
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PRNGKeyArray, ScalarLike, UInt32

from .curve import EXACT, catmull_rom_weights
from .vector import unit

# For the inverse of (3-2): guesses along s, t and u, and Newton steps from the best.
GUESSES = (13, 13, 3)
NEWTON_STEPS = 12


class ThinShell(eqx.Module):
    r"""The layer of hair over a reference surface [Kim02, section 3.1.2]. Metres.

    The normalised volume $(s, t, u) \in [0, 1]^3$ is bent over the surface by (3-2):
    hair runs along t, and u goes from the innermost hair at the surface to the
    outermost. Surfaces that are bent more sharply than the layer is thick make it
    intersect itself.

    Attributes:
        surface: $S(s, t)$, such as a `CoonsPatch`; any callable from two numbers to a
            point.
        thickness: $T$, how far the outermost hair lies above the surface.
    """

    surface: Callable
    thickness: Float[Array, ""]


@dataclasses.dataclass(frozen=True)
class ShellGrid:
    """How many cells the normalised volume has along s, t and u.

    Attributes:
        columns: Cells along s, the thesis's L.
        rows: Cells along t, its M; each strand has one particle in each.
        layers: Cells along u, its N.
    """

    columns: int = 20
    rows: int = 20
    layers: int = 10


class ShellHair(eqx.Module):
    """The particles of all strands in the normalised volume, root first.

    Attributes:
        s: Across the flow of the hair, in [0, 1].
        u: Depth, 0 for the innermost hair to 1 for the outermost.
        t: Along the hair; the same for all strands, increasing. Combing keeps it.
    """

    s: Float[Array, "strands rows"]
    u: Float[Array, "strands rows"]
    t: Float[Array, " rows"]


class Place(NamedTuple):
    """The surface below a point: the point there, and the unit normal."""

    point: Float[Array, " 3"]
    normal: Float[Array, " 3"]


def shell_place(shell: ThinShell, s: ScalarLike, t: ScalarLike) -> Place:
    r"""Return the surface's point at (s, t) and its normal (3-1).

    The thesis takes $n = S_s \times S_t$ as it comes. Its length is the area that a
    unit of s and t covers, so $T$ in (3-2) would be no thickness in metres, and hair
    would lie thicker where the patch is wide. The normal has unit length here. It
    points where s, t and it are right-handed; where the patch is pinched to a point it
    has none, and the shell no thickness.

    Args:
        shell: The shell.
        s: Across the flow of the hair, in [0, 1].
        t: Along it.
    """
    s, t = jnp.asarray(s), jnp.asarray(t)
    one = jnp.ones_like(s)
    point, along_s = jax.jvp(lambda x: shell.surface(x, t), (s,), (one,))
    along_t = jax.jvp(lambda x: shell.surface(s, x), (t,), (one,))[1]
    normal = jnp.cross(along_s, along_t)
    return Place(point, unit(normal, jnp.zeros_like(normal)))


def shell_point(shell: ThinShell, stu: Float[Array, " 3"]) -> Float[Array, " 3"]:
    """Return a point of the normalised volume in the world, by equation (3-2)."""
    place = shell_place(shell, stu[0], stu[1])
    return place.point + shell.thickness * stu[2] * place.normal


def shell_coordinates(shell: ThinShell, p: Float[Array, " 3"]) -> Float[Array, " 3"]:
    """Return (s, t, u) of a point in the world: the inverse of `shell_point`.

    Newton's method from the closest of some guesses. A step that does not come closer
    is shortened or left out. Points outside of the shell get coordinates outside of
    [0, 1], where the surface goes on along its end tangents. Where the shell
    intersects itself, one of several answers comes back.
    """
    axes = [jnp.linspace(0.0, 1.0, count, dtype=p.dtype) for count in GUESSES]
    guess = jnp.stack(jnp.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)

    def rest(stu):
        return shell_point(shell, stu) - p

    def distance(stu):
        return jnp.sum(rest(stu) ** 2)

    shares = jnp.array([0.0, 1.0, 0.5, 0.125], p.dtype)

    def step(stu, _):
        slope = jax.jacfwd(rest)(stu)
        det = jnp.linalg.det(slope)
        safe = jnp.where(det != 0.0, slope, jnp.eye(3, dtype=p.dtype))
        move = jnp.linalg.solve(safe, rest(stu))
        tries = stu[None] - shares[:, None] * move[None]
        return tries[jnp.argmin(jax.vmap(distance)(tries))], None

    start = guess[jnp.argmin(jax.vmap(distance)(guess))]
    return jax.lax.scan(step, start, None, length=NEWTON_STEPS)[0]


@functools.partial(jax.jit, static_argnums=(0, 1))
def even_hair(
    count: int, grid: ShellGrid, key: PRNGKeyArray | UInt32[Array, " 2"]
) -> ShellHair:
    """Return straight strands that are spread evenly over the volume.

    Each runs along t through the middles of its rows. Every cell of a row has
    `count / (columns * layers)` particles, one more or less; inside its cell a strand
    stands at random.

    Args:
        count: Number of strands.
        grid: The cells.
        key: Randomness.
    """
    cells = grid.columns * grid.layers
    spread_key, place_key = jax.random.split(key)
    chosen = jax.random.permutation(spread_key, cells)[np.arange(count) % cells]
    dtype = jnp.result_type(float)
    place = jax.random.uniform(place_key, (count, 2), dtype)
    index = jnp.stack([chosen // grid.layers, chosen % grid.layers], axis=1)
    size = jnp.array([[grid.columns, grid.layers]], dtype)
    su = (index.astype(dtype) + place) / size
    rows = (jnp.arange(grid.rows, dtype=dtype) + 0.5) / grid.rows
    s, u = (jnp.tile(x[:, None], (1, grid.rows)) for x in su.T)
    return ShellHair(s, u, rows)


def cell_of(x: Float[Array, "*batch"], cells: int) -> Int[Array, "*batch"]:
    """Return the cell that a coordinate in [0, 1] falls into."""
    return jnp.clip(jnp.floor(x * cells).astype(jnp.int32), 0, cells - 1)


@eqx.filter_jit
def shell_strands(
    shell: ThinShell, hair: ShellHair, points: int
) -> Float[Array, "strands points 3"]:
    """Return the strands in the world, in metres, root first [Kim02, section 3.3].

    A curve joins a strand's particles in the normalised volume, and (3-2) takes its
    points to the world. The thesis uses Lagrange curves. Through 20 even particles
    they swing: one in the middle that is off by 1 moves the curve near its ends by a
    thousand. So this is a Catmull-Rom curve, on which a particle moves two segments on
    either side, and by no more than itself. What overshoots the volume is set back
    onto its border.

    Args:
        shell: The shell.
        hair: The particles.
        points: Number of points of each strand.
    """
    at = jnp.linspace(0.0, 1.0, points, dtype=hair.t.dtype)
    weights = catmull_rom_weights(hair.t.shape[0], at)

    def curve(rows):
        return jnp.clip(jnp.matmul(rows, weights.T, precision=EXACT), 0.0, 1.0)

    s, u = curve(hair.s), curve(hair.u)
    t = curve(hair.t)

    def point(s, t, u):
        return shell_point(shell, jnp.stack([s, t, u]))

    # All strands share t, so that it is an axis of its own: what depends on t alone,
    # such as two of the boundaries, is evaluated once.
    along = jax.vmap(point)
    return jax.vmap(along, (0, None, 0))(s, t, u)


@functools.partial(jax.jit, static_argnums=1)
def shell_density(
    hair: ShellHair, grid: ShellGrid
) -> Float[Array, "columns rows layers"]:
    """Return the particles in each cell; 1 where there are as many as in even hair.

    This is the opacity of section 3.3.1.

    Args:
        hair: The particles.
        grid: The cells; its rows are those of the hair.

    Raises:
        ValueError: If grid and hair differ in rows.
    """
    check_rows(hair, grid)
    strands = hair.s.shape[0]
    cell = cell_of(hair.s, grid.columns), cell_of(hair.u, grid.layers)
    row = jnp.broadcast_to(jnp.arange(grid.rows)[None], hair.s.shape)
    even = strands / (grid.columns * grid.layers)
    counts = jnp.zeros((grid.columns, grid.rows, grid.layers), hair.s.dtype)
    return counts.at[cell[0], row, cell[1]].add(1.0 / max(even, 1e-12))


def shell_shadow(
    density: Float[Array, "columns rows layers"], thickness: ScalarLike
) -> Float[Array, "columns rows layers"]:
    r"""Return the amount of shadow in each cell [Kim02, section 3.3.1].

    $\Phi_{i,j,k} = \Phi_{i,j,k+1} + Th\,\rho(V_{i,j,k+1})$, and 0 in the outermost
    cell. The thesis prints the outermost cell as k = L; L counts the cells along s,
    and k runs along the depth to N. Light from all around is
    $e^{-\Phi}$ where a picture wants a factor.

    Args:
        density: $\rho$, as `shell_density` returns it.
        thickness: $Th$, the optical thickness of one layer of even hair.
    """
    outwards = jnp.flip(jnp.cumsum(jnp.flip(density, 2), axis=2), 2)
    return jnp.asarray(thickness, density.dtype) * (outwards - density)


def particle_shadow(
    hair: ShellHair,
    shadow: Float[Array, "columns rows layers"],
    noise: ScalarLike,
    key: PRNGKeyArray | UInt32[Array, " 2"],
) -> Float[Array, "strands rows"]:
    """Return the amount of shadow at each particle: its cell's, with a little noise.

    Args:
        hair: The particles.
        shadow: As `shell_shadow` returns it.
        noise: The shadow varies by up to this much either way, but not below 0.
        key: Randomness.
    """
    column = cell_of(hair.s, shadow.shape[0])
    layer = cell_of(hair.u, shadow.shape[2])
    row = jnp.arange(shadow.shape[1])[None]
    vary = jax.random.uniform(key, hair.s.shape, hair.s.dtype, -1.0, 1.0)
    here = shadow[column, row, layer] + jnp.asarray(noise, hair.s.dtype) * vary
    return jnp.maximum(here, 0.0)


def check_rows(hair: ShellHair, grid: ShellGrid) -> None:
    """Raise ValueError if the hair does not have the rows of the grid."""
    if hair.t.shape[0] != grid.rows:
        raise ValueError(
            f"a grid of {grid.rows} rows got strands of {hair.t.shape[0]} particles; "
            "give the grid as many rows as the strands have particles."
        )
