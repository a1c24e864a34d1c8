"""Surfaces of clusters as triangles."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import trimesh

from hairfit.model import GeneralizedCylinder
from hairfit.model.tube import tubes


def cylinders(*radii: float) -> GeneralizedCylinder:
    """Return straight cylinders of 2 m along z, three metres apart."""

    def one(radius, x):
        z = jnp.linspace(0.0, 2.0, 5)[:, None]
        return GeneralizedCylinder(
            skeleton=z * jnp.array([[0.0, 0.0, 1.0]])
            + x * jnp.array([[3.0, 0.0, 0.0]]),
            normal=jnp.array([1.0, 0.0, 0.0]),
            radius=jnp.full(5, radius),
            offset=jnp.zeros((5, 32)),
            scale=jnp.ones((5, 2)),
            twist=jnp.zeros(5),
            shear=jnp.zeros(5),
        )

    return jax.vmap(one)(jnp.asarray(radii), jnp.arange(len(radii), dtype=float))


def test_tubes_have_the_area_of_their_cylinders():
    found = tubes(cylinders(0.5, 0.2), turns=64)
    assert found.points.shape == (2, 5, 64, 3)
    mesh = trimesh.Trimesh(np.asarray(found.points).reshape(-1, 3), found.faces)
    assert mesh.area == pytest.approx(2.0 * np.pi * 2.0 * 0.7, rel=2e-3)
    # Faces look outwards.
    out = mesh.triangles_center - np.where(
        mesh.triangles_center[:, :1] > 1.5, [[3.0, 0, 0]], [[0.0, 0, 0]]
    )
    out[:, 2] = 0.0
    assert (np.einsum("ij,ij->i", out, mesh.face_normals) > 0.0).all()


def test_two_points_make_no_contour():
    with pytest.raises(ValueError, match="at least 3 points, got 2"):
        tubes(cylinders(0.5), turns=2)
