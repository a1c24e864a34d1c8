"""The hair model against Mitsuba 3's `hair`: `pip install hairfit[mitsuba]`."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hairfit.render.chiang import chiang_near, hair_fibre
from hairfit.render.phase import PhaseAngles

mitsuba = pytest.importorskip("mitsuba", reason="mitsuba is not installed")
COUNT = 10_000


def directions(rng):
    vectors = rng.normal(size=(COUNT, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


@pytest.mark.slow
@pytest.mark.parametrize("eumelanin", [0.3, 1.3])
@pytest.mark.parametrize("roughness", [(0.3, 0.3), (0.6, 0.2)])
def test_it_is_mitsubas_within_two_percent(eumelanin, roughness):
    mitsuba.set_variant("scalar_rgb")
    fibre = {
        "type": "hair",
        "eumelanin": eumelanin,
        "pheomelanin": 0.2,
        "longitudinal_roughness": roughness[0],
        "azimuthal_roughness": roughness[1],
        "scale_tilt": 2.0,
        "int_ior": 1.55,
    }
    theirs = mitsuba.load_dict(fibre)
    rng = np.random.default_rng(0)
    eye, light = directions(rng), directions(rng)
    eye[:, 2] = np.abs(eye[:, 2])  # a fibre is seen from outside
    context, place = mitsuba.BSDFContext(), mitsuba.SurfaceInteraction3f()
    expected = np.empty((COUNT, 3))
    for row, (at, to) in enumerate(zip(eye, light, strict=True)):
        place.wi = at
        expected[row] = np.array(theirs.eval(context, place, mitsuba.Vector3f(to)))
    # Their fibre runs along y; z is the normal where it is seen.
    turn = np.arctan2(eye[:, 0], eye[:, 2])
    angles = PhaseAngles(
        jnp.asarray(np.arcsin(light[:, 1])),
        jnp.asarray(np.arcsin(eye[:, 1])),
        jnp.asarray(np.arctan2(light[:, 0], light[:, 2]) - turn),
    )
    ours = hair_fibre(eumelanin, 0.2, *roughness)
    each = jax.jit(jax.vmap(chiang_near, (0, None, 0)))
    found = np.asarray(each(angles, ours, jnp.asarray(np.sin(turn))))
    found = found * np.cos(np.asarray(angles.theta))[:, None]
    apart = np.abs(found - expected)
    assert apart.sum() < 0.005 * expected.sum()
    # Theirs is in float32: tails of 1e-9 at a fibre's very edge are rounding there.
    assert np.quantile(apart / expected, 0.999) < 0.02
    assert apart.max() < 0.02 * expected.max()
