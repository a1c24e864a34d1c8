"""Waves that a fit smooths, given back to the clusters of hair that waves.

A voxel of the field holds locks that wave out of step, and so does a pixel of a map: a
fit keeps some 0.6 of the swing that shows and hardly any beneath. How far hair truly
swings, the angles at which it crosses its locks tell, see `slopes`. So leaves whose
field swings at all get waves of that height, at the field's phase; photographs then
correct them, see `presets.by_photographs`, to what their maps show, and what these
lack is made up. Deep within hair nothing tells a phase: there hair stays as it is, as
a wave at a wrong phase is farther from the true one than none.
"""

from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float
from scipy import ndimage

from ..host import more_rows, on_device
from ..model.cylinder import GeneralizedCylinder
from ..model.section import on_skeleton
from ..model.tree import HairTree, filled, leaves, with_cylinders
from ..types import along_paths, resample_paths
from .evidence import Field
from .hull import Hull

POINTS = 128  # of each middle line
# Standard deviations of Gaussians along a line, in waves: of the mean about which hair
# waves, and of that in which waves are alike.
MEAN, ALIKE = 0.4, 0.8
# A leaf waves whose field swings by this share of the height that hair has.
SWINGS = 0.05
# And its photographs where its own swing is this share of it.
SEEN = 0.2
# How much farther hair swings than its maps show. They show 0.7 of it, but not always
# where it is: so less than all is made up.
MAP_LOSES = 1.3
STEEPEST = 0.4  # cosine to its middle line, beyond which hair does not wave about it
ROOTED = 0.5  # waves from the root on, over which waves grow to their height


class Lines(NamedTuple):
    """Leaves' skeletons, and the middle lines about which they wave.

    Attributes:
        skeleton: Points at equal distances along the skeletons, in metres.
        middle: The same points on the middle lines.
        along: Metres from the root, along the middle line.
        spacing: Metres from point to point, in the mean.
        wave: Length of a wave, in metres.
    """

    skeleton: Float[np.ndarray, "leaves points 3"]
    middle: Float[np.ndarray, "leaves points 3"]
    along: Float[np.ndarray, "leaves points"]
    spacing: Float[np.ndarray, " leaves"]
    wave: float

    def turn(self) -> Complex[np.ndarray, "leaves points 1"]:
        """Return by how much waves have turned at each point, as a unit number."""
        return np.exp(2j * np.pi / self.wave * self.along)[..., None]

    def swinging(
        self, size: Float[np.ndarray, "leaves points"], least: float
    ) -> Bool[np.ndarray, " leaves"]:
        """Return which leaves hold a wave and swing by so much, in quadratic mean."""
        far = np.sqrt(np.mean(size**2, axis=1)) > least
        return far & (self.along[:, -1] > self.wave)


def with_waves(
    tree: HairTree,
    hull: Hull,
    field: Field,
    wave: float,
    height: float,
    *,
    room: int = 0,
) -> HairTree:
    """Return the tree with waves of full height in leaves whose field swings.

    Args:
        tree: The tree.
        hull: Where hair can be.
        field: Which way it runs there.
        wave: Length of a wave, in metres.
        height: From the middle line to the crest, in metres.
        room: Arrays hold so many clusters, if the tree has fewer.
    """
    lines = middle_lines(tree, wave)
    slope, sure = field_slopes(lines, hull, field)
    slope -= smoothed(slope, 0.5 * wave / lines.spacing)
    swing = swings(lines, slope, sure) * (wave / (2j * np.pi))
    size = np.linalg.norm(swing, axis=2)
    full = swing * (height / np.maximum(size, 1e-9))[..., None]
    some = lines.swinging(size, SWINGS * height)
    return waved(tree, lines.middle, lines, full, some, room)


def with_lost_waves(
    tree: HairTree, wave: float, height: float, *, room: int = 0
) -> HairTree:
    """Return the tree with the swing made up that maps lack, up to the full height.

    Args:
        tree: A tree that was refined by maps.
        wave: Length of a wave, in metres.
        height: From the middle line to the crest, in metres.
        room: Arrays hold so many clusters, if the tree has fewer.
    """
    lines = middle_lines(tree, wave)
    sure = np.ones(lines.along.shape)
    swing = swings(lines, lines.skeleton - lines.middle, sure)
    size = np.linalg.norm(swing, axis=2)
    more = np.clip(height / np.maximum(size, 1e-9), 1.0, MAP_LOSES) - 1.0
    some = lines.swinging(size, SEEN * height)
    return waved(tree, lines.skeleton, lines, swing * more[..., None], some, room)


def middle_lines(tree: HairTree, wave: float) -> Lines:
    """Return the leaves' skeletons and what they wave about."""
    skeleton = np.asarray(tree.cylinder.skeleton, np.float64)[leaves(tree)]
    even = resample_paths(skeleton, POINTS)
    spacing = np.maximum(along_paths(even)[:, -1], 1e-6) / (POINTS - 1)
    middle = smoothed(even, MEAN * wave / spacing)
    return Lines(even, middle, along_paths(middle), spacing, wave)


