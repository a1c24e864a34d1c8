"""Thin shells combed: the figures of chapter 3. Run `python examples/combing.py`."""

import argparse
import pathlib

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, UInt8
from sheet import PICTURES, Sheet, draw_curves, look_from, photograph

from hairfit.model import (
    GeneralizedCylinder,
    HairTree,
    Scalp,
    ScalpContour,
    catmull_rom_weights,
    plant,
    sample_strands,
    scalp_normal,
    stack,
)
from hairfit.model.combed import comb_cluster
from hairfit.model.combing import Comb, comb_hair, comb_repeatedly, even_comb
from hairfit.model.coons import coons_patch
from hairfit.model.shell import (
    ShellGrid,
    ShellHair,
    ThinShell,
    even_hair,
    shell_density,
    shell_point,
    shell_shadow,
    shell_strands,
)
from hairfit.render.camera import Camera
from hairfit.report.drawing import draw_hair, orbit_camera
from hairfit.synthetic.gallery import make_subject

GRID = ShellGrid()
POINTS = 60
BOX = np.array([[[-0.06, -0.20, 0.0], [0.06, -0.03, 0.04]]])
YELLOW, BLUE, GREY = "#d9a400", "#2b6cb0", "#888888"


def make_shell() -> ThinShell:
    """Return a shell of 12 mm over hair that falls over a back."""
    x = np.linspace(0.0, 1.0, 8)
    arch, zero = np.sin(np.pi * x), np.zeros(8)
    roots = np.stack([0.07 - 0.14 * x, 0.015 * arch, 0.03 * arch], 1)
    tips = np.stack([0.09 - 0.18 * x, -0.24 + 0.02 * arch, 0.02 + 0.02 * arch], 1)

    def side(start, end):
        line = start[None] * (1.0 - x[:, None]) + end[None] * x[:, None]
        return line + np.stack([zero, zero, 0.035 * arch], 1)

    curves = (roots, tips, side(roots[0], tips[0]), side(roots[-1], tips[-1]))
    return ThinShell(
        coons_patch(*(jnp.asarray(c, jnp.float32) for c in curves)), jnp.asarray(0.012)
    )


def sway(size: float = 0.12) -> Float[jax.Array, " knots"]:
    """Return how the combs of the examples move sideways along the hair."""
    return size * jnp.sin(jnp.linspace(0.0, 4.5, 8))


def camera_of_shell() -> Camera:
    """Return a camera that looks at the shell from outside."""
    size = (420, 520)
    return orbit_camera(BOX, float(np.radians(18.0)), float(np.radians(6.0)), size)


def hair_alone(
    strands: Float[jax.Array, "strands points 3"],
) -> UInt8[np.ndarray, "height width 3"]:
    """Return a picture of the shell's hair."""
    return draw_hair(np.asarray(strands, np.float64), None, [camera_of_shell()])[0]


def isolines(
    shell: ThinShell, u: float, across: int, along: int
) -> list[Float[np.ndarray, "curves points 3"]]:
    """Return the lines of even s and of even t on one layer of a shell."""
    fine = np.linspace(0.0, 1.0, 40)
    place = jax.jit(jax.vmap(jax.vmap(shell_point, (None, 0)), (None, 0)))
    lines = []
    for axis, count in ((0, across), (1, along)):
        even = np.linspace(0.0, 1.0, count)
        fixed, free = np.meshgrid(even, fine, indexing="ij")
        stu = [fixed, free] if axis == 0 else [free, fixed]
        grid = np.stack([*stu, np.full_like(fixed, u)], -1)
        lines.append(np.asarray(place(shell, jnp.asarray(grid, jnp.float32))))
    return lines


def blank() -> UInt8[np.ndarray, "height width 3"]:
    """Return white paper of the size of the pictures."""
    return np.full((520, 420, 3), 255, np.uint8)


def draw_shell(sheet: Sheet, shell: ThinShell) -> None:
    """Draw figure 3-3: the surface, and the layer over it."""
    axes = sheet.add("3-3: a surface and its thin shell", blank())
    for u, colour, width in ((0.0, BLUE, 0.7), (1.0, YELLOW, 0.7)):
        for lines in isolines(shell, u, 9, 9):
            draw_curves(axes, lines, camera_of_shell(), color=colour, lw=width)
    corner = [[s, t] for s in (0.0, 1.0) for t in np.linspace(0.0, 1.0, 5)]
    place = jax.jit(jax.vmap(shell_point, (None, 0)))
    ends = [
        place(shell, jnp.asarray([[*c, u] for c in corner], jnp.float32))
        for u in (0.0, 1.0)
    ]
    edges = np.stack([np.asarray(e) for e in ends], 1)
    draw_curves(axes, edges, camera_of_shell(), color=GREY, lw=0.7)


