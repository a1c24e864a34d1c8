import jax
import jax.numpy as jnp
import numpy as np
import pytest
import trimesh

from hairfit.model import scalp_normal, scalp_point
from hairfit.synthetic import head_distance, make_head, make_scalp
from hairfit.synthetic.head import head_normal


@pytest.fixture(scope="module")
def head():
    return make_head()


@pytest.fixture(scope="module")
def scalp(head):
    return make_scalp(head)


def test_the_head_is_one_closed_mesh_of_some_5000_faces_that_faces_outwards(head):
    surface = trimesh.Trimesh(head.vertices, head.faces, process=False)
    assert surface.is_watertight
    assert surface.is_winding_consistent
    assert surface.body_count == 1
    assert surface.volume == pytest.approx(0.0045, rel=0.1)
    assert 4500 < len(head.faces) < 5500


def test_the_head_has_a_persons_size_and_looks_along_z(head):
    low, high = head.vertices.min(0), head.vertices.max(0)
    assert high[0] - low[0] == pytest.approx(0.155, abs=0.015)  # with the ears
    assert high[1] == pytest.approx(0.122, abs=0.005)
    assert high[2] > -low[2]  # the nose
    nose = head.vertices[head.vertices[:, 2].argmax()]
    assert abs(nose[0]) < 0.004


def test_the_head_is_the_zero_set_of_its_distance(head):
    assert np.abs(head_distance(head.vertices)).max() < 3e-4
    assert head_distance(np.array([[0.0, 0.0, 0.0]])) < -0.04
    far = head_distance(np.array([[0.0, 0.3, 0.0]]))
    assert far == pytest.approx(0.3 - 0.122, rel=0.2)  # far off it is but a bound


def test_the_normal_is_where_the_distance_grows():
    p = np.array([[0.0, 0.13, -0.01], [0.09, 0.035, -0.01]])
    assert np.allclose(head_normal(p), [[0, 1, 0], [1, 0, 0]], atol=0.3)


def test_the_scalp_lies_on_the_head(scalp):
    side = np.linspace(0.0, 1.0, 41)
    uv = jnp.asarray(np.stack(np.meshgrid(side, side), -1).reshape(-1, 2), jnp.float32)
    p = np.asarray(jax.vmap(scalp_point, (None, 0))(scalp, uv), np.float64)
    assert np.abs(head_distance(p)).max() < 3.5e-3  # where the ear begins
    assert np.percentile(np.abs(head_distance(p)), 95) < 1.2e-3


def test_the_scalp_faces_outwards_also_at_its_corners(scalp):
    uv = jnp.array([[0.5, 0.5], [0.1, 0.2], [0, 0], [1, 0], [0, 1], [1, 1]], "f4")
    normal = np.asarray(jax.vmap(scalp_normal, (None, 0))(scalp, uv))
    p = np.asarray(jax.vmap(scalp_point, (None, 0))(scalp, uv), np.float64)
    assert (np.einsum("ij,ij->i", normal, head_normal(p)) > 0.8).all()


def test_u_runs_to_the_persons_left_and_v_from_forehead_to_nape(scalp):
    control = np.asarray(scalp.control)
    assert control[12, 6, 0] > 0.06 > -0.06 > control[0, 6, 0]
    forehead, nape = control[6, 0], control[6, 12]
    assert forehead[2] > 0.05 > -0.05 > nape[2]
    assert nape[1] < forehead[1] - 0.1
