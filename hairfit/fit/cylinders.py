"""Generalized cylinders fitted to the strands of their clusters by least squares."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float, Int

from ..host import more_rows, on_device
from ..model.cylinder import GeneralizedCylinder, cylinder_frames, frames_of, together
from ..model.section import with_section_maps
from ..model.strand import strand_knots
from ..model.tree import HairTree, ScalpContour

# Strands of one cluster differ by about so much from its linear map. Metres.
SPREAD = 0.002
# Strands farther than this from their cluster's are outliers. Metres, over its length.
OUTLIER = 0.006
# How far least squares may go from its start, which is the solution but for the planes
# of the cross-sections: metres, and no unit.
SKELETON_PRIOR, MAP_PRIOR = 0.01, 0.25
INEXACT = 1e-3


class FittedTree(NamedTuple):
    """A tree fitted to strands, and how well.

    Attributes:
        tree: The tree.
        error: Median distance of knots from their strands, in metres.
        result: What the solver said.
    """

    tree: HairTree
    error: float
    result: str


class Members(NamedTuple):
    """Strands as their clusters see them: each strand once a level."""

    uv: Float[Array, "members 2"]
    owner: Int[Array, " members"]
    knots: Float[Array, "members knots 3"]


class Problem(NamedTuple):
    """What the least squares needs besides the change that it looks for."""

    contour: ScalpContour
    start: GeneralizedCylinder
    members: Members
    weight: Float[Array, " members"]
    units: tuple[Array, Array]


def refine_cylinders(tree: HairTree, members: Members, steps: int) -> FittedTree:
    """Return the tree whose clusters come closest to their strands, from a start.

    All parameters of cylinders move together by Levenberg-Marquardt, matrix-free.

    Args:
        tree: The tree to start from.
        members: The strands of every cluster, on all levels.
        steps: Most steps.
    """
    start, contour = tree.cylinder, tree.contour
    # Half of the strands say enough about some numbers a cluster.
    some = jax.tree.map(lambda leaf: leaf[::2], members)
    distance = _distance(start, contour, some)
    error = jnp.mean(jnp.sum(distance**2, axis=2), axis=1)
    weight = 1.0 / (1.0 + error / (2.0 * OUTLIER) ** 2)
    problem = Problem(
        contour,
        start,
        some,
        weight,
        _units(start, some.owner, weight),
    )
    unchanged = jax.tree.map(jnp.zeros_like, _flexible(start))
    slope = jax.tree.leaves(jax.grad(_half_square)(unchanged, problem))
    size = jnp.sqrt(jnp.mean(jnp.concatenate([s.ravel() for s in slope]) ** 2))
    # How far a step is solved, against the first gradient: the next step corrects it.
    inexact = lx.CG(
        rtol=1e-6,
        # An array: as a number it would be compiled anew for every fit.
        atol=INEXACT * size + 1e-9,  # pyright: ignore[reportArgumentType]
        norm=optx.rms_norm,
        max_steps=200,
    )
    solver = optx.LevenbergMarquardt(
        rtol=1e-3, atol=1e-3, linear_solver=lx.Normal(inexact)
    )
    solution = optx.least_squares(
        _residuals, solver, unchanged, args=problem, max_steps=steps, throw=False
    )
    cylinder = _changed(problem, solution.value)
    distance = _distance(cylinder, contour, members)
    error = float(jnp.median(jnp.linalg.norm(distance, axis=2)))
    fitted = eqx.tree_at(lambda t: t.cylinder, tree, cylinder)
    return FittedTree(fitted, error, str(optx.RESULTS[solution.result]))


def _flexible(cylinder: GeneralizedCylinder):
    return cylinder.skeleton, cylinder.scale, cylinder.twist, cylinder.shear


def _with(cylinder: GeneralizedCylinder, values) -> GeneralizedCylinder:
    return eqx.tree_at(_flexible, cylinder, values)


def _distance(
    cylinder: GeneralizedCylinder, contour, members: Members
) -> Float[Array, "members knots 3"]:
    """Return the clusters' strands less the given ones, without their roots."""
    frames = jax.vmap(cylinder_frames)(cylinder)
    contour, cylinder, frames = jax.tree.map(
        lambda leaf: leaf[members.owner], (contour, cylinder, frames)
    )
    whole = jnp.ones(len(members.owner), members.knots.dtype)
    knots = jax.vmap(strand_knots)(contour, cylinder, frames, members.uv, whole)
    return knots[:, 1:] - members.knots[:, 1:]


