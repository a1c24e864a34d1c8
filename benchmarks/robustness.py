"""How much a fit depends on its seed, and what one bad photograph costs.

Run `python benchmarks/robustness.py [CAPTURE ...] [--views 00,01,...]
[--quality normal] [--seeds 20] [--spoil 2] [--shake 3 7]`. First fits with different
seeds: the mean and the standard deviation of the unsigned F at 3 mm and 30 degrees
over all strands, and whether a number is not finite. Then fits with one view spoiled
in every way that `corruptions.py` knows: the points of F that are lost against the
clean fit of seed 0, and what the fit says of the view. Then fits with all photographs
shaken by so many pixels. F is measured on a sample of the points.
"""

import argparse
import dataclasses
import gc
import pathlib
import resource
import statistics
import tempfile
import time

import jax
import numpy as np
from corruptions import all_shaken, corruptions

from hairfit.capture import load_capture
from hairfit.capture.capture import Capture, require_for_fit
from hairfit.cli import cache_folder
from hairfit.evaluate.match import score
from hairfit.fit import FitConfig, FitResult, fit_capture
from hairfit.io.strands import load_strands
from hairfit.types import Strands

SHARED = pathlib.Path(__file__).parents[2] / "shared" / "captures"
# Views of the reference captures once around the head.
RING = "00,01,02,03,04,05,06,07"
SAMPLE = 100_000
# What a checkpoint keeps that depends on the seed; photographs are looked at once.
SEEDED = ("grown.npz", "cylinders.npz", "tree.hairtree")


def main() -> None:
    """Print a line for each fit, and a summary."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("captures", nargs="*", type=pathlib.Path)
    parser.add_argument("--views", default=RING)
    parser.add_argument("--quality", default="normal")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--spoil", type=int, default=2, help="which view; -1 for none")
    parser.add_argument("--shake", type=float, nargs="*", default=[])
    given = parser.parse_args()
    found = given.captures or [SHARED / name for name in ("ruby", "ponytail")]
    for folder in found:
        capture = load_capture(folder, given.views)
        truth = load_strands(folder / "truth.npz")
        name = f"{folder.name}, {len(capture.views)} views, {given.quality}"
        config = FitConfig(quality=given.quality)
        clean = try_seeds(name, capture, truth, config, given.seeds)
        if given.spoil >= 0:
            try_corruptions(name, capture, truth, config, given.spoil, clean)
        for pixels in given.shake:
            try_shaken(name, capture, truth, config, pixels, clean)


def try_seeds(
    name: str, capture: Capture, truth: Strands, config: FitConfig, count: int
) -> float:
    """Return F of the first seed; print those of all."""
    all_f = []
    with tempfile.TemporaryDirectory() as folder:
        kept = pathlib.Path(folder)
        for seed in range(max(count, 1)):
            seeded = dataclasses.replace(config, seed=seed)
            fitted, taken = timed_fit(capture, seeded, kept)
            for stage in SEEDED:
                (kept / stage).unlink()
            all_f.append(f_of(fitted.strands, truth))
            report(f"{name}, seed {seed}", all_f[-1], fitted, taken)
    if len(all_f) > 1:
        print(
            f"{name}, {len(all_f)} seeds: F {statistics.mean(all_f):.1f}, standard "
            f"deviation {statistics.stdev(all_f):.2f}, from {min(all_f):.1f} to "
            f"{max(all_f):.1f}",
            flush=True,
        )
    return all_f[0]


def report(name: str, f: float, fitted: FitResult, taken: float) -> None:
    """Print a line for one fit."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    finite = bool(np.isfinite(fitted.strands.points).all())
    print(
        f"{name}: F {f:.1f}, {taken:.0f} s, {peak:.1f} GB in this process so far"
        f"{'' if finite else ', NOT FINITE'}",
        flush=True,
    )


def try_corruptions(
    name: str,
    capture: Capture,
    truth: Strands,
    config: FitConfig,
    which: int,
    clean: float,
) -> None:
    """Print what is lost when a view is spoiled, and what the fit says of it."""
    head = require_for_fit(capture)
    views = list(capture.views)
    other = views[(which + 2) % len(views)]
    print("| " + name + " | F | lost | said |\n|---|---|---|---|")
    for what, (kind, spoil) in corruptions(other, head).items():
        bad = [*views]
        bad[which] = spoil(views[which])
        spoiled = dataclasses.replace(capture, views=tuple(bad))
        fitted, _ = timed_fit(spoiled, config)
        f = f_of(fitted.strands, truth)
        said = [f"{d.view} {d.kind}" for d in fitted.doubts]
        right = f"{views[which].name} {kind}" in said
        print(
            f"| {what} | {f:.1f} | {clean - f:.1f} | "
            f"{'named' if right else 'MISSED'}: {', '.join(said) or 'nothing'} |",
            flush=True,
        )


def try_shaken(
    name: str,
    capture: Capture,
    truth: Strands,
    config: FitConfig,
    pixels: float,
    clean: float,
) -> None:
    """Print what is lost when all views are shaken, and how many the fit names."""
    bad = tuple(all_shaken(capture.views, pixels))
    fitted, _ = timed_fit(dataclasses.replace(capture, views=bad), config)
    f, named = f_of(fitted.strands, truth), len(fitted.doubts)
    print(
        f"{name}, all shaken by {pixels:g} pixels: F {f:.1f}, {clean - f:.1f} lost, "
        f"{named} named",
        flush=True,
    )


def timed_fit(
    capture: Capture, config: FitConfig, kept: pathlib.Path | None = None
) -> tuple[FitResult, float]:
    """Return a fit, and the seconds that it took, less those of stages kept."""
    start = time.monotonic()
    fitted = fit_capture(capture, config, checkpoint=kept)
    taken = time.monotonic() - start
    # Programs of many fits would fill the memory; they are kept on the disk.
    jax.clear_caches()
    gc.collect()
    return fitted, taken


def f_of(strands: Strands, truth: Strands) -> float:
    """Return the unsigned F at 3 mm and 30 degrees, in points."""
    return 100 * score(strands, truth, ((3e-3, 30.0),), sample=SAMPLE)[0].unsigned.f


if __name__ == "__main__":
    jax.config.update("jax_compilation_cache_dir", str(cache_folder()))
    main()
