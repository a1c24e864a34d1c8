import dataclasses

import numpy as np
import pytest
from ball_hair import RADIUS, hull_where, meridian

from hairfit.fit.evidence import Field
from hairfit.fit.grow import (
    AT_ONCE,
    CIRCLE,
    ROUND,
    WOUND,
    GrowConfig,
    grow,
    space_of,
    steps_on,
)
from hairfit.fit.shorn import LENGTH

CONFIG = GrowConfig()
SPACING = 0.004


def tube(radius=0.03, length=0.2):
    """Return a hull around the y axis that reaches from 0 down to `-length`."""

    def inside(p):
        return (np.hypot(p[:, 0], p[:, 2]) < radius) & (p[:, 1] > -length)

    side = radius + 0.02
    return hull_where(
        inside, [-side, -length - 0.02, -side], [side, 0.0, side], SPACING
    )


def constant(hull, direction, seed=None):
    """Return a field of one direction, its signs at random."""
    unit = np.asarray(direction, float) / np.linalg.norm(direction)
    everywhere = np.tile(unit, (*hull.grid.shape, 1))
    if seed is not None:
        signs = np.random.default_rng(seed).choice([-1.0, 1.0], hull.grid.shape)
        everywhere = everywhere * signs[..., None]
    return Field(everywhere, np.ones(hull.grid.shape))


def one_way(hull, direction):
    """Return a flow of one direction."""
    return constant(hull, direction).direction


DOWN = np.tile([0.0, -1.0, 0.0], (5, 1))
ROOTS = np.array(
    [[0, -0.01, 0], [0.02, -0.01, 0], [0, -0.02, 0.02], [-0.02, 0, 0], [0, 0, -0.02]],
    float,
)


def lengths(strands):
    return np.linalg.norm(np.diff(strands, axis=1), axis=2).sum(axis=1)


def test_in_a_constant_field_strands_run_straight_to_the_end_of_the_hull():
    hull = tube()
    field, flow = constant(hull, [0, 1, 0]), one_way(hull, [0, -1, 0])
    strands = grow(space_of(hull, field, flow), ROOTS, DOWN, 20)
    assert np.allclose(strands[:, 0], ROOTS, atol=1e-9)
    assert np.abs(strands[:, :, [0, 2]] - ROOTS[:, None, [0, 2]]).max() < 1e-5
    expected = 0.2 + ROOTS[:, 1]
    assert np.abs(lengths(strands) - expected).max() < 2 * CONFIG.step


def test_a_strand_grows_alike_alone_and_among_many():
    hull = tube()
    field, flow = constant(hull, [0.3, 1, 0.1]), one_way(hull, [0.1, -1, 0])
    rng = np.random.default_rng(0)
    roots = rng.uniform(-0.015, 0.015, (AT_ONCE + 40, 3)) - [0.0, 0.02, 0.0]
    down = np.tile(DOWN[:1], (len(roots), 1))
    many = grow(space_of(hull, field, flow), roots, down, 20)
    assert many.shape == (AT_ONCE + 40, 20, 3)
    for part in (slice(3, 4), slice(AT_ONCE - 2, AT_ONCE + 5)):
        alone = grow(space_of(hull, field, flow), roots[part], down[part], 20)
        assert np.allclose(alone, many[part], atol=1e-7)


def test_the_sign_of_the_field_does_not_matter():
    hull = tube()
    plain, mixed = (constant(hull, [0.1, 1, 0], seed) for seed in (None, 3))
    flow = one_way(hull, [0, -1, 0])
    one, other = (
        grow(space_of(hull, f, flow), ROOTS, DOWN, 20) for f in (plain, mixed)
    )
    assert np.allclose(one, other, atol=1e-5)


def test_strands_take_the_sense_of_the_flow_against_the_scalps_normal():
    hull = tube()
    roots = ROOTS - [0.0, 0.1, 0.0]
    field, flow = constant(hull, [0, 1, 0], seed=1), one_way(hull, [0, 1, 0])
    up = grow(space_of(hull, field, flow), roots, DOWN, 10)
    assert (up[:, -1, 1] > -0.02).all()


def test_strands_end_where_the_flow_comes_towards_them():
    hull = tube()
    flow = one_way(hull, [0, -1, 0])
    middle = ROOTS[0, 1] - 0.05
    height = hull.grid.centres(np.ones(hull.grid.shape, bool))[:, 1]
    flow = flow * np.where(height < middle, -1.0, 1.0).reshape(*hull.grid.shape, 1)
    strands = grow(space_of(hull, constant(hull, [0, 1, 0]), flow), ROOTS, DOWN, 20)
    assert np.abs(strands[:, -1, 1] - middle).max() < 2 * CONFIG.step