def _units(
    start: GeneralizedCylinder, owner: Int[Array, " members"], weight: Array
) -> tuple[Array, Array]:
    """Return what one unit of change is, of skeletons and maps of each cluster.

    Each is the reciprocal root of the diagonal of the normal equations, so that
    conjugate gradients need few steps: a Jacobi preconditioner.
    """
    count = jnp.zeros_like(start.radius[:, 0]).at[owner].add(weight)
    # A strand lies at about two thirds of the contour's radius.
    reach = (2.0 / 3.0) * start.radius[:, 0] / SPREAD
    skeleton = jax.lax.rsqrt(count / SPREAD**2 + 1.0 / SKELETON_PRIOR**2)
    maps = jax.lax.rsqrt(0.5 * count * reach**2 + 1.0 / MAP_PRIOR**2)
    return skeleton, maps


def _in_metres(units: tuple[Array, Array], change):
    """Return a change in metres and without unit, from one in units."""
    skeleton, scale, twist, shear = change
    length, share = units
    return (
        length[:, None, None] * skeleton,
        share[:, None, None] * scale,
        share[:, None] * twist,
        share[:, None] * shear,
    )


def _changed(problem: Problem, change) -> GeneralizedCylinder:
    before = _flexible(problem.start)
    after = jax.tree.map(jnp.add, before, _in_metres(problem.units, change))
    return _with(problem.start, after)


def _residuals(change, problem: Problem):
    distance = _distance(_changed(problem, change), problem.contour, problem.members)
    distance = distance * problem.weight[:, None, None] ** 0.5
    skeleton, *maps = _in_metres(problem.units, change)
    return distance / SPREAD, skeleton / SKELETON_PRIOR, [m / MAP_PRIOR for m in maps]


def _half_square(change, problem: Problem) -> Float[Array, ""]:
    parts = jax.tree.leaves(_residuals(change, problem))
    return 0.5 * jnp.sum(jnp.stack([jnp.sum(part**2) for part in parts]))


def cylinders_along(
    contour: ScalpContour,
    metric: Float[np.ndarray, " clusters"],
    skeleton: Float[np.ndarray, "clusters knots 3"],
    maps: Float[np.ndarray, "clusters knots 3 2"],
) -> GeneralizedCylinder:
    """Return the cylinders whose strands follow linear maps of their roots' places.

    Of a map only what lies in the cross-section's plane is kept.

    Args:
        contour: The scalp contours, stacked.
        metric: Metres on the scalp for 1 of scalp space, for each contour.
        skeleton: The strands at the contours' centres.
        maps: How a strand's knots move in metres with its root, in metres along u, v.
    """
    # Filled up, so that trees of about as many clusters share a program.
    count, room = len(skeleton), together(len(skeleton))
    maps, skeleton = more_rows(maps, room), more_rows(skeleton, room)
    radius = more_rows(np.asarray(contour.radius) * metric, room)
    offset = more_rows(np.asarray(contour.offset) * metric[:, None], room)
    knots = skeleton.shape[1]
    plain = jax.vmap(GeneralizedCylinder)(
        on_device(skeleton),
        on_device(maps[:, 0, :, 0]),
        on_device(np.tile(radius[:, None], (1, knots))),
        on_device(np.tile(offset[:, None], (1, knots, 1))),
        on_device(np.ones((room, knots, 2))),
        on_device(np.zeros((room, knots))),
        on_device(np.zeros((room, knots))),
    )
    frames = frames_of(plain)
    across = np.stack([np.asarray(frames.normal), np.asarray(frames.binormal)], axis=2)
    sections = np.einsum("gkij,gkjl->gkil", across, maps)
    found = _with_sections(plain, on_device(sections, plain.scale.dtype))
    return jax.tree.map(lambda leaf: on_device(np.asarray(leaf)[:count]), found)


_with_sections = jax.jit(jax.vmap(with_section_maps))
