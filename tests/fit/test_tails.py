import numpy as np
import pytest
from ball_hair import RADIUS, hull_where

from hairfit.fit.curls import Curls
from hairfit.fit.evidence import Field
from hairfit.fit.flow import hair_field
from hairfit.fit.sense import growth_sense
from hairfit.fit.tails import LEVELS, NEAR, find_tails, pull_of

SPACING = 0.004
SHELL = 0.012  # metres that hair lies high on the head


def head_with(*tails, length=0.17, wide=0.012):
    """Return a ball's hair with rods that stand off, and its height above the ball."""

    def inside(p):
        height = np.linalg.norm(p, axis=1) - RADIUS
        hair = (height > 0) & (height < SHELL)
        for way in tails:
            along = p @ way
            aside = np.linalg.norm(p - along[:, None] * way, axis=1)
            hair |= (along > RADIUS) & (along < RADIUS + length) & (aside < wide)
        return hair

    corner = RADIUS + np.array([0.02, 0.02, 0.02])
    reach = np.abs(np.sum(tails, axis=0)) * length if tails else np.zeros(3)
    hull = hull_where(inside, -corner - reach, corner + reach, SPACING)
    away = np.linalg.norm(hull.grid.centres(hull.hair), axis=1) - RADIUS
    return hull, away


BACK, LEFT, RIGHT = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


@pytest.mark.parametrize("ways", [[BACK], [LEFT, RIGHT]])
def test_a_tail_is_all_that_stands_off_and_its_tie_where_it_does(ways):
    hull, away = head_with(*ways)
    tails = find_tails(hull, away)
    assert (tails.hair == (away > LEVELS[0])).all()
    assert len(tails.ties) == len(ways)
    for way in ways:
        tie = (RADIUS + LEVELS[0]) * way
        assert np.linalg.norm(tails.ties - tie, axis=1).min() < SPACING


@pytest.mark.parametrize(
    ("why", "length", "wide"),
    [
        ("hair that stands off all over", 0.0, 0.0),
        ("too little behind its base", 0.11, 0.012),
        ("a base too wide", 0.17, 0.036),
        ("a single lock", 0.17, 0.007),
    ],
)
def test_other_hair_has_no_tail(why, length, wide):
    hull, away = head_with(BACK, length=length, wide=wide)
    tails = find_tails(hull, away)
    assert not tails.hair.any() and not len(tails.ties), why
    pull = pull_of(tails, hull.grid.centres(hull.hair))
    assert not pull.nearness.any()


def test_hair_is_drawn_to_the_nearest_tie_the_less_the_farther_it_is():
    hull, away = head_with(LEFT, RIGHT)
    tails = find_tails(hull, away)
    centres = hull.grid.centres(hull.hair)
    pull = pull_of(tails, centres)
    gap = np.linalg.norm(centres[:, None] - tails.ties, axis=2)
    near = np.exp(-((gap.min(axis=1) / NEAR) ** 2))
    assert np.allclose(pull.nearness, np.where(tails.hair, 1.0, near))
    reached = centres + gap.min(axis=1)[:, None] * pull.towards
    one = np.abs(gap[:, 0] - gap[:, 1]) > 1e-6
    assert np.allclose(reached[one], tails.ties[gap.argmin(axis=1)][one])


@pytest.mark.parametrize("tied", [True, False])
def test_hair_under_a_tie_grows_up_to_it_though_loose_hair_hangs_below(tied):
    hull, height = head_with(BACK, length=0.17 if tied else 0.0)
    centres = hull.grid.centres(hull.hair)
    # Hair runs up and down; below, loose hair comes ever farther from the scalp.
    out = centres / np.linalg.norm(centres, axis=1, keepdims=True)
    up = np.array([0.0, 1.0, 0.0]) - out[:, 1:2] * out
    along = np.where((height > SHELL)[:, None], -BACK, up)
    direction = np.zeros((*hull.grid.shape, 3))
    direction[hull.hair] = along / np.linalg.norm(along, axis=1, keepdims=True)
    field = Field(direction, np.ones(hull.grid.shape))
    away = height + 0.2 * np.maximum(-centres[:, 1], 0.0)
    sense = growth_sense(hull, field, away)
    back = (height < SHELL) & (centres[:, 2] < 0.0) & (np.abs(centres[:, 0]) < 0.02)
    up, down = (
        sense[back & (way * centres[:, 1] > 0.02) & (way * centres[:, 1] < 0.045)]
        for way in (1.0, -1.0)
    )
    assert up.max() < -0.2
    assert (down.min() > 0.3) if tied else (down.max() < -0.3)


def test_where_photographs_say_nothing_hair_near_a_tie_runs_to_it():
    hull, away = head_with(BACK)
    centres = hull.grid.centres(hull.hair)
    scalp = RADIUS * centres / np.linalg.norm(centres, axis=1, keepdims=True)
    silent = Curls(radius=0.0, pitch=0.0, maps=[], told=True)
    field = hair_field(hull, [], [], silent, scalp, scalp / RADIUS)
    to_tie = (RADIUS + LEVELS[0]) * BACK - centres
    gap = np.linalg.norm(to_tie, axis=1)
    near = (away < SHELL) & (gap > 0.02) & (gap < NEAR)
    cosine = np.abs((field.direction[hull.hair] * to_tie).sum(axis=1))[near] / gap[near]
    assert near.sum() > 50 and cosine.min() > np.cos(np.radians(20.0))
