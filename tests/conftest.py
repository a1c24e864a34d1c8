"""What every test runs under: float64 and strict JAX; and a scalp to grow hair on."""

import gc
import os
import pathlib

CACHE = pathlib.Path(__file__).parent.parent / ".jax_cache"
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(CACHE))
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
# Most of the suite's time is compilation of programs that run once: those are compiled
# as `hairfit.cli.SOONER` has it, and not optimised. Either takes a quarter of the time.
os.environ.setdefault("XLA_FLAGS", "--xla_cpu_use_fusion_emitters=false")
os.environ.setdefault("JAX_DISABLE_MOST_OPTIMIZATIONS", "1")

# Every compiled program maps several pieces of memory, and Linux gives a process 65530.
MOST_MAPS = 30_000

import jax  # noqa: E402  (reads the environment when imported)
import pytest  # noqa: E402

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")


@pytest.fixture(autouse=True, scope="module")
def _few_programs():
    """Forget compiled programs before a process has as many as it can hold."""
    yield
    maps = pathlib.Path("/proc/self/maps")
    if maps.exists() and maps.read_bytes().count(b"\n") > MOST_MAPS:
        jax.clear_caches()
        gc.collect()


@pytest.fixture(scope="session")
def captures() -> pathlib.Path:
    """The folder of reference captures beside the checkout, or a skip."""
    folder = pathlib.Path(__file__).parents[2] / "shared" / "captures"
    if not folder.is_dir():
        pytest.skip("the reference captures are not at ../shared/captures")
    return folder
