"""Captures of more hairstyles by a path tracer that shares no code with hairfit.

Run `python benchmarks/path_traced.py OUT [NAME ...] [--scenes FOLDER]`; then
`python benchmarks/accuracy.py OUT/NAME --views 12` fits all photographs of one. Needs
`../shared/tools/photograph.py`, and what it needs: Mitsuba 3 and an LLVM, whose library
`DRJIT_LIBLLVM_PATH` names. A photograph takes half a minute on 2 cores.
"""

import argparse
import pathlib
import subprocess
import sys
from typing import NamedTuple

import jax
import numpy as np
from combed import MIDDLE, STYLES, comb, load_head
from scenes import SCENES, make_apart
from scipy.interpolate import make_interp_spline
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from hairfit.io.mesh import save_mesh
from hairfit.io.strands import load_strands, save_strands
from hairfit.model import sample_strands
from hairfit.render.raster import unit
from hairfit.types import Strands, along_paths, resample_paths

SHARED = pathlib.Path(__file__).parents[2] / "shared"
KNOTS = 32
HAIRS_A_WISP = 60
ROUND = "--views 8"
FRONT = "--views 5 --arc 200 --start -80 --light -0.9 1 1.4"
PHONE = "--size 600 800"
SMALL = "--size 600 750"


class Swing(NamedTuple):
    """How hair swings about the way it had, wisp by wisp.

    Attributes:
        size: How far, in metres.
        length: Of a turn or a wave, in metres.
        flat: Whether it waves in planes; else it winds, to either side.
        beyond: Metres from the middle of ICT's head within which hair does not swing.
        knots: Of the hair that swings.
    """

    size: float
    length: float
    flat: bool = False
    beyond: float = 0.0
    knots: int = 64


class Recipe(NamedTuple):
    """What is photographed, and how.

    Attributes:
        groom: A reference capture, a drawn scene, a style of `combed.py`, or
            `straight.hair` for Cem Yuksel's model on the head of ICT's face kit.
        options: Of the path tracer.
        strands: Of a drawn scene's tree; 0 for those of its truth.
        swing: Given to the groom before, None for none.
        kept: How much of its length each hair keeps, from the root on.
    """

    groom: str
    options: str
    strands: int = 0
    swing: Swing | None = None
    kept: float = 1.0


