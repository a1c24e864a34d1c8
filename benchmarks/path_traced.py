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

import numpy as np
from jaxtyping import Float
from scenes import SCENES, make_apart
from scipy.spatial.transform import Rotation

from hairfit.io.strands import load_strands
from hairfit.types import Strands

SHARED = pathlib.Path(__file__).parents[2] / "shared"
HEAD = SHARED / "files" / "heads" / "ict_neutral.obj"
ROUND = ("--views", "8")
FRONT = (
    "--views",
    "5",
    "--arc",
    "200",
    "--start",
    "-80",
    "--light",
    "-0.9",
    "1",
    "1.4",
)


class Recipe(NamedTuple):
    """What is photographed, and how.

    Attributes:
        groom: A reference capture, a drawn scene, or `straight` for Cem Yuksel's model
            on the head of ICT's face kit.
        options: Of the path tracer.
    """

    groom: str
    options: tuple[str, ...]


RECIPES = {
    "black-straight": Recipe("straight.hair", (*ROUND, "--colour", "black")),
    "black-ruby": Recipe("ruby", (*ROUND, "--colour", "black")),
    "traced-curls": Recipe("curly", (*ROUND, "--colour", "brown")),
    "traced-afro": Recipe("afro", (*ROUND, "--colour", "black")),
    "ponytail-from-the-front": Recipe("ponytail", (*FRONT, "--colour", "blonde")),
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
        groom, head = find_groom(recipe.groom, given.out, given.scenes or given.out)
        tool = str(SHARED / "tools" / "photograph.py")
        words = [sys.executable, tool, str(groom), str(head), str(given.out / name)]
        subprocess.run([*words, *recipe.options, "--spp", "32"], check=True)


def find_groom(
    groom: str, out: pathlib.Path, scenes: pathlib.Path
) -> tuple[pathlib.Path, pathlib.Path]:
    """Return the files of a groom and of its head, which are made if need be."""
    if groom.endswith(".hair"):
        strands, head = (
            stood_on(load_strands(SHARED / "files" / groom)),
            out / "head.obj",
        )
        write_metres(head)
        path = out / "straight.npz"
        np.savez(path, points=strands.points, offsets=strands.offsets)
        return path, head
    folder = (
        make_apart(groom, scenes) if groom in SCENES else SHARED / "captures" / groom
    )
    return folder / "truth.npz", folder / "head.obj"


def stood_on(strands: Strands) -> Strands:
    """Return Yuksel's model on ICT's head, each hair with a neighbour 1 to 2 mm away.

    The pose is the similarity by which its roots are nearest to that head.
    """
    x, y, z = np.asarray(strands.points, np.float64).T
    upright = np.column_stack([-x, z, y]) - [0.0, 38.6, -0.2]
    turn = Rotation.from_rotvec([-0.14225, -0.00688, -0.00859])
    placed = 4.08133e-3 * turn.apply(upright) + [-0.00048, 0.06443, -0.00086]
    hairs = placed.reshape(len(strands.offsets) - 1, -1, 3)
    knots = hairs.shape[1]
    aside = np.random.default_rng(0).normal(0.0, 0.0012, (len(hairs), 1, 3))
    beside = hairs + aside * np.linspace(0.6, 1.4, knots)[None, :, None]
    every = finer(np.concatenate([hairs, beside]), 2 * knots)
    offsets = np.arange(len(every) + 1, dtype=np.int64) * every.shape[1]
    return Strands(every.reshape(-1, 3).astype(np.float32), offsets)


def finer(
    hairs: Float[np.ndarray, "hairs knots 3"], count: int
) -> Float[np.ndarray, "hairs count 3"]:
    """Return hairs with more points, on the straight lines between theirs."""
    at = np.linspace(0.0, hairs.shape[1] - 1.0, count)
    low = np.minimum(at.astype(int), hairs.shape[1] - 2)
    share = (at - low)[None, :, None]
    return hairs[:, low] * (1.0 - share) + hairs[:, low + 1] * share


def write_metres(path: pathlib.Path) -> None:
    """Write ICT's head, which is in centimetres, in metres."""
    with HEAD.open(encoding="utf-8") as lines, path.open("w", encoding="utf-8") as out:
        for line in lines:
            kind, *rest = line.split() or [""]
            if kind == "v":
                out.write("v {} {} {}\n".format(*(0.01 * float(x) for x in rest[:3])))
            elif kind == "f":
                out.write("f " + " ".join(w.split("/")[0] for w in rest) + "\n")


if __name__ == "__main__":
    main()