def draw_density(sheet: Sheet, strands: int) -> None:
    """Draw figure 3-5: how a stroke changes the density across a tooth."""
    axes = sheet.add("3-5: density across a tooth", None)
    s = (jnp.arange(strands) + 0.5) / strands
    hair = ShellHair(s[:, None], jnp.full((strands, 1), 0.9), jnp.array([0.5]))
    width = jnp.asarray(0.6)
    comb = Comb(jnp.full((1, 2), 0.5), width, width, jnp.asarray(0.5))
    after = comb_hair(hair, comb, ShellGrid(1, 1, 1), jax.random.key(0))
    bins = np.linspace(0.0, 1.0, 61)
    for values, colour in ((hair.s, GREY), (after.s, BLUE)):
        counts = np.histogram(np.asarray(values), bins)[0] * 60 / strands
        axes.stairs(counts, bins, color=colour)
    at = np.linspace(0.0, 1.0, 300)
    x = np.minimum(np.abs(at - 0.5) / 0.3, 1.0)
    want = 1.0 - np.cos(0.5 * np.pi * x) + 2.0 / np.pi * (x < 1.0)
    axes.plot(at, want, color=YELLOW, lw=1.0)
    axes.set_ylim(0.0, 2.0)
    axes.set_xlabel("s (yellow: closed form)", fontsize=7)
    axes.tick_params(labelsize=6)


def draw_sweep(sheet: Sheet, grid: ShellGrid) -> None:
    """Draw figure 3-6: strands that follow the path of one tooth, in s and t."""
    axes = sheet.add("3-6: strands bend along the path", None)
    hair = even_hair(70, grid, jax.random.key(3))
    path = 0.45 + sway(0.3)
    width = jnp.asarray(0.2)
    comb = Comb(path[None], width, width, jnp.asarray(1.0))
    after = comb_hair(hair, comb, grid, jax.random.key(4))
    moved = np.asarray(jnp.any(after.s != hair.s, axis=1))
    for strand, bent in zip(np.asarray(after.s), moved, strict=True):
        colour = BLUE if bent else "#c8c8c8"
        axes.plot(strand, np.asarray(after.t), color=colour, lw=0.7)
    t = jnp.linspace(0.0, 1.0, 60)
    curve = np.asarray(catmull_rom_weights(len(path), t) @ path)
    axes.plot(curve, np.asarray(t), color=YELLOW, lw=2.5)
    axes.set(xlim=(0.0, 1.0), ylim=(1.0, 0.0))
    axes.set_xlabel("s", fontsize=7)
    axes.set_ylabel("t", fontsize=7)
    axes.tick_params(labelsize=6)


def draw_section(sheet: Sheet, hair: ShellHair, comb: Comb, grid: ShellGrid) -> None:
    """Draw figure 3-7: who lies where in the depth after a stroke."""
    axes = sheet.add("3-7: a row after a stroke; combed in blue", None)
    after = comb_hair(hair, comb, grid, jax.random.key(2))
    row = grid.rows - 1
    moved = np.asarray(after.s[:, row] != hair.s[:, row])
    s, u = np.asarray(after.s[:, row]), np.asarray(after.u[:, row])
    axes.scatter(s[~moved], u[~moved], s=1.2, color="#b0b0b0", lw=0)
    axes.scatter(s[moved], u[moved], s=1.8, color=BLUE, lw=0)
    middle = np.asarray(comb.path)[:, -1]
    low = 1.0 - float(comb.depth)
    top, bottom = 0.5 * float(comb.top), 0.5 * float(comb.bottom)
    for m in middle:
        axes.plot(
            [m - top, m - bottom, m + bottom, m + top],
            [1.0, low, low, 1.0],
            color=YELLOW,
            lw=1.0,
        )
    axes.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0))
    axes.set_xlabel("s", fontsize=7)
    axes.set_ylabel("u", fontsize=7)
    axes.tick_params(labelsize=6)


def draw_combing(sheet: Sheet, shell: ThinShell, strands: int) -> None:
    """Draw figure 3-9: the surface, the comb's paths, hair before and after."""
    axes = sheet.add("3-9a: the hair's surface", blank())
    for lines in isolines(shell, 0.0, 17, 17):
        draw_curves(axes, lines, camera_of_shell(), color=BLUE, lw=0.5)
    comb = even_comb(20, sway(), jax.random.key(1))
    axes = sheet.add("3-9b: paths of 20 teeth", blank())
    for lines in isolines(shell, 0.0, 7, 7):
        draw_curves(axes, lines, camera_of_shell(), color="#cccccc", lw=0.4)
    t = jnp.linspace(0.0, 1.0, comb.path.shape[1])
    paths = ShellHair(comb.path, jnp.ones_like(comb.path), t)
    teeth = np.asarray(shell_strands(shell, paths, POINTS))
    draw_curves(axes, teeth, camera_of_shell(), color=YELLOW, lw=1.2)
    hair = even_hair(strands, GRID, jax.random.key(0))
    before = shell_strands(shell, hair, POINTS)
    sheet.add(f"3-9c: {strands} strands", hair_alone(before))
    after = comb_hair(hair, comb, GRID, jax.random.key(2))
    combed = hair_alone(shell_strands(shell, after, POINTS))
    sheet.add("3-9d: after one stroke", combed)


