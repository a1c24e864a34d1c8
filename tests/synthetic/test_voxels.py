import numpy as np
import pytest

from hairfit.synthetic.voxels import (
    Box,
    Matter,
    hair_matter,
    light_frame,
    opacity_volume,
    together,
    transmittance,
)

CENTRE = np.array([0.1, -0.03, 0.2])
BOX = Box(CENTRE, 0.27, 0.003)
UP = np.array([0.0, 1.0, 0.0])


def slab(height, opacity, rng):
    """Return a level sheet, 0.2 m wide, that has an opacity of its own."""
    count = 200_000
    p = rng.uniform(-0.1, 0.1, (count, 3)) * [1, 0, 1] + CENTRE + [0, height, 0]
    return Matter(p, np.full(count, opacity * 0.04 / count))


def test_light_is_dimmed_by_the_exponential_of_the_opacity():
    rng = np.random.default_rng(0)
    volume = opacity_volume(slab(0.0, 1.5, rng), UP, BOX)
    above, below = CENTRE + [0, 0.05, 0], CENTRE - [0, 0.05, 0]
    lit = transmittance(volume, np.stack([above, below]))
    assert lit == pytest.approx([1.0, np.exp(-1.5)], rel=0.05)


def test_sheets_multiply_and_what_stands_beside_does_not_count():
    rng = np.random.default_rng(0)
    one, two = slab(0.0, 0.7, rng), slab(0.03, 0.7, rng)
    volume = opacity_volume(together(one, two), UP, BOX)
    p = CENTRE + np.array([[0.0, -0.05, 0.0], [0.2, -0.05, 0.0]])
    assert transmittance(volume, p) == pytest.approx([np.exp(-1.4), 1.0], rel=0.1)


@pytest.mark.parametrize("to_light", [[0, 1, 0], [1, 0, 0], [0, 0, -2], [1, 2, -3]])
def test_the_frame_is_orthonormal_and_runs_away_from_the_light(to_light):
    axes = light_frame(np.array(to_light, float))
    assert np.allclose(axes @ axes.T, np.eye(3))
    assert np.linalg.det(axes) == pytest.approx(1.0)
    assert axes[0] @ to_light == pytest.approx(-np.linalg.norm(to_light))


def test_a_slanted_light_casts_its_shadow_on_the_other_side():
    rng = np.random.default_rng(0)
    ball = Matter(
        CENTRE + 0.02 * rng.uniform(-1, 1, (20_000, 3)), np.full(20_000, 2e-7)
    )
    to_light = np.array([1.0, 1.0, 0.0])
    volume = opacity_volume(ball, to_light, BOX)
    lit = transmittance(volume, CENTRE + 0.06 * np.array([to_light, -to_light]))
    assert lit[0] == pytest.approx(1.0, abs=1e-6)
    assert lit[1] < 0.2


def test_hair_blocks_its_length_times_its_width():
    strand = np.array([[[0.0, 0, 0], [0, 0.1, 0], [0, 0.1, 0.3]]])
    matter = hair_matter(strand, 0.002)
    assert np.allclose(matter.points, [[0, 0.05, 0], [0, 0.1, 0.15]])
    assert np.allclose(matter.area, [0.0002, 0.0006])
