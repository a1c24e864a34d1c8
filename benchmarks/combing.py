"""How long it takes to comb the hair of a thin shell, and to reconstruct its strands.

Run `python benchmarks/combing.py`. As in section 3.4 of the thesis, where it took 20 to
30 seconds: 4 000 strands in a shell of 20 x 20 x 10 cells, a comb of 20 teeth.
"""

import jax
import jax.numpy as jnp
from strands import machine, measure

from hairfit.model.combing import comb_hair, even_comb
from hairfit.model.coons import coons_patch
from hairfit.model.shell import (
    ShellGrid,
    ThinShell,
    even_hair,
    particle_shadow,
    shell_density,
    shell_shadow,
    shell_strands,
)

STRANDS, POINTS, TEETH = 4_000, 41, 20
GRID = ShellGrid(columns=20, rows=20, layers=10)


def make_shell() -> ThinShell:
    """Return a shell of 10 mm over a patch that is bent both ways."""
    x = jnp.linspace(0.0, 1.0, 8)
    flat, bow = jnp.zeros(8), jnp.sin(jnp.pi * x)
    roots = jnp.stack([0.15 * x, flat, 0.03 * bow], axis=1)
    side = jnp.stack([0.02 * bow, -0.25 * x, 0.05 * bow], axis=1)
    patch = coons_patch(roots, roots + side[-1:], side + roots[:1], side + roots[-1:])
    return ThinShell(patch, jnp.asarray(0.01))


def main() -> None:
    """Print all figures."""
    print(machine())
    shell, key = make_shell(), jax.random.key(0)
    hair = even_hair(STRANDS, GRID, key)
    sway = 0.1 * jnp.sin(jnp.linspace(0.0, 3.0, 8))
    comb = even_comb(TEETH, sway, key)
    cells = f"{GRID.columns} x {GRID.rows} x {GRID.layers} cells"

    def shadow(hair):
        dark = shell_shadow(shell_density(hair, GRID), 0.2)
        return particle_shadow(hair, dark, 0.05, key)

    measure(
        f"combing {STRANDS} strands in {cells}, {TEETH} teeth",
        lambda: comb_hair(hair, comb, GRID, key),
    )
    combed = comb_hair(hair, comb, GRID, key)
    measure(
        f"reconstruction of {STRANDS} strands x {POINTS - 1} segments",
        lambda: shell_strands(shell, combed, POINTS),
    )
    measure(
        "both",
        lambda: shell_strands(shell, comb_hair(hair, comb, GRID, key), POINTS),
    )
    measure("probabilistic shadow", lambda: shadow(combed))


if __name__ == "__main__":
    main()