RECIPES = {
    "black-straight": Recipe("straight.hair", f"{ROUND} --colour black"),
    "black-ruby": Recipe("ruby", f"{ROUND} --colour black"),
    "traced-curls": Recipe("curly", f"{ROUND} --colour brown"),
    "traced-afro": Recipe("afro", f"{ROUND} --colour black"),
    "traced-buzz-cut": Recipe("buzz-cut", f"{ROUND} {PHONE} --colour brown", 40_000),
    "bob-from-the-front": Recipe(
        "bob", f"{FRONT} {PHONE} --colour grey --room", 30_000
    ),
    "ponytail-from-the-front": Recipe("ponytail", f"{FRONT} --colour blonde"),
    "ponytail-by-a-phone": Recipe(
        "ponytail", f"{FRONT} --size 1536 2048 --colour blonde --spp 16"
    ),
    "waved-ruby": Recipe(
        "ruby",
        "--colour blonde --light -0.9 1.2 1.1",
        swing=Swing(0.005, 0.050, flat=True),
    ),
    "wound-ruby": Recipe("ruby", "--colour brown", swing=Swing(0.005, 0.045)),
    "curled-ruby": Recipe(
        "ruby", "--colour red --light -0.5 1.3 1.2", swing=Swing(0.007, 0.040)
    ),
    "curled-ponytail": Recipe("ponytail", "--colour black", swing=Swing(0.006, 0.035)),
    "bobbed-ruby": Recipe("ruby", "--colour grey --light 0.2 1.4 1.3", kept=0.45),
    "cropped-ruby": Recipe(
        "ruby", f"{ROUND} --colour brown --light 0.2 1.4 1.3", kept=0.3
    ),
    "cropped-ponytail": Recipe("ponytail", f"{ROUND} --colour blonde", kept=0.4),
    "cropped-straight": Recipe("straight.hair", f"{ROUND} --colour red", kept=0.4),
    "waved-straight": Recipe(
        "straight.hair",
        f"{ROUND} --colour black --light -0.6 1.3 1.3",
        swing=Swing(0.006, 0.055, flat=True),
    ),
    "curled-straight": Recipe(
        "straight.hair", f"{ROUND} --colour red", swing=Swing(0.008, 0.035)
    ),
    "short-curls": Recipe(
        "straight.hair",
        f"{ROUND} --colour brown",
        swing=Swing(0.005, 0.022),
        kept=0.22,
    ),
    "short-curled-ruby": Recipe(
        "ruby",
        f"{ROUND} --colour black --light -0.6 1.3 1.2",
        swing=Swing(0.005, 0.025),
        kept=0.35,
    ),
    "to-the-waist": Recipe("to-the-waist", f"{SMALL} --colour brown"),
    "over-a-shoulder": Recipe("over-a-shoulder", f"{SMALL} --colour red"),
    "mullet": Recipe("mullet", f"{SMALL} --colour blonde --light -0.9 1.2 1.1"),
    "bowl-cut": Recipe("bowl-cut", f"{SMALL} --colour black"),
    "pompadour": Recipe("pompadour", f"{SMALL} --colour brown --light -0.5 1.3 1.2"),
    "windblown": Recipe("windblown", f"{SMALL} --colour blonde"),
    "rows": Recipe("rows", f"{SMALL} --colour black --skin 0.28 0.17 0.12"),
    "side-tail": Recipe("side-tail", f"{SMALL} --colour grey --light -0.6 1.3 1.3"),
    "high-tail": Recipe("high-tail", f"{SMALL} --colour blonde"),
    "low-bun": Recipe("low-bun", f"{SMALL} --colour brown"),
    "top-knot": Recipe("top-knot", f"{SMALL} --colour brown --light 0.2 1.4 1.3"),
    "puffs": Recipe(
        "puffs",
        f"{SMALL} --colour black --skin 0.28 0.17 0.12 --light -0.9 1.2 1.1",
        swing=Swing(0.004, 0.020),
    ),
    "curly-tail": Recipe(
        "high-tail",
        f"{SMALL} --colour brown --light -0.9 1.2 1.1",
        swing=Swing(0.006, 0.032, beyond=0.125, knots=128),
    ),
    "curled-ends": Recipe(
        "over-a-shoulder",
        f"{SMALL} --colour blonde --light -0.5 1.3 1.2",
        swing=Swing(0.008, 0.045, beyond=0.13, knots=96),
    ),
    "tousled": Recipe("tousled", f"{SMALL} --colour red"),
    "bobbed": Recipe("bobbed", f"{SMALL} --colour grey"),
}


