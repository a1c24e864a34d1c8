"""Whether figures became worse than those of a baseline, beyond tolerances."""

import json
import math
import pathlib
from collections.abc import Iterator
from typing import Any

from accuracy_table import Figures, gather

BASELINE = pathlib.Path(__file__).with_name("accuracy_baseline.json")
HOW = ("fall", "rise", "away", "factor")

Runs = dict[str, dict[int, Figures]]
"""Figures by group, such as `ruby, 8 views, normal`, and by seed."""

TOLERANCES: dict[str, dict[str, float]] = {
    "all.2mm_20deg.unsigned.f": {"fall": 0.01},
    "all.3mm_30deg.unsigned.f": {"fall": 0.01},
    "all.4mm_40deg.unsigned.f": {"fall": 0.01},
    "all.3mm_30deg.signed.f": {"fall": 0.015},
    "visible.3mm_30deg.unsigned.f": {"fall": 0.015},
    "interior.3mm_30deg.unsigned.f": {"fall": 0.015},
    "consistency.3mm_30deg": {"fall": 0.02},
    "shape.median_length_relative": {"away": 0.05},
    "curls.share_error": {"away": 0.05},
    "curls.median_radius_relative": {"away": 0.10},
    "curls.median_pitch_relative": {"away": 0.10},
    "head.points_deeper_than_1mm": {"rise": 5.0},
    "fitted.median_angle_deg": {"rise": 0.5},
    "fitted.hair_iou": {"fall": 0.01},
    "fitted.covered_iou": {"fall": 0.01},
    "held_back.median_angle_deg": {"rise": 1.0},
    "held_back.hair_iou": {"fall": 0.015},
    "held_back.covered_iou": {"fall": 0.015},
    "seconds": {"factor": 1.3},
    "memory_gb": {"factor": 1.15},
}
"""What each figure may change by, the mean over seeds.

`fall` and `rise`: by so much; `away`: so much farther from 0; `factor`: to so many
times what it was. A baseline carries its own, which may be edited there.
"""


TURNS = ("curls.median_radius_relative", "curls.median_pitch_relative")
# Of hair of which fewer strands curl these are means over strands that curl by chance.
CURLS = 0.2


def read_baseline(path: pathlib.Path) -> dict[str, Any]:
    """Return a baseline.

    Raises:
        SystemExit: If it is not there, or a tolerance is none of `HOW`.
    """
    if not path.is_file():
        raise SystemExit(f"no baseline '{path}'; make one with --write-baseline.")
    baseline = json.loads(path.read_text(encoding="utf-8"))
    for key, tolerance in baseline["tolerances"].items():
        if len(tolerance) != 1 or next(iter(tolerance)) not in HOW:
            raise SystemExit(
                f"the tolerance of {key} in '{path}' must be one of "
                f"{', '.join(HOW)}, got {tolerance}; mend it."
            )
    return baseline


def write_baseline(path: pathlib.Path, runs: Runs, machine: str) -> None:
    """Write a baseline.

    Tolerances that stand there already are kept, and seconds where the same kind of
    machine took fewer: what else it does can only make a run slower. Whoever means to
    allow more time deletes the file first.
    """
    tolerances, fewest = TOLERANCES, {}
    if path.is_file():
        before = read_baseline(path)
        tolerances = before["tolerances"]
        fewest = baseline_runs(before) if before["machine"] == machine else {}
    lines = []
    for group, seeds in runs.items():
        for seed, figures in seeds.items():
            kept = {k: float(f"{figures[k]:.6g}") for k in judged(figures, tolerances)}
            took = fewest.get(group, {}).get(seed, {}).get("seconds")
            if took is not None and "seconds" in kept:
                kept["seconds"] = min(kept["seconds"], took)
            one = json.dumps({"group": group, "seed": seed, "figures": kept})
            lines.append("  " + one)
    allowed = json.dumps(tolerances, indent=1).replace("\n", "\n ")
    path.write_text(
        f'{{\n "machine": {json.dumps(machine)},\n "tolerances": {allowed},\n'
        ' "runs": [\n' + ",\n".join(lines) + "\n ]\n}\n",
        encoding="utf-8",
    )


def judged(figures: Figures, tolerances: dict[str, dict[str, float]]) -> list[str]:
    """Return which figures of a fit say how good it is: no turns of straight hair."""
    straight = figures.get("curls.true_share", 1.0) < CURLS
    return [k for k in figures if k in tolerances and not (straight and k in TURNS)]


def baseline_runs(baseline: dict[str, Any]) -> Runs:
    """Return the runs of a baseline."""
    runs: Runs = {}
    for one in baseline["runs"]:
        runs.setdefault(one["group"], {})[one["seed"]] = one["figures"]
    return runs


def complaints(runs: Runs, baseline: dict[str, Any]) -> list[str]:
    """Return a sentence for each figure that became worse; none if all is well.

    Of each group the seeds that the baseline has, too, are compared. That nothing can
    be compared is a complaint.
    """
    known = baseline_runs(baseline)
    found, compared = [], 0
    for group, seeds in runs.items():
        common = sorted(set(seeds) & set(known.get(group, {})))
        if common:
            compared += 1
            now = gather([seeds[seed] for seed in common])
            was = gather([known[group][seed] for seed in common])
            found += worse(
                group,
                {key: one.mean for key, one in now.items()},
                {key: one.mean for key, one in was.items()},
                baseline["tolerances"],
            )
    if runs and not compared:
        found.append(
            "The baseline has none of these captures, views, qualities and seeds; run "
            "some that it has, or write it anew with --write-baseline."
        )
    return found


def not_compared(runs: Runs, baseline: dict[str, Any]) -> list[str]:
    """Return the groups of which the baseline has no seed that was run."""
    known = baseline_runs(baseline)
    return [name for name in runs if not set(runs[name]) & set(known.get(name, {}))]


def worse(
    group: str, now: Figures, was: Figures, tolerances: dict[str, dict[str, float]]
) -> Iterator[str]:
    """Yield a sentence for each figure of a group that became worse."""
    for key, tolerance in tolerances.items():
        if key not in was:
            continue
        if key not in now:
            yield f"{group}: {key} was {was[key]:.4g} and is unknown now."
            continue
        how, by = next(iter(tolerance.items()))
        if excess(now[key], was[key], how) > by:
            yield (
                f"{group}: {key} went from {was[key]:.4g} to {now[key]:.4g}; "
                f"{allowance(how, by)}."
            )


def excess(now: float, was: float, how: str) -> float:
    """Return how much worse a figure is, in the terms of its tolerance."""
    if math.isnan(now):
        return math.inf
    if how == "fall":
        return was - now
    if how == "rise":
        return now - was
    if how == "away":
        return abs(now) - abs(was)
    return now / was if was > 0.0 else (math.inf if now > 0.0 else 1.0)


def allowance(how: str, by: float) -> str:
    """Return what a tolerance allows, in words."""
    return {
        "fall": f"it may fall by {by:g}",
        "rise": f"it may rise by {by:g}",
        "away": f"it may go {by:g} farther from 0",
        "factor": f"it may grow to {by:g} times that",
    }[how]
