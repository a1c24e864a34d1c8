import numpy as np
import pytest
from ball_hair import all_centres, hull_where
from scipy.spatial import KDTree

from hairfit.fit.branches import FINE, RISE, empty_places, meetings, with_branches
from hairfit.fit.evidence import Field
from hairfit.fit.grow import GrowConfig, grow, space_of
from hairfit.types import resample_paths

SPACING = 0.004
CONFIG = GrowConfig(spread=0.0)
NECK, LENGTH, WIDE = 0.006, 0.16, 0.03


@pytest.fixture(scope="module")
def bottle():
    """A hull that hangs down, a neck above and wide below, and its field and flow."""

    def inside(p):
        radius = np.hypot(p[:, 0], p[:, 2])
        neck = (radius < NECK) & (p[:, 1] > -0.04)
        body = (radius < WIDE) & (p[:, 1] <= -0.04) & (p[:, 1] > -LENGTH)
        return (neck | body) & (p[:, 1] < 0.0)

    hull = hull_where(inside, [-0.05, -0.18, -0.05], [0.05, 0.0, 0.05], SPACING)
    p = hull.grid.centres(np.ones(hull.grid.shape, bool))
    out = np.clip((-0.04 - p[:, 1]) / 0.03, 0.0, 1.0) * (p[:, 1] > -0.07)
    away = p[:, [0, 2]] / np.maximum(np.hypot(p[:, 0], p[:, 2]), 0.01)[:, None]
    line = np.stack([out * away[:, 0], np.full(len(p), -1.0), out * away[:, 1]], axis=1)
    line /= np.linalg.norm(line, axis=1, keepdims=True)
    flow = line.reshape(*hull.grid.shape, 3)
    signs = np.random.default_rng(0).choice([-1.0, 1.0], hull.grid.shape)
    field = Field(flow * signs[..., None], np.ones(hull.grid.shape))
    return hull, field, flow


@pytest.fixture(scope="module")
def straight():
    """Strands down the middle: what comes out of the neck has not spread."""
    side = np.linspace(-0.003, 0.003, 16)
    x, z = np.meshgrid(side, side)
    roots = np.stack([x, np.full_like(x, -0.002), z], axis=-1).reshape(-1, 3)
    return roots[:, None] + np.linspace(0.0, 0.15, 30)[:, None] * [0.0, -1.0, 0.0]


def share_covered(hull, strands):
    """Return the share of the hull that has a strand within 6 mm."""
    points = resample_paths(strands, FINE).reshape(-1, 3)
    return np.mean(KDTree(points).query(hull.grid.centres(hull.hair))[0] < 0.006)


def test_a_hull_behind_a_neck_is_filled(bottle, straight):
    hull, field, flow = bottle
    found = with_branches(hull, space_of(hull, field, flow), straight, CONFIG, 0)
    assert share_covered(hull, straight) < 0.25
    assert share_covered(hull, found.strands) > 0.6


def test_grown_strands_stay_and_branches_share_their_roots(bottle, straight):
    hull, field, flow = bottle
    found = with_branches(hull, space_of(hull, field, flow), straight, CONFIG, 0)
    count = len(straight)
    assert len(found.strands) > count + 5
    assert np.array_equal(found.strands[:count], straight)
    assert np.array_equal(found.origin[:count], np.arange(count))
    branch, origin = found.strands[count:], found.origin[count:]
    assert np.abs(branch[:, 0] - straight[origin, 0]).max() < 1e-12
    # They run down, never back up, and stay in the hull.
    assert (np.diff(branch[..., 1], axis=1) < 0.0).all()
    radius = np.hypot(branch[..., 0], branch[..., 2])
    assert radius.max() < WIDE + SPACING


def parted(high):
    """Hair on flat skin that goes to either side of x = 0, and strands close to it."""

    def inside(p):
        near = (np.abs(p[:, 0]) < 0.06) & (np.abs(p[:, 2]) < 0.02)
        return near & (p[:, 1] > 0.0) & (p[:, 1] < high)

    low, far = [-0.07, -0.01, -0.03], [0.07, high + 0.01, 0.03]
    hull = hull_where(inside, low, far, SPACING, head=lambda p: p[:, 1])
    flow = np.zeros((*hull.grid.shape, 3))
    flow[..., 0] = np.sign(all_centres(hull)[..., 0])
    space = space_of(hull, Field(flow, np.ones(hull.grid.shape)), flow)
    x, z = np.meshgrid(np.linspace(0.004, 0.04, 10), np.linspace(-0.018, 0.018, 9))
    roots = np.stack([x, np.full_like(x, 0.002), z], axis=-1).reshape(-1, 3)
    along = np.linspace(0.0, 1.0, 30)[:, None] * [1.0, 0.0, 0.0]
    right = roots[:, None] + (0.058 - roots[:, None, :1]) * along
    return hull, space, np.concatenate([right, right * [-1.0, 1.0, 1.0]])


