"""Programs that are compiled on other cores while photographs are looked at.

Nothing here changes what a fit finds: it only calls what will be called later, with
arrays of the same shapes, so that it need not be compiled when its turn comes.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from numpy.typing import DTypeLike

from ..capture.scalp_wrap import cap_weights
from ..host import on_device
from ..model.collide import DistanceField
from ..model.contour import ANGLES
from ..model.cylinder import GeneralizedCylinder, frames_of, together
from ..model.maps import even_maps, keep_roots
from ..model.scalp import SIDE, Scalp, normals_on, points_on, sample_roots
from ..model.strand import ROUNDS, grow
from ..model.tree import Clusters, HairTree, ScalpContour
from ..render.lights import DistantLight
from ..render.lit import light_at, number
from ..render.scene import HairLook, Scene, head_places
from ..types import Mesh
from .appearance import CASTING, LIGHTS, LIT, SHADOWS, both_terms, some_of
from .bare import PIXELS
from .cluster import scalp_metric
from .cylinders import cylinders_along
from .density import TEXELS
from .devices import BY_BOTH, BY_VIEW, EVERYWHERE, device_mesh, put
from .gather import Rooted
from .grow import AT_ONCE, GrowConfig, Space, trace
from .refine import (
    Found,
    Problem,
    RefineConfig,
    Turn,
    descend,
    move,
    shared_out,
    still,
)
from .residuals import PULLS, SHRINK, PhotoMaps, Pulls
from .samples import Samples, grow_placed, place
from .treeify import on_scalp
from .volume import DRAWN, Gaps, HairVolume, room_for
from .wisps import wisp_residuals

MOST_THREADS = 4


class Shapes(NamedTuple):
    """How large the arrays of a refinement are.

    Attributes:
        views: Number of photographs.
        size: Height and width of the largest one, in pixels.
        grid: Voxels along x, y and z.
        clusters: Clusters that the arrays hold.
        knots: Knots of a skeleton.
    """

    views: int
    size: tuple[int, int]
    grid: tuple[int, int, int]
    clusters: int
    knots: int


def spare_threads() -> int:
    """Return how many programs are compiled at once, beside the other work."""
    return max(1, min(MOST_THREADS, (os.cpu_count() or 1) // 2))


@contextmanager
def compiling_ahead(threads: int = 1) -> Iterator[Callable[..., None]]:
    """Give a function that calls others beside what the context does.

    They begin in their order. The context ends when they are done as well; where it
    fails, those that wait are left out.

    Args:
        threads: How many are called at once.
    """
    with ThreadPoolExecutor(threads) as beside:
        calls: list[Future[None]] = []
        try:
            yield lambda *call: calls.append(beside.submit(*call))
        except BaseException:
            beside.shutdown(wait=False, cancel_futures=True)
            raise
        for call in calls:
            call.result()


def compile_growth(guides: int, others: Sequence[int]) -> None:
    """Sample roots of so many guides, and others, on no scalp; weigh its cap.

    And ask where they are, as what becomes a tree is asked.
    """
    scalp = Scalp(on_device(np.zeros((SIDE, SIDE, 3))))
    key = jax.random.key(0)
    uv = sample_roots(scalp, guides, key)
    points_on(scalp, uv)
    normals_on(scalp, uv)
    on_scalp(scalp, np.zeros((1, 2)))
    for count in others:
        sample_roots(scalp, count, key)
    cap_weights()


def compile_paths(shape: tuple[int, int, int], config: GrowConfig) -> None:
    """Grow along nothing, on a grid of this shape."""
    space = Space(zeros(*shape, 8), zeros(*shape, 9), zeros(3), zeros())
    trace(space, zeros(AT_ONCE, 3), zeros(AT_ONCE, 3), config)


def compile_looks(strands: int, points: int, views: int, head: Mesh) -> None:
    """Light a head, and so many strands as so many photographs show them, by one lamp.

    Args:
        strands: How many strands the fit has.
        points: Points of each.
        views: How many photographs are compared.
        head: The head.
    """
    few = some_of(some_of(np.zeros((strands, points, 3)), LIT), CASTING)
    scene = Scene(few, look=HairLook(width=1e-4), head=head, shadows=SHADOWS)
    lamp = DistantLight(on_device(np.array([0.0, 1.0, 0.0])), jnp.ones(3))
    pixels = np.zeros((views * PIXELS, 3))
    light_at(np.concatenate([pixels, head_places(head)]), scene, (lamp,))
    tangents, ways = on_device(pixels, number()), zeros(LIGHTS, 3, dtype=number())
    both_terms(tangents, ways, tangents)


def compile_refinement(shapes: Shapes, config: RefineConfig) -> None:
    """Refine nothing, in no steps."""
    mesh = device_mesh(shapes.views, config.strands)
    problem = shared_out(empty_problem(shapes, config), mesh)
    turn = Turn(zeros(dtype=np.int32), zeros(shapes.clusters, dtype=np.int32))
    moves = still(problem.cylinder)
    move(problem, moves, turn)
    before = grow_placed(problem.cylinder, problem.placed, config.points)
    segments = (shapes.views, config.strands, config.points - 1)
    pulls, index = (shapes.views, PULLS), np.int32
    strand, empty = zeros(*pulls, dtype=index), zeros(DRAWN, dtype=index)
    found = Found(
        put(mesh, zeros(*segments, dtype=bool), BY_BOTH),
        put(mesh, Pulls(strand, strand, zeros(*pulls, 2), zeros(*pulls)), BY_VIEW),
        put(mesh, Gaps(empty, empty, zeros(DRAWN, 3), zeros(DRAWN)), EVERYWHERE),
    )
    descend(problem, before, moves, found, turn, zeros(dtype=index), config, mesh)


def compile_strands(clusters: int, knots: int, count: int, points: int) -> None:
    """Grow so many strands of a tree of about so many clusters, on no scalp.

    And what goes before: the tree's cylinders are made and compared with strands, and a
    map lets roots grow.
    """
    scalp, some = Scalp(zeros(SIDE, SIDE, 3)), together(clusters)
    contour, cylinder = empty_clusters(some, knots)
    tree = HairTree(scalp, contour, cylinder, zeros(some), (-1,) * some)
    strand = Rooted(np.zeros((1, 2)), np.zeros((1, knots, 3)), np.zeros((1, 3, 2)))
    metric, lines = np.ones(some), np.zeros((some, knots, 3))
    scalp_metric(scalp, contour)
    cylinders_along(contour, metric, lines, np.zeros((some, knots, 3, 2)))
    wisp_residuals(tree, strand, np.zeros(1, int))
    roots = zeros(count, 2), zeros(count, dtype=np.int32), zeros(count)
    grow(scalp, contour, cylinder, *roots, points, None)
    key, *_ = jax.random.split(jax.random.key(0), ROUNDS + 1)
    keep_roots(even_maps(TEXELS, TEXELS), zeros(count, 2), key)


def zeros(*shape: int, dtype: DTypeLike = np.float32) -> Array:
    """Return zeros that nothing had to be compiled for."""
    return on_device(np.zeros(shape, dtype))


def empty_clusters(count: int, knots: int) -> Clusters:
    """Return so many clusters' arrays without anything in them."""
    return Clusters(
        jax.vmap(ScalpContour)(zeros(count, 2), zeros(count), zeros(count, ANGLES)),
        jax.vmap(GeneralizedCylinder)(
            zeros(count, knots, 3),
            zeros(count, 3),
            zeros(count, knots),
            zeros(count, knots, ANGLES),
            zeros(count, knots, 2),
            zeros(count, knots),
            zeros(count, knots),
        ),
    )


def empty_problem(shapes: Shapes, config: RefineConfig) -> Problem:
    """Return a refinement's arrays without anything in them."""
    count, knots, views = shapes.clusters, shapes.knots, shapes.views
    height, width = (edge // SHRINK for edge in shapes.size)
    grid = room_for(shapes.grid)
    clusters = empty_clusters(count, knots)
    samples = Samples(zeros(config.strands, 2), zeros(config.strands, dtype=np.int32))
    return Problem(
        clusters.cylinder,
        frames_of(clusters.cylinder),
        zeros(count, dtype=np.int32),
        place(Scalp(zeros(SIDE, SIDE, 3)), clusters, samples),
        PhotoMaps(
            zeros(views, height, width, 2),
            zeros(views, height, width),
            zeros(views, height, width),
            zeros(views, 3, 3),
            zeros(views, 4, 4),
            zeros(views),
        ),
        HairVolume(DistanceField(zeros(3), zeros(), zeros(*grid)), zeros(*grid, 6)),
    )
