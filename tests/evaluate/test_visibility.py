import numpy as np
from known_hair import front_camera, ragged

from hairfit.capture.capture import View
from hairfit.evaluate.sample import sample_strands_evenly
from hairfit.evaluate.visibility import even_strands, find_visible, look
from hairfit.types import Mesh, Strands


def view():
    image = np.zeros((96, 96, 3), np.float32)
    return View("front", front_camera(), image, np.ones((96, 96), bool))


def curtain(z, width=0.08, count=200):
    """Return a dense curtain of strands that hang in the plane `z`."""
    x = np.linspace(-width / 2, width / 2, count)
    y = np.linspace(0.04, -0.04, 9)
    return np.stack(
        [
            np.repeat(x[:, None], 9, 1),
            np.repeat(y[None], count, 0),
            np.full((count, 9), z),
        ],
        axis=2,
    )


def seen(strands, head=None):
    samples = sample_strands_evenly(strands)
    sights = look(head, [view()])
    return find_visible(samples, even_strands(strands), sights), samples


def test_a_curtain_hides_the_one_behind_it():
    found, samples = seen(
        Strands.from_array(np.concatenate([curtain(0.02), curtain(-0.02, 0.06)]))
    )
    front = samples.strand < 200
    assert found[front].mean() > 0.99
    assert found[~front].mean() < 0.01


def test_hair_a_millimetre_below_the_surface_is_seen():
    found, _ = seen(
        Strands.from_array(np.concatenate([curtain(0.02), curtain(0.019, 0.06)]))
    )
    assert found.mean() > 0.99


def test_the_head_hides_hair():
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
    wall = Mesh(corners + [0, 0, 0.03], np.array([[0, 1, 2], [0, 2, 3]]))
    hair = Strands.from_array(curtain(0.02))
    assert seen(hair)[0].mean() > 0.99
    assert not seen(hair, wall)[0].any()


def test_hair_outside_the_picture_is_not_seen():
    assert not seen(Strands.from_array(curtain(0.02) + [1.0, 0, 0]))[0].any()


def test_strands_of_different_counts_are_drawn_alike():
    hair = ragged(
        [[0, 0, 0], [0, 1, 0]], [[5, 5, 5]], [[0, 0, 0], [0, 0.1, 0], [0, 1, 0]]
    )
    drawn = even_strands(hair)
    assert drawn.shape == (2, 3, 3)
    assert np.allclose(drawn[0], [[0, 0, 0], [0, 0.5, 0], [0, 1, 0]])
