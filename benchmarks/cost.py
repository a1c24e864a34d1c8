"""What a fit costs: time and memory by quality, photographs and strands.

Run `python benchmarks/cost.py [CAPTURE] [--quality draft normal] [--views 4 8 12]
[--strands 16000 64000]`, with nothing beside it. Every fit is made by the command line
in a process of its own, with an empty cache of compiled programs. For each quality a
line is fitted to the seconds over the megapixels of all photographs, which is what
`hairfit/fit/cost.py` holds, and the growth with photographs and strands is printed: at
most 1 is linear or less.
"""

import argparse
import os
import pathlib
import tempfile
from typing import NamedTuple

import numpy as np
from accuracy_run import SUBSETS, call_hairfit
from strands import machine

from hairfit.capture import load_capture

SHARED = pathlib.Path(__file__).parents[2] / "shared" / "captures"


class Measured(NamedTuple):
    """What one fit took."""

    megapixels: float
    seconds: float
    gigabytes: float


def main() -> None:
    """Print a line for each fit, and how costs grow."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "capture", nargs="?", type=pathlib.Path, default=SHARED / "ruby"
    )
    parser.add_argument("--quality", nargs="+", default=["draft", "normal"])
    parser.add_argument("--views", nargs="+", type=int, default=[4, 8, 12])
    parser.add_argument("--strands", nargs="+", type=int, default=[16_000, 64_000])
    given = parser.parse_args()
    print(machine())
    print("| quality | photographs | megapixels | strands | s | GB |")
    print("|---|---|---|---|---|---|")
    for quality in given.quality:
        first, *more = given.strands
        found = [measure(given.capture, quality, n, first) for n in given.views]
        rest = [measure(given.capture, quality, given.views[0], n) for n in more]
        if len(found) > 1:
            area, seconds, memory = np.array(found).T
            slope, fixed = np.polyfit(area, seconds, 1)
            per, base = np.polyfit(area, memory, 1)
            growth = np.log(seconds[-1] / seconds[0]) / np.log(area[-1] / area[0])
            print(
                f"{quality}: {fixed:.0f} s and {slope:.1f} s a megapixel, "
                f"{base:.2f} GB and {per:.3f} GB a megapixel; growth with photographs "
                f"{growth:.2f}"
            )
        for strands, one in zip(more, rest, strict=True):
            growth = np.log(one.seconds / found[0].seconds) / np.log(strands / first)
            print(f"{quality}: growth with strands up to {strands} {growth:.2f}")


def measure(capture: pathlib.Path, quality: str, views: int, strands: int) -> Measured:
    """Return what a fit takes, and print it."""
    names = SUBSETS[views]
    loaded = load_capture(capture, names)
    area = sum(v.camera.width * v.camera.height for v in loaded.views) / 1e6
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_CACHE_HOME"] = folder
        words = ["fit", str(capture), "--out", f"{folder}/result", "--quality", quality]
        words += ["--views", ",".join(v.name for v in loaded.views)]
        ran = call_hairfit(*words, "--strands", str(strands))
    print(
        f"| {quality} | {len(loaded.views)} | {area:.1f} | {strands} | "
        f"{ran.seconds:.0f} | {ran.memory:.2f} |",
        flush=True,
    )
    return Measured(area, ran.seconds, ran.memory)


if __name__ == "__main__":
    main()