def whirl(inwards, radius=0.04):
    """Return a strand that runs around the y axis, and so much inwards."""
    hull = tube(radius=0.06)
    shape = hull.grid.shape
    centres = hull.grid.centres(np.ones(shape, bool)).reshape(*shape, 3)
    centres[..., 1] = 0.0
    way = np.cross([0.0, -1.0, 0.0], centres) - inwards * centres
    way /= np.maximum(np.linalg.norm(way, axis=-1, keepdims=True), 1e-9)
    root, ahead = np.array([[radius, -0.1, 0.0]]), np.array([[0.0, 0.0, 1.0]])
    return grow(space_of(hull, Field(way, np.ones(shape)), way), root, ahead, 200)


def test_strands_end_where_they_begin_to_run_in_circles():
    free, wound = whirl(0.0), whirl(0.25)
    assert lengths(free)[0] > 0.95 * CONFIG.longest
    assert lengths(wound)[0] > 0.1
    # On the smallest circle that is let pass, the chord of the arc is just as short.
    radius = np.linspace(0.5 * CIRCLE / np.pi, 0.02, 1000)
    chord = 2 * radius * np.sin(CIRCLE / (2 * radius))
    smallest = radius[np.abs(chord - ROUND * CIRCLE).argmin()]
    assert smallest < np.hypot(*wound[0, -1, [0, 2]]) < 1.5 * smallest


@pytest.mark.parametrize(("radius", "inwards"), [(0.016, 0.0), (0.02, 0.1)])
def test_strands_that_wind_about_a_bun_end_once_round(radius, inwards):
    strand = whirl(inwards, radius)
    assert WOUND - CONFIG.step < lengths(strand)[0] < 1.5 * WOUND
    around = np.unwrap(np.arctan2(strand[0, :, 0], strand[0, :, 2]))
    assert 0.8 < abs(around[-1] - around[0]) / (2.0 * np.pi) < 1.2


def test_strands_spread_with_the_flow_by_the_share_that_is_asked_for():
    hull = tube()
    field, flow = constant(hull, [0, 1, 0]), one_way(hull, [0.6, -0.8, 0.0])
    moved = []
    for spread in (0.0, 0.2):
        config = GrowConfig(spread=spread, longest=0.1)
        strands = grow(space_of(hull, field, flow), ROOTS[:1], DOWN[:1], 10, config)
        # The first direction is the flow's; it is forgotten halfway.
        moved.append(strands[0, -1] - strands[0, 5])
    assert abs(moved[0][0] / moved[0][1]) < 1e-4
    # The last direction says nothing else: 0.2 of 0.6 across, against 1 along.
    assert np.isclose(moved[1][0] / -moved[1][1], 0.2 * 0.6, rtol=0.05)


def test_strands_slide_along_the_hull_where_they_leave_it_at_a_low_angle():
    hull = tube()
    field = constant(hull, [np.sin(0.3), -np.cos(0.3), 0.0])
    strands = grow(space_of(hull, field, field.direction), ROOTS, DOWN, 40)
    assert np.hypot(strands[..., 0], strands[..., 2]).max() < 0.03 + SPACING
    assert (strands[:, -1, 1] < -0.19).all()


def test_stubble_ends_where_longer_hair_would_slide_along_the_hull():
    hull = tube()
    field = constant(hull, [np.sin(0.5), -np.cos(0.5), 0.0])
    short = field._replace(stubble=np.ones(hull.grid.shape, bool))
    slides, ends = (
        grow(space_of(hull, one, field.direction), ROOTS, DOWN, 40)
        for one in (field, short)
    )
    assert (slides[:, -1, 1] < -0.19).all()
    tips = ends[:, -1]
    assert np.abs(np.hypot(tips[:, 0], tips[:, 2]) - 0.03).max() < SPACING
    across = np.sqrt(0.03**2 - ROOTS[:, 2] ** 2) - ROOTS[:, 0]
    assert (lengths(ends) < across / np.sin(0.5) + 2 * SPACING).all()


def shorn_where(hull, inside):
    """Return a field that runs down, of shorn hair where `inside` of heights says."""
    height = hull.grid.centres(np.ones(hull.grid.shape, bool))[:, 1]
    shorn = inside(height).reshape(hull.grid.shape)
    return constant(hull, [0, -1, 0])._replace(shorn=shorn)


def test_strands_run_through_shorn_hair_no_farther_than_it_is_long():
    hull = tube()
    field = shorn_where(hull, lambda y: y < -0.1)
    strands = grow(space_of(hull, field, field.direction), ROOTS, DOWN, 40)
    assert np.abs(strands[:, -1, 1] + 0.1 + LENGTH).max() < SPACING + CONFIG.step
    field = shorn_where(hull, lambda y: (y < -0.1) & (y > -0.1 - 0.6 * LENGTH))
    strands = grow(space_of(hull, field, field.direction), ROOTS, DOWN, 40)
    assert (strands[:, -1, 1] < -0.19).all()


