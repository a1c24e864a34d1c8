import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hairfit.model import TreeConfidence
from hairfit.model.strand import sample_hair
from hairfit.render.studio import preview_scene
from hairfit.report.certainty import certainty_colour, certainty_pictures
from hairfit.synthetic import make_head, make_scalp, make_style


@pytest.fixture(scope="module")
def tree():
    return make_style("straight", 0, make_scalp(make_head()))


def said(tree, sigma_position):
    count = tree.count
    sigma = jnp.broadcast_to(jnp.asarray(sigma_position, jnp.float32), (count,))
    return TreeConfidence(sigma, 0.0 * sigma + 0.01, 0.0 * sigma + 1.0)


def test_what_is_sure_is_blue_and_a_guess_is_red():
    sigma = jnp.array([1e-4, 2.5e-3, 1.0])
    known = TreeConfidence(sigma, jnp.full(3, 0.01), jnp.ones(3))
    sure, half, guess = certainty_colour(known)
    assert sure[2] > 4 * sure[0] and guess[0] > 4 * guess[2]
    # As likely right as wrong is paler than both.
    assert half.min() > max(sure.min(), guess.min()) + 0.2


def test_pictures_show_each_cluster_in_its_colour(tree):
    # Hair on the person's left is sure, that on the right a guess.
    left = tree.cylinder.skeleton[:, 0, 0] > 0
    known = said(tree, jnp.where(left, 1e-4, 1.0))
    hair = sample_hair(tree, 6000, 32, jax.random.key(0))
    strands, owner = np.asarray(hair.strands, np.float64), np.asarray(hair.owner)
    pictures = certainty_pictures(preview_scene(strands, None), owner, known)
    assert len(pictures) == 4
    blue, red = [], []
    for picture in pictures:
        bright = picture.astype(int)
        # The background is bluish: hair is what is far from grey.
        blue.append(int((bright[..., 2] > bright[..., 0] + 60).sum()))
        red.append(int((bright[..., 0] > bright[..., 2] + 60).sum()))
    # From the front, the person's left, the back and the right.
    assert blue[1] > 5 * red[1] and red[3] > 5 * blue[3]
    front = pictures[0].astype(int)
    side = np.nonzero(front[..., 2] > front[..., 0] + 60)[1].mean()
    other = np.nonzero(front[..., 0] > front[..., 2] + 60)[1].mean()
    assert side > other + 30  # the person's left is on the right of the picture


def test_a_tree_that_does_not_say_is_not_shown(tree):
    scene, owner = preview_scene(np.zeros((1, 2, 3)), None), np.zeros(1, int)
    assert certainty_pictures(scene, owner, tree.confidence) == []
