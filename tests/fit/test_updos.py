import numpy as np
import pytest
from ball_hair import RADIUS, hull_where

from hairfit.fit.evidence import Field
from hairfit.fit.sense import growth_sense
from hairfit.fit.tails import find_tails
from hairfit.fit.updos import HIGH, find_updos
from hairfit.render.raster import unit

SPACING = 0.004
FLAT = 0.008  # metres that hair drawn up lies high
KNOT = 0.024  # metres, radius of a knot
CROWN, LEFT, RIGHT = np.array([[0.0, 1.0, 0.0], [-0.8, 0.6, 0.0], [0.8, 0.6, 0.0]])


def drawn_to(*knots, height=None, room=2.5 * KNOT):
    """Return a ball's hair, wound up in knots, which lies flat and runs to the nearest.

    Args:
        knots: Unit vectors from the ball's middle.
        height: Of the hair on the ball, a function of the cosine to the nearest knot;
            flat if none is given.
        room: Above the ball, in metres.
    """
    ways = np.array(knots)

    def skin(points):
        return np.linalg.norm(points, axis=1) - RADIUS

    def nearest(points):
        return ways[np.argmax(points @ ways.T, axis=1)]

    def hair(points):
        over = skin(points)
        if height is not None:
            cosine = (unit(points) * nearest(points)).sum(axis=1)
            return (over > 0.0) & (over < height(cosine))
        middle = (RADIUS + KNOT) * nearest(points)
        wound = np.linalg.norm(points - middle, axis=1) < KNOT
        return (over > 0.0) & ((over < FLAT) | wound)

    size = RADIUS + room
    hull = hull_where(hair, [-size] * 3, [size] * 3, SPACING, skin)
    centres = hull.grid.centres(np.ones(hull.grid.shape, bool))
    out = unit(centres)
    way = nearest(centres)
    cosine = (way * out).sum(axis=1, keepdims=True)
    rises = np.clip((cosine - 0.98) / 0.01, 0.0, 1.0)  # up into the knot
    along = unit((1.0 - rises) * unit(way - cosine * out + 1e-9) + rises * out)
    rng = np.random.default_rng(0)
    either = np.where(rng.random(len(along)) < 0.5, 1.0, -1.0)[:, None]
    shape = hull.grid.shape
    field = Field((either * along).reshape(*shape, 3), np.full(shape, 0.9))
    return hull, field, skin(hull.grid.centres(hull.hair))


@pytest.mark.parametrize("knots", [[CROWN], [LEFT, RIGHT]])
def test_a_tie_is_where_flat_hair_comes_together(knots):
    hull, field, away = drawn_to(*knots)
    assert not len(find_tails(hull, away).ties)
    found = find_updos(hull, field, away)
    assert (found.hair == (away > HIGH)).all()
    assert len(found.ties) == len(knots)
    for knot in knots:
        gap = np.linalg.norm(found.ties - (RADIUS + HIGH) * knot, axis=1)
        assert gap.min() < 0.015


def around(hull, way):
    """Return a field that runs around the ball, so that no line comes to a knot."""
    out = unit(hull.grid.centres(np.ones(hull.grid.shape, bool)))
    along = unit(np.cross(way, out) + 1e-9)
    return Field(along.reshape(*hull.grid.shape, 3), np.full(hull.grid.shape, 0.9))


@pytest.mark.parametrize("knots", [[CROWN], [LEFT, RIGHT]])
def test_a_knot_on_flat_hair_is_a_tie_though_no_line_leads_there(knots):
    hull, _, away = drawn_to(*knots)
    found = find_updos(hull, around(hull, np.mean(knots, axis=0)), away)
    assert found.wound
    assert found.hair[away > 0.03].all() and not found.hair[away < FLAT].any()
    assert len(found.ties) == len(knots)
    for knot in knots:
        side = unit(found.ties) @ knot
        assert side.max() > np.cos(np.radians(5.0))


@pytest.mark.parametrize("reach, wound", [(0.05, True), (0.14, False)])
def test_what_stands_far_off_is_a_tail_and_no_knot(reach, wound):
    hull, _, away = drawn_to(
        CROWN, height=lambda c: np.where(c > 0.95, reach, FLAT), room=reach
    )
    found = find_updos(hull, around(hull, CROWN), away)
    assert len(found.ties) == 1 and found.wound == wound


@pytest.mark.parametrize("cosine", [0.5, -1.0])
def test_hair_that_is_high_on_a_wide_base_is_no_knot(cosine):
    hull, _, away = drawn_to(CROWN, height=lambda c: np.where(c > cosine, 0.04, FLAT))
    assert not len(find_updos(hull, around(hull, CROWN), away).ties)


def test_hair_that_hangs_from_a_crown_has_no_tie():
    hull, field, away = drawn_to(CROWN, height=lambda c: 0.008 + 0.02 * (1.0 - c))
    found = find_updos(hull, field, away)
    assert not len(found.ties) and not found.hair.any()


def test_a_little_flat_hair_tells_of_no_tie():
    hull, field, away = drawn_to(
        CROWN, height=lambda c: np.where(c > 0.9, 0.04, np.where(c > 0.86, 0.008, 0.0))
    )
    assert not len(find_updos(hull, field, away).ties)


def test_flat_hair_grows_to_its_tie():
    hull, field, away = drawn_to(LEFT, RIGHT)
    sense = growth_sense(hull, field, away)
    centres = hull.grid.centres(hull.hair)
    ways = np.array([LEFT, RIGHT])
    nearest = ways[np.argmax(centres @ ways.T, axis=1)]
    ahead = (field.direction[hull.hair] * nearest).sum(axis=1)
    flat = (away < FLAT) & (centres @ ways.T < 0.9 * RADIUS).all(axis=1)
    assert (sense * ahead > 0.0)[flat].mean() > 0.95