def smoothed(
    values: Float[np.ndarray, "leaves points axes"], sigma: Float[np.ndarray, " leaves"]
) -> Float[np.ndarray, "leaves points axes"]:
    """Return Gaussian means along lines, which go on beyond their ends as before.

    Args:
        values: At even points of each line.
        sigma: Standard deviation for each line, in points.
    """
    beyond = values.shape[1] - 1
    first, last = values[:, :1], values[:, -1:]
    before, after = values[:, :0:-1], values[:, -2::-1]
    whole = np.concatenate([2 * first - before, values, 2 * last - after], axis=1)
    mean = blurred(whole, sigma, "reflect")
    return mean[:, beyond : beyond + values.shape[1]]


def blurred(
    values: Float[np.ndarray, "leaves points axes"],
    sigma: Float[np.ndarray, " leaves"],
    beyond: Literal["constant", "reflect"],
) -> Float[np.ndarray, "leaves points axes"]:
    """Return Gaussian means along lines, of what SciPy has `beyond` their ends."""
    mean = [
        ndimage.gaussian_filter1d(row, one, axis=0, mode=beyond)
        for row, one in zip(values, sigma, strict=True)
    ]
    return np.stack(mean)


def field_slopes(
    lines: Lines, hull: Hull, field: Field
) -> tuple[Float[np.ndarray, "leaves points 3"], Float[np.ndarray, "leaves points"]]:
    """Return how far the field goes across middle lines, and how sure it is.

    Metres across for each metre along.
    """
    shape = np.array(hull.grid.shape) - 1
    voxel = hull.grid.voxel(lines.middle.reshape(-1, 3))
    at = tuple(np.clip(voxel, 0, shape).T)
    line = field.direction[at].reshape(lines.middle.shape)
    sure = field.anisotropy[at].reshape(lines.along.shape)
    ahead = np.gradient(lines.middle, axis=1)
    ahead /= np.maximum(np.linalg.norm(ahead, axis=2, keepdims=True), 1e-9)
    along = np.sum(line * ahead, axis=2, keepdims=True)
    line, along = line * np.sign(along), np.abs(along)
    slope = (line - along * ahead) / np.maximum(along, STEEPEST)
    return slope, np.maximum(sure, 1e-3)


def swings(
    lines: Lines,
    across: Float[np.ndarray, "leaves points 3"],
    weight: Float[np.ndarray, "leaves points"],
) -> Complex[np.ndarray, "leaves points 3"]:
    """Return how what is across lines swings as waves do: its height and its phase.

    Args:
        lines: The lines.
        across: What swings.
        weight: What each point says.

    Returns:
        A slowly varying number, which times `Lines.turn` has the swing as its real
        part.
    """
    turned = weight[..., None] * across / lines.turn()
    parts = np.concatenate([turned.real, turned.imag, weight[..., None]], axis=2)
    found = blurred(parts, ALIKE * lines.wave / lines.spacing, "constant")
    found = 2.0 * found / np.maximum(found[..., 6:], 1e-9)
    return found[..., :3] + 1j * found[..., 3:6]


def waved(
    tree: HairTree,
    base: Float[np.ndarray, "leaves points 3"],
    lines: Lines,
    swing: Complex[np.ndarray, "leaves points 3"],
    some: Bool[np.ndarray, " leaves"],
    room: int,
) -> HairTree:
    """Return the tree with some of its leaves on other skeletons.

    Args:
        tree: The tree.
        base: What is swung about, for each leaf.
        lines: Where the leaves' waves stand.
        swing: Their waves: their real part, turned along the line.
        some: Which leaves get them.
        room: Arrays hold so many clusters, if the tree has fewer.
    """
    rises = np.minimum(lines.along / (ROOTED * lines.wave), 1.0)[..., None]
    path = base + rises * np.real(swing * lines.turn())
    path[:, 0] = lines.skeleton[:, 0]
    skeleton = np.array(tree.cylinder.skeleton)
    changed = np.zeros(tree.count, bool)
    changed[np.asarray(leaves(tree))[some]] = True
    skeleton[changed] = resample_paths(path[some], skeleton.shape[1])
    whole = filled(tree, room).cylinder
    given = more_rows(skeleton, room), more_rows(changed, room)
    return with_cylinders(tree, place(whole, *(on_device(one) for one in given)))


@jax.jit
def place(
    cylinder: GeneralizedCylinder,
    skeleton: Float[Array, "clusters knots 3"],
    some: Bool[Array, " clusters"],
) -> GeneralizedCylinder:
    """Return clusters of which some are on other skeletons."""
    moved = jax.vmap(on_skeleton)(cylinder, skeleton)

    def chosen(new, old):
        return jnp.where(some.reshape(-1, *[1] * (new.ndim - 1)), new, old)

    return jax.tree.map(chosen, moved, cylinder)
