"""An OpenGL context, or a skip that says why; and hair to draw."""

import numpy as np
import pytest

from hairfit.render.gl import NoContextError
from hairfit.render.gl.context import COMPUTE, open_context


@pytest.fixture(scope="module")
def context():
    try:
        context = open_context()
    except NoContextError as error:
        pytest.skip(f"OpenGL is needed here: {error}")
    if context.version_code < COMPUTE:
        pytest.skip(f"OpenGL 4.3 is needed here, this is {context.version_code}.")
    yield context
    context.release()


@pytest.fixture(scope="session")
def bob():
    """A bob of wavy hair: strands from the upper half of a ball, falling."""
    rng = np.random.default_rng(1)
    way = rng.normal(size=(300, 1, 3))
    way[..., 1] = np.abs(way[..., 1])
    way /= np.linalg.norm(way, axis=-1, keepdims=True)
    t = np.linspace(0.0, 1.0, 17)[None, :, None]
    fall = np.array([0.0, -0.2, 0.0]) * rng.uniform(0.6, 1.0, (300, 1, 1))
    wave = 0.004 * np.sin(20.0 * t + rng.uniform(0.0, 6.0, (300, 1, 1)))
    return (
        0.1 * way + 0.05 * t * way + t**1.5 * fall + wave * rng.normal(size=(300, 1, 3))
    )