def test_strands_that_grow_among_shorn_hair_are_shorn_wherever_they_lead():
    hull = tube()
    field = shorn_where(hull, lambda y: y > -0.028)
    strands = grow(space_of(hull, field, field.direction), ROOTS, DOWN, 40)
    assert np.abs(lengths(strands) - LENGTH).max() < SPACING + CONFIG.step


def test_strands_end_where_they_leave_the_hull_steeply():
    hull = tube()
    level = np.tile([1.0, 0.0, 0.0], (5, 1))
    roots = ROOTS * [0.5, 1.0, 0.5] - [0.0, 0.1, 0.0]
    field = constant(hull, [1, 0, 0])
    strands = grow(space_of(hull, field, field.direction), roots, level, 20)
    border = np.sqrt(0.03**2 - roots[:, 2] ** 2)
    assert np.abs(strands[:, -1, 0] - border).max() < 2 * CONFIG.step


@pytest.mark.parametrize("lean", [0.3, 1.0])
def test_locks_of_curls_slide_within_the_hull_to_its_end(lean):
    hull = tube()
    field = constant(hull, [np.sin(lean), -np.cos(lean), 0.0])
    space = space_of(hull, field, field.direction)
    config = dataclasses.replace(steps_on(SPACING, curly=True), rim=0.009)
    locks = grow(space, 0.5 * ROOTS, DOWN, 40, config)
    far = np.hypot(locks[..., 0], locks[..., 2])
    assert np.abs(far[:, 25:35] - (0.03 - config.rim)).max() < 0.002
    assert (locks[:, -1, 1] < -0.19).all()


def test_locks_of_curls_that_meet_the_hull_head_on_end_there():
    hull = tube()
    level = np.tile([1.0, 0.0, 0.0], (3, 1))
    roots = np.array([[0.0, -0.1, 0.0], [-0.01, -0.11, 0.0], [0.01, -0.09, 0.0]])
    field = constant(hull, [1, 0, 0])
    space = space_of(hull, field, field.direction)
    locks = grow(space, roots, level, 20, steps_on(SPACING, curly=True))
    assert np.abs(locks[:, -1, 0] - 0.03).max() < 2 * CONFIG.step
    assert (lengths(locks) < 0.03 - roots[:, 0] + 2 * CONFIG.step).all()


def test_no_strand_is_longer_than_the_longest():
    hull = tube()
    config = GrowConfig(longest=0.06)
    field, flow = constant(hull, [0, 1, 0]), one_way(hull, [0, -1, 0])
    strands = grow(space_of(hull, field, flow), ROOTS, DOWN, 20, config)
    # The path starts at the root, then above the skin.
    assert (lengths(strands) < 0.06 + config.clearance + 1e-6).all()
    assert (lengths(strands) > 0.055).all()


@pytest.mark.parametrize("azimuth", [0.0, 1.0, 4.0])
def test_strands_that_come_back_to_the_head_do_not_enter_it(azimuth):
    hull = hull_where(
        lambda p: (
            (np.linalg.norm(p, axis=1) < 0.13)
            & (np.linalg.norm(p, axis=1) > RADIUS - 0.001)
        ),
        [-0.14] * 3,
        [0.14] * 3,
        0.005,
        head=lambda p: np.linalg.norm(p, axis=1) - RADIUS,
    )
    # Circles about an axis that touches the skin: they leave the head and come back.
    axis = np.array([np.sin(azimuth), 0.0, np.cos(azimuth)])
    points = hull.grid.centres(np.ones(hull.grid.shape, bool)) - RADIUS * axis
    up = np.array([0.0, 1.0, 0.0])
    circle = np.cross(points, np.cross(axis, up))
    circle /= np.maximum(np.linalg.norm(circle, axis=1, keepdims=True), 1e-9)
    shape = hull.grid.shape
    field = Field(circle.reshape(*shape, 3), np.ones(shape))
    rng = np.random.default_rng(0)
    roots = meridian(rng.uniform(0.9, 1.3, 60), azimuth + rng.uniform(-0.1, 0.1, 60))
    normals = roots / RADIUS
    # Out of the skin where all strands start, about the axis, and back.
    out = np.cross(roots - RADIUS * axis, np.cross(axis, up))
    sense = np.sign(np.einsum("ij,ij->i", out, normals).mean())
    flow = sense * field.direction
    strands = grow(space_of(hull, field, flow), roots, normals, 60)
    away = np.linalg.norm(strands, axis=2)
    back = (away.max(axis=1) > RADIUS + 0.01) & (away[:, -1] < RADIUS + 0.005)
    assert back.mean() > 0.5
    assert away[:, 1:].min() > RADIUS - 0.0005
