import numpy as np
import pytest
from combed import HEAD, HIGH_TIE, STYLES, comb, load_head

from hairfit.evaluate.inside import depths


@pytest.fixture(scope="module")
def high_tail():
    if not HEAD.exists():
        pytest.skip("the head of ICT's face kit is not at ../shared/files/heads")
    return np.asarray(comb("high-tail").points).reshape(
        STYLES["high-tail"].hairs, -1, 3
    )


def test_combed_hair_is_rooted_on_the_head_and_grows_out_of_it(high_tail):
    head = load_head()
    # Samples of the surface are some 1 mm apart, so that hair between them may dip.
    assert depths(high_tail[:, 0], head).max() < 5e-4
    assert np.mean(depths(high_tail[::10].reshape(-1, 3), head) > 2e-3) < 0.01


def test_hair_that_is_tied_goes_through_its_tie_and_is_as_long_as_planned(high_tail):
    nearest = np.linalg.norm(high_tail - HIGH_TIE, axis=2).min(axis=1)
    assert np.mean(nearest < 0.02) > 0.95
    length = np.linalg.norm(np.diff(high_tail, axis=1), axis=2).sum(axis=1)
    assert length.min() > 0.35 and length.max() < 0.51
