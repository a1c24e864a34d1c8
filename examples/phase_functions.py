"""Phase functions of a fibre: figures 5-7, 5-8, 5-9 and 5-11 of the thesis.

Run `python examples/phase_functions.py [--out FILE]`. Polar plots across the fibre, the
light from above as in the thesis. The last row is beyond it: how Marschner's and
Chiang's models see brown hair, along the fibre and around it.
"""

import argparse
import pathlib

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure
from matplotlib.projections.polar import PolarAxes
from sheet import PICTURES

from hairfit.render import Fibre
from hairfit.render.chiang import chiang, hair_fibre
from hairfit.render.marschner import marschner
from hairfit.render.phase import (
    PhaseAngles,
    kajiya_kay_phase,
    reflected,
    transmitted,
)
from hairfit.render.single_layer import simulate_layer

OUT = PICTURES / "phase_functions.jpg"
PHI = np.linspace(-np.pi, np.pi, 721)
# Figure 5-9: what is reflected, what is transmitted, and the sharpness.
MIXED = ((1.0, 0.5, 3.0), (1.0, 1.0, 2.0), (0.3, 1.0, 5.0), (0.5, 1.0, 3.0))
# Figure 5-11: indices of refraction.
INDICES = (1.2, 1.5, 2.5, 3.5)
back = jax.vmap(reflected)
on = jax.vmap(transmitted, (0, None))


def polar(figure: Figure, place: int, title: str) -> PolarAxes:
    """Return polar axes with the light from above."""
    axes = figure.add_subplot(4, 4, place, projection="polar")
    assert isinstance(axes, PolarAxes)
    axes.set_theta_zero_location("N")
    axes.set_title(title, fontsize=8, pad=6)
    axes.tick_params(labelsize=5, pad=-2)
    axes.set_yticklabels([])
    return axes


def draw_lobes(figure: Figure) -> None:
    """Draw figures 5-7 and 5-8: lobes by themselves."""
    polar(figure, 1, "5-7a: backward lobe (5-21)").plot(PHI, back(PHI))
    # In the plane of the fibre: zenith angles, the light 40 degrees from the normal.
    none = jnp.zeros(3)
    fibre = Fibre(none, jnp.full(3, 0.35), jnp.full(3, 0.65), jnp.asarray(12.0))
    light = jnp.radians(40.0)
    at = PhaseAngles(
        jnp.full(len(PHI), light), jnp.asarray(PHI), 0.0 * jnp.asarray(PHI)
    )
    seen = jax.vmap(kajiya_kay_phase, (0, None))(at, fibre)[:, 0]
    axes = polar(figure, 2, "5-7b: Kajiya-Kay, light at 40°")
    axes.plot(PHI, np.where(np.abs(PHI) < np.pi / 2, seen, np.nan))
    axes.annotate(
        "", (float(light), 0.4), (float(light), 1.0), arrowprops={"width": 0.5}
    )
    polar(figure, 3, "5-8: forward lobe (5-22), k = 1").plot(PHI, on(PHI, 1.0))
    axes = polar(figure, 4, "5-8: k = 2 (dashed) and 4")
    axes.plot(PHI, on(PHI, 4.0))
    axes.plot(PHI, on(PHI, 2.0), "--", linewidth=0.8)


def draw_mixed(figure: Figure) -> None:
    """Draw figure 5-9: both lobes together."""
    for place, (r, t, k) in enumerate(MIXED, 5):
        axes = polar(figure, place, f"5-9: $\\rho_r$={r}, $\\rho_t$={t}, k={k:g}")
        axes.plot(PHI, r * back(PHI) + t * on(PHI, k))


def draw_simulated(figure: Figure, rays: int) -> None:
    """Draw figure 5-11: one clear layer, ray by ray."""
    for place, ior in enumerate(INDICES, 9):
        table = simulate_layer(ior, rays=rays)
        middle = 0.5 * (table.edges[1:] + table.edges[:-1])
        axes = polar(figure, place, f"5-11: index of refraction {ior}")
        axes.fill(middle, table.density, linewidth=0.6, alpha=0.4)
        axes.plot(middle, table.density, linewidth=0.7)


def draw_models(figure: Figure) -> None:
    """Draw Marschner's and Chiang's models around and along a fibre of brown hair."""
    fibre = hair_fibre(1.0, 0.2)
    level = jnp.zeros(len(PHI))
    around = PhaseAngles(level, level, jnp.asarray(PHI))
    steep = jnp.full(len(PHI), jnp.radians(30.0))
    along = jnp.linspace(-1.5, 1.5, len(PHI))
    for place, name, model in (
        (13, "Marschner 2003", marschner),
        (15, "Chiang 2016", chiang),
    ):
        each = jax.jit(jax.vmap(model, (0, None)))
        axes = polar(figure, place, f"{name}: around")
        axes.set_prop_cycle(color=("tab:red", "tab:green", "tab:blue"))
        axes.plot(PHI, np.sqrt(each(around, fibre)))
        axes = figure.add_subplot(4, 4, place + 1)
        axes.set_title("along, light at 30°: behind, in front", fontsize=8)
        for phi, style in ((np.pi, "-"), (0.0, "--")):
            at = PhaseAngles(steep, along, jnp.full(len(PHI), phi))
            axes.set_prop_cycle(color=("tab:red", "tab:green", "tab:blue"))
            axes.plot(np.degrees(along), each(at, fibre), style, linewidth=0.8)
        axes.tick_params(labelsize=6)


def main(out: pathlib.Path = OUT, rays: int = 4_000_000) -> None:
    """Write the picture.

    Args:
        out: Where to.
        rays: Of each simulation of figure 5-11.
    """
    figure = Figure(figsize=(11, 11), dpi=120)
    draw_lobes(figure)
    draw_mixed(figure)
    draw_simulated(figure, rays)
    draw_models(figure)
    figure.tight_layout(pad=0.8)
    figure.savefig(out, pil_kwargs={"quality": 85})
    print(f"wrote {out}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=pathlib.Path, default=OUT)
    main(parser.parse_args().out)