def test_outer_hair_rises_from_the_roots_along_its_parting():
    hull, space, strands = parted(0.024)
    found = with_branches(hull, space, strands, CONFIG, 0)
    branch = found.strands[len(strands) :]
    outer = branch[branch[..., 1].max(axis=1) > 0.01]
    assert len(outer) > 10
    # From roots next to the parting, up, and then along the flow to the end of it.
    assert np.abs(outer[:, 0, 0]).max() < 0.02
    assert np.abs(outer[:, 0, 1] - 0.002).max() < 1e-12
    assert np.abs(outer[:, -1, 0]).min() > 0.045
    assert share_covered(hull, strands) < 0.5
    assert share_covered(hull, found.strands) > 0.9


def test_nothing_rises_to_hair_far_above_the_skin():
    hull, space, strands = parted(0.08)
    found = with_branches(hull, space, strands, CONFIG, 0).strands
    assert RISE - 2 * SPACING < found[..., 1].max() < RISE + 2 * SPACING


def test_the_same_seed_gives_the_same_branches(bottle, straight):
    hull, field, flow = bottle
    one, same, other = (
        with_branches(hull, space_of(hull, field, flow), straight, CONFIG, seed).strands
        for seed in (3, 3, 4)
    )
    assert np.array_equal(one, same)
    assert one.shape != other.shape or not np.allclose(one, other)


def test_a_hull_that_is_full_gets_none(bottle):
    hull, field, flow = bottle
    roots = hull.grid.centres(hull.hair)
    strands = grow(space_of(hull, field, flow), roots, np.zeros_like(roots), 20, CONFIG)
    found = with_branches(hull, space_of(hull, field, flow), strands, CONFIG, 0)
    assert np.array_equal(found.strands, strands)


def test_empty_is_what_no_strand_comes_near_within_the_hull(bottle, straight):
    hull = bottle[0]
    near = KDTree(resample_paths(straight, FINE).reshape(-1, 3))
    empty = empty_places(hull, near)
    assert len(empty)
    assert near.query(empty)[0].min() > 1.5 * SPACING
    assert np.hypot(empty[:, 0], empty[:, 2]).max() < WIDE - 0.5 * SPACING


def test_a_path_meets_the_first_strand_that_runs_its_way():
    # Up along y beside three strands: across it, against it, and its way.
    y = np.linspace(0.0, 0.1, 51)
    path = np.stack([np.zeros(51), y, np.zeros(51)], axis=1)[None]
    side = np.linspace(-0.02, 0.02, 51)
    across = np.stack([side, np.full(51, 0.02), np.full(51, 0.001)], axis=1)
    against = np.stack([np.full(51, 0.002), 0.03 + 0.02 * y / 0.1, 0 * y], axis=1)
    along = np.stack([np.full(51, -0.002), 0.09 - 0.02 * y / 0.1, 0 * y], axis=1)
    strands = np.stack([across, against, along])
    found = meetings(strands, KDTree(strands.reshape(-1, 3)), path, 0.003)
    assert found.strand.tolist() == [2]
    # It reaches the strand's tip, at 70 mm, from below; a branch leaves it before, by
    # three times the way over.
    place = path[0, found.step[0]]
    assert abs(place[1] - 0.07) < 0.003
    gap = np.linalg.norm(strands[2] - place, axis=1).min()
    assert abs(strands[2, found.at[0], 1] - (0.07 + 3.0 * gap)) < 0.0005


def test_a_path_that_meets_nothing_says_so():
    strand = np.stack([np.linspace(0, 0.1, 20)] + 2 * [np.zeros(20)], axis=1)[None]
    found = meetings(strand, KDTree(strand[0]), strand + 0.05, 0.003)
    assert found.strand.tolist() == [-1]
