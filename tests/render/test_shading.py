import jax
import jax.numpy as jnp
import pytest
from jax.test_util import check_grads

from hairfit.render import Fibre, kajiya_kay

X, Y, Z = jnp.eye(3)
FIBRE = Fibre(
    jnp.array([0.01, 0.02, 0.03]),
    jnp.array([0.3, 0.2, 0.1]),
    jnp.array([0.5, 0.5, 0.5]),
    jnp.asarray(20.0),
)
SHADE = jax.jit(kajiya_kay)


def direction(angle):
    """Return the direction in the plane of x and y at an angle from x."""
    return jnp.array([jnp.cos(angle), jnp.sin(angle), 0.0])


def test_light_and_eye_across_the_fibre_give_the_full_sum():
    expected = FIBRE.ambient + FIBRE.diffuse + FIBRE.specular
    assert jnp.allclose(SHADE(X, Y, Y, FIBRE), expected)
    assert jnp.allclose(
        SHADE(X, Y, Z, FIBRE), expected
    )  # around the fibre all is equal


def test_light_along_the_fibre_leaves_the_ambient_term():
    assert jnp.allclose(SHADE(X, X, Y, FIBRE), FIBRE.ambient)
    assert jnp.allclose(SHADE(X, -X, Y, FIBRE), FIBRE.ambient)


@pytest.mark.parametrize("angle", [0.3, 0.8, 1.2, 2.0])
def test_the_closed_form_of_5_11_holds(angle):
    light, eye = direction(angle), direction(2.2)
    # From the normal towards the tangent: the mirrored direction has the opposite sign.
    theta, theta_eye = jnp.pi / 2 - angle, jnp.pi / 2 - 2.2
    lobe = jnp.maximum(jnp.cos(theta + theta_eye), 0.0) ** FIBRE.shininess
    expected = FIBRE.ambient + FIBRE.diffuse * jnp.cos(theta) + FIBRE.specular * lobe
    assert jnp.allclose(SHADE(X, light, eye, FIBRE), expected)


def test_the_highlight_is_where_a_mirror_would_send_the_light():
    angles = jnp.linspace(0.1, 3.0, 291)
    shade = jax.vmap(lambda a: kajiya_kay(X, direction(1.0), direction(a), FIBRE))
    brightest = angles[jnp.argmax(shade(angles)[:, 0])]
    assert jnp.allclose(brightest, jnp.pi - 1.0, atol=0.01)


def test_the_sign_of_the_tangent_does_not_matter():
    light, eye = direction(0.7), direction(1.9)
    assert jnp.allclose(SHADE(X, light, eye, FIBRE), SHADE(-X, light, eye, FIBRE))


def test_gradients_are_those_of_finite_differences():
    eye = jnp.array([0.0, 0.6, 0.8])
    arguments = (direction(0.3), direction(1.1), eye, FIBRE)
    check_grads(SHADE, arguments, order=1)


@pytest.mark.parametrize("light", [X, -X, -Y])
def test_gradients_are_finite_where_the_fibre_points_at_the_light(light):
    gradient = jax.grad(lambda t: kajiya_kay(t, light, -light, FIBRE).sum())(X)
    assert jnp.isfinite(gradient).all()