def main() -> None:
    """Photograph what is asked for, all by default."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("names", nargs="*", default=list(RECIPES))
    parser.add_argument("--scenes", type=pathlib.Path, help="where scenes are kept")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    for name in given.names:
        recipe = RECIPES[name]
        groom, head = find_groom(recipe, given.out, given.scenes or given.out)
        tool = str(SHARED / "tools" / "photograph.py")
        words = [sys.executable, tool, str(groom), str(head), str(given.out / name)]
        subprocess.run([*words, "--spp", "32", *recipe.options.split()], check=True)


def find_groom(
    recipe: Recipe, out: pathlib.Path, scenes: pathlib.Path
) -> tuple[pathlib.Path, pathlib.Path]:
    """Return the files of a groom and of its head, which are made if need be."""
    if recipe.groom in STYLES or recipe.groom.endswith(".hair"):
        path = out / f"{pathlib.Path(recipe.groom).stem}-changed.npz"
        head = out / "head.obj"
        if recipe.groom in STYLES:
            hair = comb(recipe.groom)
        else:
            hair = stood_on(load_strands(SHARED / "files" / recipe.groom))
        save_strands(path, changed(hair, recipe))
        save_mesh(head, load_head())
        return path, head
    if recipe.groom not in SCENES:
        folder = SHARED / "captures" / recipe.groom
        if recipe.swing is None and recipe.kept == 1.0:
            return folder / "truth.npz", folder / "head.obj"
        path = out / f"{recipe.groom}-changed.npz"
        save_strands(path, changed(load_strands(folder / "truth.npz"), recipe))
        return path, folder / "head.obj"
    folder = make_apart(recipe.groom, scenes)
    if not recipe.strands:
        return folder / "truth.npz", folder / "head.obj"
    drawn = SCENES[recipe.groom]
    key = jax.random.key(0)
    dense = sample_strands(drawn.tree(), recipe.strands, drawn.points, key)
    path = out / f"{recipe.groom}-{recipe.strands}.npz"
    save_strands(path, Strands.from_array(np.asarray(dense)))
    return path, folder / "head.obj"


def changed(strands: Strands, recipe: Recipe) -> Strands:
    """Return hair as a recipe has it: cut, from the roots on, and then swung."""
    if recipe.kept < 1.0:
        knots = np.asarray(strands.points, np.float64).reshape(strands.count, -1, 3)
        strands = Strands.from_array(resample_paths(knots, KNOTS, recipe.kept))
    return strands if recipe.swing is None else swung(strands, recipe.swing)


def swung(strands: Strands, swing: Swing) -> Strands:
    """Return hair that swings, from 2 cm after its roots on and fully after 7 cm.

    Hairs whose roots and middles lie together are a wisp, and swing nearly alike.
    """
    rng = np.random.default_rng(0)
    model = np.asarray(strands.points, np.float64).reshape(strands.count, -1, 3)
    path = resample_paths(model, swing.knots)
    place = np.concatenate([path[:, 0], 0.5 * path[:, swing.knots // 2]], axis=1)
    count = max(1, strands.count // HAIRS_A_WISP)
    middles = place[rng.choice(strands.count, count, replace=False)]
    wisp = KDTree(middles).query(place)[1]
    phase = rng.uniform(0.0, 2.0 * np.pi, count)[wisp]
    phase += rng.normal(0.0, 0.15, strands.count)
    length = swing.length * np.exp(rng.normal(0.0, 0.08, count))[wisp]
    size = swing.size * np.exp(rng.normal(0.0, 0.15, count))[wisp]
    side = np.where(rng.random(count) < 0.5, 1.0, -1.0)[wisp]
    along = along_paths(path)
    angle = phase[:, None] + (side / length)[:, None] * 2.0 * np.pi * along
    far = size[:, None] * np.clip((along - 0.02) / 0.05, 0.0, 1.0)
    if swing.beyond > 0.0:
        off = np.linalg.norm(path - MIDDLE, axis=2)
        out = np.maximum.accumulate(off, axis=1)
        far *= np.clip((out - swing.beyond) / 0.03, 0.0, 1.0)
    ahead = unit(np.gradient(path, axis=1))
    across = unit(np.cross(ahead, [0.3, 0.1, 1.0]))
    off = np.cos(angle)[..., None] * across
    if not swing.flat:
        off += np.sin(angle)[..., None] * np.cross(ahead, across)
    return Strands.from_array(path + far[..., None] * off)


def stood_on(strands: Strands) -> Strands:
    """Return Yuksel's model on ICT's head, each hair with a neighbour 1 to 2 mm away.

    The pose is the similarity by which its roots are nearest to that head.
    """
    x, y, z = np.asarray(strands.points, np.float64).T
    upright = np.column_stack([-x, z, y]) - [0.0, 38.6, -0.2]
    turn = Rotation.from_rotvec([-0.14225, -0.00688, -0.00859])
    placed = 4.08133e-3 * turn.apply(upright) + [-0.00048, 0.06443, -0.00086]
    model = placed.reshape(strands.count, -1, 3)
    # Its points stand close at the root, where it bends: between them, not at equal
    # distances.
    at = np.linspace(0.0, model.shape[1] - 1.0, KNOTS)
    hairs = make_interp_spline(np.arange(model.shape[1]), model, k=1, axis=1)(at)
    aside = np.random.default_rng(0).normal(0.0, 0.0012, (len(hairs), 1, 3))
    beside = hairs + aside * np.linspace(0.6, 1.4, KNOTS)[:, None]
    return Strands.from_array(np.concatenate([hairs, beside]))


if __name__ == "__main__":
    main()
