import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jax.test_util import check_grads
from scipy import ndimage

from hairfit.fit.grid import Grid, trilinear, trilinear_many

ORIGIN, SPACING, SHAPE = np.array([0.1, -0.2, 0.3]), 0.02, (5, 4, 6)
place = st.tuples(*[st.floats(-0.5, 0.5)] * 3)


@pytest.fixture
def grid():
    return Grid(ORIGIN, SPACING, SHAPE)


def linear_field(grid):
    points = grid.centres(np.ones(grid.shape, bool))
    slope = np.array([[1.0, -2.0, 0.5], [0.0, 3.0, -1.0]])
    return (points @ slope.T + [0.2, -0.7]).reshape(*grid.shape, 2), slope


def sample(field, points):
    return trilinear_many(
        jnp.asarray(field), jnp.asarray(ORIGIN), jnp.asarray(SPACING), points
    )


def test_linear_functions_are_reproduced_between_the_outermost_centres(grid):
    field, slope = linear_field(grid)
    share = np.random.default_rng(0).random((200, 3))
    points = ORIGIN + SPACING * (0.5 + share * (np.array(SHAPE) - 1))
    expected = points @ slope.T + [0.2, -0.7]
    assert np.allclose(sample(field, jnp.asarray(points)), expected, atol=1e-12)


@settings(max_examples=50, deadline=None)
@given(place)
def test_it_agrees_with_scipy_everywhere_also_outside_the_grid(shift):
    rng = np.random.default_rng(1)
    field = rng.normal(size=(*SHAPE, 1))
    point = ORIGIN + 0.05 + np.array(shift)
    at = (point - ORIGIN) / SPACING - 0.5
    expected = ndimage.map_coordinates(
        field[..., 0], at[:, None], order=1, mode="nearest"
    )
    assert np.allclose(sample(field, jnp.asarray(point)[None])[0], expected, atol=1e-9)


def test_the_border_holds_outside_the_grid(grid):
    field, _ = linear_field(grid)
    far = ORIGIN + SPACING * np.array([[-9.0, -9.0, -9.0], [99.0, 99.0, 99.0]])
    found = sample(field, jnp.asarray(far))
    assert np.array_equal(found[0], field[0, 0, 0])
    assert np.array_equal(found[1], field[-1, -1, -1])


def test_a_grid_of_one_voxel_is_constant():
    field = jnp.array([[[[3.0, -1.0]]]])
    point = jnp.array([7.0, -8.0, 0.0])
    found = trilinear(field, jnp.zeros(3), jnp.asarray(1.0), point)
    assert jnp.array_equal(found, jnp.array([3.0, -1.0]))


def test_gradients_are_those_of_the_field(grid):
    field, slope = linear_field(grid)
    arguments = jnp.asarray(field), jnp.asarray(ORIGIN), jnp.asarray(SPACING)
    inner = jnp.asarray(ORIGIN + SPACING * np.array([2.3, 1.7, 3.1]))
    check_grads(jax.jit(lambda p: trilinear(*arguments, p)), (inner,), order=1)


def test_centres_lie_in_their_voxels(grid):
    mask = np.zeros(SHAPE, bool)
    mask[1, 2, 3] = mask[4, 3, 5] = True
    centres = grid.centres(mask)
    assert np.allclose(centres[0], ORIGIN + SPACING * np.array([1.5, 2.5, 3.5]))
    assert np.array_equal(grid.voxel(centres), [[1, 2, 3], [4, 3, 5]])
    assert np.array_equal(
        grid.inside(np.array([[0, 0, 0], [5, 0, 0], [0, -1, 0]])), [True, False, False]
    )


def test_a_grid_around_a_box_holds_it_and_is_the_smallest():
    low, high = np.array([0.0, 0.0, 0.0]), np.array([0.1, 0.101, 0.0])
    assert Grid.around(low, high, 0.05).shape == (2, 3, 1)
