import numpy as np
import pytest
from ball_hair import all_centres, hull_where

from hairfit.fit.evidence import Field
from hairfit.fit.sense import ALOFT, DOUBT, LOSES, REACHED, SAME, growth_sense
from hairfit.fit.tails import no_tails

SPACING = 0.004


def made(hull, direction, sure: np.typing.ArrayLike = 1.0, seed=None):
    """Return a field of unit directions, signs at random if there is a seed."""
    unit = direction / np.linalg.norm(direction, axis=-1, keepdims=True)
    if seed is not None:
        signs = np.random.default_rng(seed).choice([-1.0, 1.0], hull.grid.shape)
        unit = unit * signs[..., None]
    return Field(unit, np.broadcast_to(sure, hull.grid.shape).astype(float))


def along_x(hull):
    return np.tile([1.0, 0.0, 0.0], (*hull.grid.shape, 1))


def in_the_skin(places):
    """Return no height for all places, so that no line ends in the air."""
    return np.zeros(len(places))


def bar(length, height=0.0):
    """Return hair along x from 0 on, so far from the skin but for its two ends."""
    return hull_where(
        lambda p: (
            (p[:, 0] > 0) & (p[:, 0] < length) & (np.abs(p[:, 1:]) < 0.012).all(1)
        ),
        [-0.02, -0.02, -0.02],
        [length + 0.02, 0.02, 0.02],
        SPACING,
        head=lambda p: np.where((p[:, 0] > 0) & (p[:, 0] < length), height, 0.0),
    )


@pytest.fixture
def single_lines(monkeypatch):
    """Each place says what its own line says, and a strip's ends are no knots."""
    monkeypatch.setattr("hairfit.fit.sense.EVERY", 1)
    monkeypatch.setattr("hairfit.fit.sense.AROUND", 1e-6)
    monkeypatch.setattr(
        "hairfit.fit.sense.find_updos", lambda hull, field, away: no_tails(len(away))
    )


@pytest.mark.usefixtures("single_lines")
def test_a_straight_line_says_how_much_farther_its_tip_is_than_the_place():
    hull = bar(0.1)
    x = hull.grid.centres(hull.hair)[:, 0]
    found = growth_sense(hull, made(hull, along_x(hull)), x)
    left = np.minimum(x.max() - x, REACHED)
    assert left.min() < 0.5 * REACHED < REACHED == left.max()
    assert np.allclose(found, left / (left + SAME), atol=1e-9)


@pytest.mark.usefixtures("single_lines")
def test_what_lies_beyond_doubt_counts_as_far_as_the_way_is_believed():
    hull = bar(0.1)
    x = hull.grid.centres(hull.hair)[:, 0]
    field = made(hull, along_x(hull), sure=0.4)
    found = growth_sense(hull, field, x)
    # All that a line from each place finds ahead, after the voxels in between.
    places = np.unique(x)
    way = np.maximum(places[None] - places[:, None], 0.0)
    ahead = (np.exp(-0.6 * way / DOUBT) * np.minimum(way, REACHED)).max(axis=1)
    told = 0.4 * ahead / (ahead + SAME)
    assert np.allclose(found, told[np.searchsorted(places, x)], atol=1e-9)