def draw_teeth(sheet: Sheet, shell: ThinShell, strands: int) -> None:
    """Draw figure 3-11: combs of 40, 20 and 12 teeth, two strokes each."""
    hair = even_hair(strands, GRID, jax.random.key(0))
    for teeth in (40, 20, 12):
        combs = [
            even_comb(teeth, sway(size), jax.random.key(i), variation=0.6)
            for i, size in enumerate((0.10, -0.06))
        ]
        after = comb_repeatedly(hair, combs, GRID, jax.random.key(5))
        picture = hair_alone(shell_strands(shell, after, POINTS))
        sheet.add(f"3-11: {teeth} teeth, two strokes", picture)


def draw_shadow(sheet: Sheet, strands: int) -> None:
    """Draw section 3.3.1: the shadow in a cross-section of combed hair."""
    axes = sheet.add("3.3.1: light in the cells of a row", None)
    comb = even_comb(5, sway(), jax.random.key(1), taper=0.7)
    hair = even_hair(strands, GRID, jax.random.key(0))
    after = comb_repeatedly(hair, [comb] * 3, GRID, jax.random.key(5))
    shadow = shell_shadow(shell_density(after, GRID), 0.15)
    light = np.exp(-np.asarray(shadow)[:, GRID.rows // 2])
    axes.imshow(
        light.T,
        origin="lower",
        extent=(0, 1, 0, 1),
        cmap="gray",
        vmin=0.0,
        vmax=1.0,
        aspect="auto",
    )
    axes.set_xlabel("s", fontsize=7)
    axes.set_ylabel("u", fontsize=7)
    axes.tick_params(labelsize=6)


def falling(scalp: Scalp, uv: tuple[float, float], radius: float) -> HairTree:
    """Return a tree of one cluster that leaves the scalp and falls down."""
    dtype = scalp.control.dtype
    contour = ScalpContour(
        jnp.asarray(uv, dtype), jnp.asarray(radius, dtype), jnp.zeros(32, dtype)
    )
    knots = 12
    cylinder = plant(scalp, contour, 0.25, knots)
    up = scalp_normal(scalp, contour.centre)
    x = jnp.linspace(0.0, 1.0, knots, dtype=dtype)
    out = 0.045 * (1.0 - jnp.exp(-6.0 * x))
    down = 0.26 * jnp.maximum(x - 0.03, 0.0)
    fall = jnp.array([[0.0, -1.0, 0.0]], dtype)
    root = cylinder.skeleton[:1]
    skeleton = root + out[:, None] * up[None] + down[:, None] * fall
    cylinder = eqx.tree_at(lambda c: c.skeleton, cylinder, skeleton)
    many: GeneralizedCylinder = stack([cylinder])
    return HairTree(scalp, stack([contour]), many, jnp.full(1, 0.1, dtype), (-1,))


def draw_cluster(sheet: Sheet, strands: int) -> None:
    """Draw a cluster of a tree before and after it is combed."""
    tree = falling(make_subject().scalp, (0.5, 0.78), 0.24)
    key = jax.random.key(0)
    soft = even_comb(6, sway(0.15), key, depth=0.6)
    other = even_comb(9, sway(-0.1), jax.random.key(4), depth=0.5)
    wisps = strands // 4
    camera = look_from(200.0, 8.0, low=(-0.07, -0.17, -0.16), high=(0.07, 0.11, 0.05))
    for title, one in (
        ("A cluster of a tree", tree),
        ("The same combed once: its detail", comb_cluster(tree, 0, soft, key, wisps)),
        (
            "Combed twice",
            comb_cluster(tree, 0, [soft, other], key, wisps),
        ),
    ):
        grown = sample_strands(one, strands, 48, jax.random.key(1))
        sheet.add(title, photograph(np.asarray(grown), camera))


def main(out: pathlib.Path, strands: int = 4000) -> None:
    """Draw the sheet.

    Args:
        out: The JPEG.
        strands: Strands of the shell of figure 3-9.
    """
    shell = make_shell()
    sheet = Sheet(3, 5, (285, 352))
    draw_shell(sheet, shell)
    draw_density(sheet, 10 * strands)
    draw_sweep(sheet, GRID)
    hair = even_hair(strands, GRID, jax.random.key(0))
    comb = even_comb(5, sway(0.0), jax.random.key(1), taper=0.4, depth=0.6)
    draw_section(sheet, hair, comb, GRID)
    draw_shadow(sheet, strands)
    draw_combing(sheet, shell, strands)
    draw_teeth(sheet, shell, strands * 7 // 4)
    draw_cluster(sheet, strands)
    sheet.save(out)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=pathlib.Path, default=PICTURES / "combing.jpg")
    main(parser.parse_args().out)
