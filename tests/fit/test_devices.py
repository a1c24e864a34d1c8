import os
import pathlib
import subprocess
import sys

import jax
import numpy as np
import pytest

from hairfit.fit.devices import EVERYWHERE, device_mesh, put

SCRIPT = pathlib.Path(__file__).with_name("refine_on_devices.py")


def test_one_device_shares_nothing_out():
    assert len(jax.devices()) == 1
    assert device_mesh(8, 3000) is None
    arrays = {"one": np.arange(3)}
    assert put(None, arrays, EVERYWHERE) is arrays


def on_devices(count, out):
    """Run the script with so many devices of the host, and return what it wrote."""
    flags = f"--xla_force_host_platform_device_count={count}"
    paths = [str(SCRIPT.parent), *os.environ.get("PYTHONPATH", "").split(os.pathsep)]
    env = {
        **os.environ,
        "XLA_FLAGS": flags,
        "JAX_PLATFORMS": "cpu",
        "JAX_ENABLE_X64": "1",
        "PYTHONPATH": os.pathsep.join(paths),
    }
    subprocess.run([sys.executable, SCRIPT, out], check=True, env=env, timeout=600)
    with np.load(out) as found:
        return dict(found)


@pytest.mark.slow
def test_eight_devices_find_what_one_does(tmp_path):
    one, eight = (on_devices(n, tmp_path / f"{n}.npz") for n in (1, 8))
    assert one["devices"] == 1 and len(one["rows"]) == 0
    assert eight["devices"] == 8 and eight["rows"].tolist() == [2, 4]
    assert np.isclose(one["value"], eight["value"], rtol=1e-9)
    largest = np.abs(one["gradient"]).max()
    assert largest > 0.0
    assert np.allclose(one["gradient"], eight["gradient"], atol=1e-9 * largest)
    moved = np.linalg.norm(one["after"] - one["before"], axis=-1)
    assert moved.max() > 5e-4
    assert np.allclose(one["after"], eight["after"], atol=1e-9)