@pytest.mark.usefixtures("single_lines")
@pytest.mark.parametrize("steepness", [0.05, 0.4, 1.0])
def test_lines_take_back_most_of_what_they_lose_again_but_for_tips(steepness):
    hull = bar(0.1)
    x = hull.grid.centres(hull.hair)[:, 0]
    # As over a ridge of hair, which falls by less than `LOSES`, rises by less than
    # `REACHED`, or by more.
    places = np.unique(x)
    ridge = places[len(places) * 3 // 5]
    away = 0.07 - steepness * np.abs(x - ridge)
    found = growth_sense(hull, made(hull, along_x(hull)), away)
    height = 0.07 - steepness * np.abs(places - ridge)
    left = np.maximum.accumulate(height[::-1])[::-1] - height
    reached = left > REACHED
    gain = np.minimum(left, REACHED)
    lost = np.maximum(left - (height[-1] - height) - LOSES, 0.0)
    lost = np.where(reached, 0.0, lost)
    assert reached.any() == (steepness == 1.0)
    assert lost.any() == (steepness > 0.1)
    gain = np.maximum(gain - lost, 0.0)
    before = places < ridge
    assert (gain[before] > 0.0).any()
    told = (gain / (gain + SAME))[np.searchsorted(places, x)]
    assert np.allclose(found[x < ridge], told[x < ridge], atol=1e-9)


@pytest.mark.usefixtures("single_lines")
def test_lines_go_on_where_the_field_turns_sharply_from_one_voxel_to_the_next():
    hull = hull_where(
        lambda p: (np.abs(p[:, :2]) < 0.05).all(1) & (np.abs(p[:, 2]) < 0.012),
        [-0.07, -0.07, -0.02],
        [0.07, 0.07, 0.02],
        SPACING,
        head=in_the_skin,
    )
    x = all_centres(hull)[..., 0]
    turn = np.radians(75.0)
    direction = np.where((x < 0)[..., None], [1, 0, 0], [np.cos(turn), np.sin(turn), 0])
    x, y, _ = hull.grid.centres(hull.hair).T
    # Hair comes farther from the scalp only where it has turned.
    found = growth_sense(hull, made(hull, direction), np.where(x > 0, y + 0.05, 0.0))
    before = (x < -0.02) & (y > -0.01) & (y < 0.0)
    assert found[before].min() > 0.9


@pytest.mark.usefixtures("single_lines")
@pytest.mark.parametrize(
    ("degrees", "height", "goes_on"),
    [
        (12.0, 0.02, True),
        (-12.0, 0.02, True),
        (12.0, 0.006, False),
        (25.0, 0.02, False),
    ],
)
def test_lines_go_on_along_a_border_that_they_graze_but_not_at_the_skin(
    degrees, height, goes_on
):
    hull = bar(0.15, height)
    slope = np.radians(degrees)
    direction = np.tile([np.cos(slope), np.sin(slope), 0.0], (*hull.grid.shape, 1))
    x, y, _ = hull.grid.centres(hull.hair).T
    found = growth_sense(hull, made(hull, direction), x)
    near = (y * np.sign(degrees) > 0.008) & (x < 0.1)
    farther = SAME * found[near] / (1.0 - found[near])
    # Without the border such lines leave after two voxels.
    if goes_on:
        assert farther.min() > 0.3 * REACHED
    else:
        assert farther.max() < 2.5 * SPACING


@pytest.mark.parametrize("seed", [0, 1])
def test_signs_of_the_field_change_no_sense(seed):
    hull = bar(0.1)
    away = hull.grid.centres(hull.hair)[:, 0]
    plain, random = (made(hull, along_x(hull), seed=one) for one in (None, seed))
    sign = (plain.direction * random.direction).sum(axis=-1)[hull.hair]
    before = growth_sense(hull, plain, away)
    assert np.allclose(sign * growth_sense(hull, random, away), before)
    assert (before >= 0.0).all() and before[away < 0.08].min() > 0.05


def arch(right=0.06, head=in_the_skin):
    """Return hair over a roof that hangs 12 cm down at -x, and so far at +x."""

    def inside(p):
        plate = (np.abs(p[:, 1]) < 0.008) & (np.abs(p[:, 0]) < 0.06)
        curtain = (np.abs(np.abs(p[:, 0]) - 0.052) < 0.008) & (p[:, 1] < 0)
        lowest = np.where(p[:, 0] < 0, -0.12, -right)
        return (plate | curtain & (p[:, 1] > lowest)) & (np.abs(p[:, 2]) < 0.02)

    low, high = [-0.07, -0.13, -0.03], [0.07, 0.02, 0.03]
    hull = hull_where(inside, low, high, SPACING, head=head)
    centres = all_centres(hull)
    corner = np.maximum(np.abs(centres[..., 0]) - 0.04, 0.0) / 0.012
    turn = 0.5 * np.pi * np.clip(corner, 0.0, 1.0)
    side = np.sign(centres[..., 0])
    along = np.stack([np.cos(turn), -side * np.sin(turn), np.zeros_like(turn)], -1)
    return hull, centres, along


def sense_on_the_right(hull, centres, field):
    """Return what is said of a strip of an arch's roof, and of which way."""
    place = centres[hull.hair]
    away = np.maximum(0.0, -place[:, 1])
    strip = (np.abs(place[:, 0] - 0.03) < 0.008) & (np.abs(place[:, 1]) < 0.006)
    return growth_sense(hull, field, away)[strip]


@pytest.mark.usefixtures("single_lines")
def test_of_a_line_over_the_top_no_end_is_the_tip_unless_the_other_is_none():
    hull, centres, along = arch()
    over = sense_on_the_right(hull, centres, made(hull, along))
    assert np.abs(over).max() < 1e-3
    hull, centres, along = arch(right=0.016)
    over = sense_on_the_right(hull, centres, made(hull, along))
    assert over.max() < -0.3


@pytest.mark.usefixtures("single_lines")
@pytest.mark.parametrize("curly", [False, True])
@pytest.mark.parametrize(
    "height", [0.0, SPACING, SPACING + 0.4 * ALOFT, SPACING + 2.0 * ALOFT]
)
def test_a_line_that_ends_in_the_air_ends_at_a_tip_unless_hair_curls(height, curly):
    # One end is farther from the scalp, but in the skin; the other is in the air.
    hull = bar(0.1)
    x = hull.grid.centres(hull.hair)[:, 0]
    hull.head[:] = np.where(all_centres(hull)[..., 0] < 0.0, height, 0.0)
    found = growth_sense(hull, made(hull, along_x(hull)), 0.1 * x, curly)
    gain = 0.1 * (x.max() - x)
    # Hair as thin as a voxel leaves the hull at a hairline no lower than this.
    height = max(height - SPACING, 0.0)
    air = 0.0 if curly else REACHED * min(height / ALOFT, 1.0)
    assert np.allclose(found, (gain - air) / (gain + air + SAME), atol=1e-9)


@pytest.mark.usefixtures("single_lines")
@pytest.mark.parametrize(("degrees", "share"), [(20.0, 0.0), (40.0, 0.49), (65.0, 1.0)])
def test_a_line_that_slides_out_of_the_hull_says_less(degrees, share):
    # A slab that goes on for long, so that lines leave it through its upper side.
    hull = hull_where(
        lambda p: (np.abs(p[:, 0]) < 0.2) & (np.abs(p[:, 1:]) < 0.012).all(1),
        [-0.22, -0.02, -0.02],
        [0.22, 0.02, 0.02],
        SPACING,
        head=lambda p: np.where(p[:, 1] > 0.0, 2.0 * ALOFT, 0.0),
    )
    slope = np.radians(degrees)
    direction = np.tile([np.cos(slope), np.sin(slope), 0.0], (*hull.grid.shape, 1))
    place = hull.grid.centres(hull.hair)
    found = growth_sense(hull, made(hull, direction), np.zeros(len(place)))
    middle = (np.abs(place[:, 0]) < 0.05) & (np.abs(place[:, 2]) < 0.006)
    tip = share * REACHED
    assert np.allclose(found[middle], tip / (tip + SAME), atol=0.1)


def test_short_hair_grows_over_the_nape_though_it_comes_nearer_to_the_scalp():
    # From a crown over a bulge of other hair and down to the nape, where it is cut.
    hull, centres, along = arch(
        head=lambda p: np.where(p[:, 1] < 0.0, 2.0 * ALOFT, 0.0)
    )
    parting = np.where(np.abs(centres[..., 0]) < 0.016, 0.02, 1.0)
    place = centres[hull.hair]
    bulge = np.hypot(place[:, 0] - 0.05, place[:, 1])
    away = np.where(place[:, 0] > 0, np.maximum(0.02 - 0.4 * bulge, 0.0), -place[:, 1])
    hangs = (place[:, 0] > 0.046) & (place[:, 1] < -0.02)
    told = growth_sense(hull, made(hull, along, sure=parting), away)[hangs]
    assert told.min() > 0.3


def test_many_lines_that_find_little_do_not_outvote_one_that_finds_a_tip():
    # In the lower layer lines come a millimetre farther, in the upper one 3 cm.
    hull = bar(0.1)
    x, y, _ = hull.grid.centres(hull.hair).T
    away = np.where(y < 0.004, -0.01 * x, x)
    field = made(hull, along_x(hull))
    told = growth_sense(hull, field, away)
    assert (y < 0.004).mean() > 0.6
    assert told[np.abs(x - 0.05) < 0.02].min() > 0.5


def test_hair_beside_an_unsure_parting_does_not_grow_over_it():
    hull, centres, along = arch()
    parting = np.where(np.abs(centres[..., 0]) < 0.016, 0.02, 1.0)
    apart = sense_on_the_right(hull, centres, made(hull, along, sure=parting))
    assert apart.min() > 0.1


def test_tied_hair_grows_along_the_head_to_where_its_tail_leaves():
    # A plate on the scalp from which a thin tail stands off at one end.
    def inside(p):
        plate = (np.abs(p[:, 1]) < 0.008) & (np.abs(p[:, 0]) < 0.06)
        tail = (np.abs(p[:, 0] - 0.054) < 0.007) & (p[:, 1] > 0) & (p[:, 1] < 0.12)
        return plate & (np.abs(p[:, 2]) < 0.02) | tail & (np.abs(p[:, 2]) < 0.006)

    low, high = [-0.07, -0.02, -0.03], [0.07, 0.13, 0.03]
    hull = hull_where(inside, low, high, SPACING, head=in_the_skin)
    centres = all_centres(hull)
    tie = np.array([0.054, 0.0, 0.0])
    turn = 0.5 * np.pi * np.clip((centres[..., 0] - 0.03) / 0.02, 0.0, 1.0)
    bent = np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)], axis=-1)
    flat = (tie - centres) * [1.0, 0.0, 1.0]
    flat /= np.maximum(np.linalg.norm(flat, axis=-1, keepdims=True), 1e-9)
    along = np.where((centres[..., 0] > 0.02)[..., None], bent, flat)
    away = np.maximum(0.0, centres[hull.hair][:, 1] + 0.008)
    field = made(hull, along, seed=3)
    to_tip = (field.direction * along).sum(axis=-1)[hull.hair]
    signed = to_tip * growth_sense(hull, field, away)
    lies = np.abs(centres[hull.hair][:, 1]) < 0.006
    lies &= np.abs(centres[hull.hair][:, 0]) < 0.04
    assert (signed[lies] > 0.0).mean() > 0.95
