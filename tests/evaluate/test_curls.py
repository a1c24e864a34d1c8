import numpy as np
import pytest
from known_hair import parallel, ragged, wild

from hairfit.evaluate.curls import compare_curls, find_curls
from hairfit.types import Strands


def curl(radius, pitch, length=0.2, knots=60, flat=False, taper=None, phase=0.7):
    """Return a helix, or a wave in a plane, about -y."""
    t = np.linspace(0.0, length, knots)
    size = radius * (np.ones(knots) if taper is None else taper(t / length))
    angle = 2 * np.pi * t / pitch + phase
    across = 0 * t if flat else size * np.sin(angle)
    return np.stack([size * np.cos(angle), -t, across], 1)


def one(points):
    found = find_curls(Strands.from_array(points[None]))
    return found.radius[0], found.pitch[0], found.curled[0]


@pytest.mark.parametrize(
    ("radius", "pitch", "flat"),
    [
        (0.005, 0.02, False),
        (0.004, 0.045, False),
        (0.0015, 0.015, False),
        (0.004, 0.045, True),
        (0.002, 0.02, True),
        (0.0015, 0.015, True),
    ],
)
@pytest.mark.parametrize("phase", [0.0, 1.0, 2.5])
def test_a_curl_has_the_radius_and_pitch_it_was_made_with(radius, pitch, flat, phase):
    found, length, curled = one(curl(radius, pitch, flat=flat, phase=phase, knots=80))
    assert curled
    assert found == pytest.approx(radius, rel=0.06)
    assert length == pytest.approx(pitch, rel=0.02)


def test_the_crests_of_a_steep_wave_are_short_and_count_little():
    found, length, curled = one(curl(0.005, 0.02, flat=True, knots=80))
    assert curled
    assert 0.9 * 0.005 < found < 0.96 * 0.005
    assert length == pytest.approx(0.02, rel=0.02)


def test_points_may_be_as_few_as_five_a_turn():
    radius, pitch, curled = one(curl(0.005, 0.025, knots=41))
    assert curled
    assert radius == pytest.approx(0.005, rel=0.05)
    assert pitch == pytest.approx(0.025, rel=0.02)


def test_points_that_are_too_few_show_no_curl():
    assert not one(curl(0.005, 0.02, length=0.205, knots=31))[2]


def test_three_turns_are_enough_and_two_are_not():
    radius, pitch, curled = one(curl(0.004, 0.04, length=0.12))
    assert curled
    assert radius == pytest.approx(0.004, rel=0.06)
    assert pitch == pytest.approx(0.04, rel=0.04)
    assert not one(curl(0.004, 0.04, length=0.08))[2]


@pytest.mark.parametrize("flat", [False, True], ids=["helix", "wave"])
def test_a_curl_about_a_bent_line_is_measured_from_that_line(flat):
    bend, radius, pitch = 0.1, 0.004, 0.03  # as hair bends about a head
    points = curl(radius, pitch, length=0.25, knots=100, flat=flat)
    turn = -points[:, 1] / bend
    out = bend + points[:, 0]
    bent = np.stack([out * np.cos(turn), out * np.sin(turn), points[:, 2]], 1)
    found, length, curled = one(bent)
    assert curled
    assert found == pytest.approx(radius, rel=0.06)
    assert length == pytest.approx(pitch, rel=0.03)
    arc = bend * np.stack([np.cos(turn), np.sin(turn), 0 * turn], 1)
    assert not one(arc)[2]


def test_a_curl_that_grows_towards_the_tip_has_the_quadratic_mean_of_its_radii():
    points = curl(0.004, 0.02, length=0.4, knots=160, taper=lambda s: s)
    radius, pitch, curled = one(points)
    assert curled
    # Less than that of all: the last, widest turn has no whole window about it.
    assert 0.85 < radius / (0.004 / np.sqrt(3)) < 1.0
    assert pitch == pytest.approx(0.02, rel=0.06)


@pytest.mark.parametrize("points", [parallel(knots=40), parallel(knots=5)])
def test_straight_strands_do_not_curl(points):
    assert not find_curls(points).curled.any()


def test_what_deviates_by_a_fifth_of_a_millimetre_is_straight():
    assert not one(curl(0.0002, 0.007, length=0.1, knots=100))[2]
    assert one(curl(0.0004, 0.007, length=0.1, knots=100))[2]


def test_a_wave_of_eight_degrees_is_straight_and_one_of_twelve_is_not():
    for angle, curls in ((8.0, False), (12.0, True)):
        radius = 0.03 * np.tan(np.radians(angle)) / (2 * np.pi)
        assert one(curl(radius, 0.03, flat=True))[2] == curls


def test_hair_without_a_period_does_not_curl():
    found = find_curls(wild(np.random.default_rng(0), strands=200, knots=40))
    assert found.curled.mean() < 0.2


def test_moving_and_turning_hair_changes_no_curl():
    points = curl(0.004, 0.03)
    turn, _ = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))
    assert np.allclose(one(points), one(points @ turn + [0.1, 1.0, -0.3]), rtol=1e-4)


def test_a_point_alone_and_a_strand_without_length_are_straight():
    knot = np.zeros((60, 3))
    hair = ragged(knot, curl(0.004, 0.03), [[9.0, 9.0, 9.0]])
    found = find_curls(hair)
    assert found.curled.tolist() == [False, True]
    assert np.isfinite(found.radius).all() and np.isfinite(found.pitch).all()


def test_errors_of_curls_are_those_of_the_medians():
    def hair(radius, pitch, straight):
        curled = [curl(radius, pitch, phase=p, knots=80) for p in (0.0, 1.0, 2.0)]
        return Strands.from_array(
            np.stack([*curled, *[curl(0.0, 0.1, knots=80)] * straight])
        )

    found = compare_curls(hair(0.003, 0.03, straight=3), hair(0.004, 0.025, straight=1))
    assert found.share == 0.5 and found.true_share == 0.75
    assert found.radius_error == pytest.approx(-0.25, abs=0.02)
    assert found.pitch_error == pytest.approx(0.2, abs=0.02)


def test_without_curls_there_is_no_error_of_them():
    found = compare_curls(
        parallel(knots=40), Strands.from_array(curl(0.004, 0.03)[None])
    )
    assert found.share == 0.0 and found.true_share == 1.0
    assert found.radius is None and found.radius_error is None
    assert found.true_pitch == pytest.approx(0.03, rel=0.02)
    assert found.pitch is None and found.pitch_error is None
