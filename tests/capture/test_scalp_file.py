import jax.numpy as jnp
import numpy as np
import pytest

from hairfit.capture import load_scalp, save_scalp
from hairfit.errors import InputError
from hairfit.model.scalp import Scalp


def test_a_scalp_is_read_as_it_was_written(tmp_path):
    control = np.random.default_rng(0).normal(size=(13, 13, 3))
    save_scalp(tmp_path / "scalp.json", Scalp(jnp.asarray(control)))
    back = load_scalp(tmp_path / "scalp.json")
    assert np.allclose(back.control, control, atol=1e-6)


def test_the_same_scalp_is_the_same_bytes(tmp_path):
    scalp = Scalp(jnp.linspace(0.0, 1.0, 507).reshape(13, 13, 3))
    save_scalp(tmp_path / "a.json", scalp)
    save_scalp(tmp_path / "b.json", load_scalp(tmp_path / "a.json"))
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()


def test_nan_is_refused(tmp_path):
    control = np.full((13, 13, 3), np.nan)
    save_scalp(tmp_path / "scalp.json", Scalp(jnp.asarray(control)))
    with pytest.raises(InputError, match="must hold 13x13 finite points"):
        load_scalp(tmp_path / "scalp.json")
