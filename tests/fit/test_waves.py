import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from ball_hair import all_centres, hull_where

from hairfit.fit.evidence import Field
from hairfit.fit.waves import MAP_LOSES, POINTS, smoothed, with_lost_waves, with_waves
from hairfit.model import HairTree, leaves, take
from hairfit.synthetic import make_head, make_scalp, make_style

WAVE, HEIGHT, PHASE = 0.05, 0.004, 0.7
KNOTS, LENGTH = 40, 0.25
APART = 0.04  # metres between leaves
HANGS, SHORT, STILL = 0, 1, 2  # leaves
INNER = slice(8, -8)  # knots at which neither root nor tip counts


def height_at(along, height=HEIGHT):
    """Return how far hair is from its middle line, so many metres from the root."""
    return height * np.cos(2.0 * np.pi * along / WAVE + PHASE)


@pytest.fixture(scope="module")
def hanging():
    """Return a tree of three leaves that hang straight down, the second a short one."""
    tree = make_style("straight", 0, make_scalp(make_head()))
    some = leaves(tree)[:3]
    keep = np.isin(np.arange(tree.count), [*some, *np.asarray(tree.parent)[some]])
    tree = take(tree, keep)
    parts = ("skeleton", "radius", "offset", "scale", "twist", "shear")
    tree = eqx.tree_at(
        lambda t: [getattr(t.cylinder, name) for name in parts],
        tree,
        replace_fn=lambda row: jnp.repeat(row[:, :1], KNOTS, axis=1),
    )
    down = np.linspace(0.0, LENGTH, KNOTS)
    lines = np.zeros((3, KNOTS, 3))
    lines[..., 0] = APART * np.arange(3)[:, None]
    lines[..., 1] = -down * np.array([1.0, 0.12, 1.0])[:, None]
    return on(tree, lines)


def on(tree: HairTree, lines) -> HairTree:
    """Return the tree with its leaves on other skeletons."""
    skeleton = np.array(tree.cylinder.skeleton)
    skeleton[leaves(tree)] = lines
    return eqx.tree_at(lambda t: t.cylinder.skeleton, tree, jnp.asarray(skeleton))


def skeletons(tree: HairTree):
    return np.asarray(tree.cylinder.skeleton, float)[leaves(tree)]


def waving_field(hull, share):
    """Return a field that swings by a share of the hair, but at the last leaf."""
    centres = all_centres(hull)
    turn = 2.0 * np.pi / WAVE
    slope = -share * HEIGHT * turn * np.sin(-turn * centres[..., 1] + PHASE)
    slope = np.where(centres[..., 0] > 1.5 * APART, 0.0, slope)
    line = np.stack([slope, -np.ones_like(slope), np.zeros_like(slope)], axis=-1)
    line /= np.linalg.norm(line, axis=-1, keepdims=True)
    return Field(-line, np.ones(hull.grid.shape))


@pytest.fixture(scope="module")
def hull():
    low, high = (-0.02, -0.27, -0.02), (0.1, 0.02, 0.02)
    return hull_where(lambda points: np.ones(len(points), bool), low, high, 0.003)


@pytest.mark.parametrize("share", [0.3, 1.0])
def test_hair_waves_at_its_height_and_phase_however_little_its_field_swings(
    hanging, hull, share
):
    tree = with_waves(hanging, hull, waving_field(hull, share), WAVE, HEIGHT)
    found = skeletons(tree)[HANGS]
    off = found[:, 0] - height_at(-found[:, 1])
    assert np.abs(off[INNER]).max() < 0.12 * HEIGHT
    assert np.abs(found[:, 2]).max() < 0.05 * HEIGHT
    assert np.array_equal(found[0], skeletons(hanging)[HANGS, 0])


def test_neither_short_hair_waves_nor_hair_whose_field_does_not(hanging, hull):
    tree = with_waves(hanging, hull, waving_field(hull, 1.0), WAVE, HEIGHT)
    before, after = skeletons(hanging), skeletons(tree)
    assert np.array_equal(before[SHORT], after[SHORT])
    assert np.array_equal(before[STILL], after[STILL])
    assert not np.allclose(before[HANGS], after[HANGS], atol=0.5 * HEIGHT)
    upper = np.setdiff1d(np.arange(tree.count), leaves(tree))
    for one, other in zip(
        jax.tree.leaves(hanging.cylinder), jax.tree.leaves(tree.cylinder), strict=True
    ):
        assert np.array_equal(np.asarray(one)[upper], np.asarray(other)[upper])


def test_more_room_changes_nothing(hanging, hull):
    given = hull, waving_field(hull, 1.0), WAVE, HEIGHT
    few, many = with_waves(hanging, *given), with_waves(hanging, *given, room=16)
    assert many.count == few.count
    assert np.allclose(skeletons(few), skeletons(many), atol=1e-7)


@pytest.mark.parametrize(
    ("share", "grown"), [(0.5, 0.5 * MAP_LOSES), (0.9, 1.0), (1.2, 1.2), (0.1, 0.1)]
)
def test_what_maps_lack_of_waves_is_made_up_but_no_more(hanging, share, grown):
    lines = skeletons(hanging)
    down = -lines[HANGS, :, 1]
    lines[HANGS, :, 0] += height_at(down, share * HEIGHT)
    tree = with_lost_waves(on(hanging, lines), WAVE, HEIGHT)
    found = skeletons(tree)[HANGS]
    off = found[:, 0] - height_at(-found[:, 1], grown * HEIGHT)
    assert np.abs(off[INNER]).max() < 0.15 * HEIGHT
    assert np.array_equal(found[0].astype(np.float32), lines[HANGS, 0].astype("f4"))
    assert np.array_equal(skeletons(tree)[STILL], lines[STILL].astype("f4"))


def test_means_along_a_line_that_goes_straight_are_the_line():
    line = np.linspace(0.0, 1.0, POINTS)[None, :, None] * np.array([1.0, -2.0, 0.5])
    assert np.allclose(smoothed(line, np.array([9.0])), line, atol=1e-9)
