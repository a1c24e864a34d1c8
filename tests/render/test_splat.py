"""Samples in a volume: deposits, look-ups, and that they are each other's transpose."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

from hairfit.render.splat import Grid, Place, deposit, fastest_form, look_up

GRID = Grid(5, 7, 4)
FORMS = ["scatter", "gather"]


def make_place(count=60, seed=0):
    """Return places within the volume, on its rim and outside of it."""
    rng = np.random.default_rng(seed)
    low, high = (-2.5, -2.5, -1.5), (8.5, 6.5, 4.5)
    return Place(*jnp.asarray(rng.uniform(low, high, (count, 3)).T))


def make_values(count=60, channels=2):
    rng = np.random.default_rng(1)
    return tuple(jnp.asarray(x) for x in rng.normal(size=(channels, count)))


def reference(place, value):
    """Return the volume by its definition, one sample after the other."""
    volume = np.zeros((GRID.height, GRID.width, GRID.layers))
    for x, y, z, v in zip(*place, value, strict=True):
        for row, column, layer in itertools.product(*map(range, volume.shape)):
            tents = [1 - abs(a - b) for a, b in ((x, column), (y, row), (z, layer))]
            volume[row, column, layer] += v * np.prod(np.maximum(tents, 0.0))
    return volume.reshape(-1)


@pytest.mark.parametrize("form", FORMS)
def test_a_deposit_is_a_sum_of_tents(form):
    place, values = make_place(), make_values()
    volume = deposit(place, values, GRID, form)
    for found, value in zip(volume, values, strict=True):
        np.testing.assert_allclose(found, reference(place, value), atol=1e-12)


def test_both_forms_agree_in_single_precision():
    place = Place(*(x.astype(jnp.float32) for x in make_place(5000)))
    values = tuple(x.astype(jnp.float32) for x in make_values(5000))
    for a, b in zip(
        deposit(place, values, GRID, "scatter"),
        deposit(place, values, GRID, "gather"),
        strict=True,
    ):
        np.testing.assert_allclose(a, b, atol=2e-4)


@pytest.mark.parametrize("form", FORMS)
def test_a_look_up_is_the_transpose_of_a_deposit(form):
    place, values = make_place(), make_values()
    rng = np.random.default_rng(2)
    volume = tuple(jnp.asarray(x) for x in rng.normal(size=(2, GRID.cells)))
    put = deposit(place, values, GRID, form)
    found = look_up(place, volume, GRID, form)
    left = sum(jnp.vdot(a, b) for a, b in zip(put, volume, strict=True))
    right = sum(jnp.vdot(a, b) for a, b in zip(values, found, strict=True))
    assert float(left) == pytest.approx(float(right), rel=1e-12)


@pytest.mark.parametrize("form", FORMS)
def test_gradients_are_those_of_finite_differences(form):
    place, values = make_place(20), make_values(20)
    rng = np.random.default_rng(2)
    volume = tuple(jnp.asarray(x) for x in rng.normal(size=(2, GRID.cells)))

    def put(place, values):
        place, values = jax.tree.map(jnp.asarray, (place, values))
        return [x**2 for x in deposit(place, values, GRID, form)]

    def found(place, volume):
        place, volume = jax.tree.map(jnp.asarray, (place, volume))
        return [x**2 for x in look_up(place, volume, GRID, form)]

    check_grads(put, (place, values), order=1, modes=["rev"], eps=1e-6)
    check_grads(found, (place, volume), order=1, modes=["rev"], eps=1e-6)


@pytest.mark.parametrize("form", FORMS)
def test_what_is_far_outside_counts_nowhere_and_has_no_gradient(form):
    far = Place(*(jnp.array([1e30, -1e30, 2.0]) for _ in range(3)))
    far = far._replace(layer=jnp.array([1.0, 1.0, 50.0]))

    def total(place):
        return deposit(place, (jnp.ones(3),), GRID, form)[0].sum()

    assert float(total(far)) == 0.0
    assert all(float(jnp.abs(x).max()) == 0.0 for x in jax.grad(total)(far))


@pytest.mark.parametrize("form", FORMS)
def test_no_samples_leave_the_volume_empty(form):
    place = Place(*(jnp.zeros(0) for _ in range(3)))
    (volume,) = deposit(place, (jnp.zeros(0),), GRID, form)
    assert volume.shape == (GRID.cells,)
    assert not volume.any()


def test_the_gather_form_has_no_scatter_either_way():
    def loss(place, values):
        return sum((x**2).sum() for x in deposit(place, values, GRID, "gather"))

    slope = jax.jit(jax.grad(loss, (0, 1)))
    text = slope.lower(make_place(), make_values()).as_text()
    assert "scatter" not in text.replace("scatter_dims", "")


def test_on_a_processor_scatters_are_the_fastest():
    if jax.default_backend() != "cpu":
        pytest.skip("JAX runs on an accelerator")
    assert fastest_form() == "scatter"
