import numpy as np
import pytest
import trimesh
from known_hair import parallel, ragged

from hairfit.evaluate.inside import compare_with_head
from hairfit.evaluate.sample import sample_strands_evenly
from hairfit.types import Mesh, Strands


@pytest.fixture(scope="module")
def ball():
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=0.1)
    return Mesh(np.asarray(mesh.vertices), np.asarray(mesh.faces, np.int64))


def against(strands, head):
    return compare_with_head(strands, sample_strands_evenly(strands), head)


def test_hair_that_grows_out_of_the_head_is_rooted_and_outside(ball):
    ways = ball.vertices[::50] / 0.1
    hair = Strands.from_array(ways[:, None] * np.linspace(0.101, 0.2, 5)[:, None])
    errors = against(hair, ball)
    assert errors.share_inside == 0.0 and errors.deep == 0 and errors.deepest == 0.0
    assert errors.rooted == 1.0


def test_hair_in_the_head_is_counted_and_its_depth_is_known(ball):
    hair = ragged([[0, 0, 0.12], [0, 0, 0.08]], [[0, 0.1, 0], [0, 0.2, 0]])
    errors = against(hair, ball)
    assert errors.deepest == pytest.approx(0.02, abs=1e-4)
    # 40 and 100 points; the last 20 of the first are inside, 18 of them deeper than
    # 1 mm, and so is its tip.
    assert errors.share_inside == pytest.approx(20 / 140, abs=1.5 / 140)
    assert abs(errors.deep - 19) <= 1
    assert errors.rooted == 0.5


def test_hair_far_away_is_neither_inside_nor_rooted(ball):
    errors = against(Strands(parallel().points + 1.0, parallel().offsets), ball)
    assert (errors.share_inside, errors.deep, errors.rooted) == (0.0, 0, 0.0)
