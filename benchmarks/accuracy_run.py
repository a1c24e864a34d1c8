"""One run of the accuracy benchmark: a fit by the command line, and its figures."""

import dataclasses
import functools
import hashlib
import json
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

import hairfit
from hairfit.capture import load_capture
from hairfit.evaluate.coverage import overlaps
from hairfit.evaluate.photographs import compare_with_photograph
from hairfit.evaluate.visibility import even_strands, look
from hairfit.io.atomic import atomic_path
from hairfit.report.hairstyles import read_strands

PACKAGE = pathlib.Path(hairfit.__file__).parent
# -P: not what happens to be in the working folder, but the package that is measured.
COMMAND = (
    sys.executable,
    "-P",
    "-c",
    "from hairfit.cli import main; raise SystemExit(main())",
)
SUBSETS: dict[int, tuple[str, ...] | None] = {
    3: ("00", "03", "05"),
    4: ("00", "02", "04", "06"),
    8: ("00", "01", "02", "03", "04", "05", "06", "07"),
    12: None,
}
"""The photographs that are fitted, by their number; None for all."""


class RunFailed(Exception):
    """A command of hairfit did not end well."""


class Ran(NamedTuple):
    """What a command printed as JSON, its seconds and its peak memory in GB."""

    found: dict[str, Any]
    seconds: float
    memory: float


@dataclasses.dataclass(frozen=True)
class Run:
    """One fit of a capture.

    Attributes:
        capture: Folder of the capture.
        views: Number of photographs, one of `SUBSETS`.
        seed: Seed of the fit.
        quality: Quality of the fit.
    """

    capture: pathlib.Path
    views: int
    seed: int
    quality: str

    @property
    def group(self) -> str:
        """What runs that differ in their seeds alone have in common."""
        return f"{self.capture.name}, {self.views} views, {self.quality}"

    @property
    def name(self) -> str:
        """The name of the run's files."""
        return f"{self.capture.name}-{self.views}-{self.quality}-{self.seed}"


def view_names(capture: pathlib.Path) -> list[str]:
    """Return the names of all photographs of a capture."""
    entries = json.loads((capture / "cameras.json").read_text(encoding="utf-8"))
    return [pathlib.PurePath(one["name"]).stem for one in entries["views"]]


def fitted_views(run: Run) -> list[str]:
    """Return the names of the photographs that are fitted.

    Raises:
        RunFailed: If the capture does not have them all.
    """
    every, chosen = view_names(run.capture), SUBSETS[run.views]
    missing = sorted(set(chosen or ()) - set(every))
    if missing:
        raise RunFailed(
            f"'{run.capture}' has no photographs {', '.join(missing)}, which belong to "
            f"{run.views} views; leave out --views {run.views}."
        )
    return every if chosen is None else list(chosen)


def held_back_views(run: Run) -> list[str]:
    """Return the names of the photographs that the fit does not see."""
    fitted = set(fitted_views(run))
    return [name for name in view_names(run.capture) if name not in fitted]


def environment() -> dict[str, str]:
    """Return the environment in which commands find the package that is measured."""
    others = os.environ.get("PYTHONPATH")
    path = [str(PACKAGE.parent), *([others] if others else [])]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(path)}


def call_hairfit(*words: str) -> Ran:
    """Run a command of hairfit in a process of its own.

    Raises:
        RunFailed: If it fails.
    """
    start = time.monotonic()
    with tempfile.TemporaryFile("w+") as output:
        process = subprocess.Popen(
            [*COMMAND, *words, "--json", "--quiet"],
            stdout=output,
            env=environment(),
        )
        _, status, usage = os.wait4(process.pid, 0)
        seconds = time.monotonic() - start
        process.returncode = os.waitstatus_to_exitcode(status)
        if status:
            raise RunFailed(f"`hairfit {' '.join(words)}` failed.")
        output.seek(0)
        found = json.loads(output.read().strip().splitlines()[-1])
    return Ran(found, seconds, usage.ru_maxrss / 1e6)


@functools.cache
def code_digest() -> str:
    """Return a checksum of the package's code."""
    digest = hashlib.sha256()
    for path in sorted(PACKAGE.rglob("*")):
        if path.suffix in (".py", ".glsl"):
            digest.update(str(path.relative_to(PACKAGE)).encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def do_run(run: Run, out: pathlib.Path) -> dict[str, float]:
    """Return the figures of a run, fitted now unless `out` has them of the same code.

    Raises:
        RunFailed: If it fails.
    """
    path = out / "runs" / f"{run.name}.json"
    code = code_digest()
    if path.is_file():
        kept = json.loads(path.read_text(encoding="utf-8"))
        if kept["code"] == code and kept["capture"] == str(run.capture.resolve()):
            return with_share_error(kept["figures"])
    result = result_folder(run, out)
    views = ",".join(fitted_views(run))
    # A fit that is taken up where it was stopped would have only the rest of its time.
    for folder in (result, result.with_name(result.name + ".partial")):
        shutil.rmtree(folder, ignore_errors=True)
    fit = call_hairfit(
        *("fit", str(run.capture), "--out", str(result), "--views", views),
        *("--quality", run.quality, "--seed", str(run.seed)),
    )
    found = call_hairfit("evaluate", str(result), str(run.capture)).found
    width = found["strand_width_m"]
    held = photograph_errors(result, run.capture, held_back_views(run), width)
    figures = {
        **flat_figures({k: v for k, v in found.items() if k != "photographs"}),
        **photograph_means("fitted", found["photographs"]),
        **photograph_means("held_back", held),
        "seconds": fit.seconds,
        "memory_gb": fit.memory,
    }
    text = {
        "code": code,
        "capture": str(run.capture.resolve()),
        "group": run.group,
        "seed": run.seed,
        "figures": figures,
        "photographs": found["photographs"],
        "held_back": held,
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_path(path) as partial:
        partial.write_text(json.dumps(text, indent=1) + "\n", encoding="utf-8")
    return with_share_error(figures)


def with_share_error(figures: dict[str, float]) -> dict[str, float]:
    """Return figures with how many strands curl too many, as a share."""
    shares = [figures.get(f"curls.{key}") for key in ("share", "true_share")]
    if shares[0] is None or shares[1] is None:
        return figures
    return {**figures, "curls.share_error": shares[0] - shares[1]}


def result_folder(run: Run, out: pathlib.Path) -> pathlib.Path:
    """Return where the result of a run is."""
    return out / "results" / run.name


def photograph_errors(
    result: pathlib.Path, capture: pathlib.Path, names: Sequence[str], width: float
) -> dict[str, dict[str, float | None]]:
    """Return how a result fits photographs that it was not made from.

    Args:
        result: The result.
        capture: The capture.
        names: The photographs.
        width: Of a strand, in metres, as it covers those best that it was made from.
    """
    if not names:
        return {}
    loaded = load_capture(capture, names)
    drawn = even_strands(read_strands(result))
    errors = {}
    for sight in look(loaded.head, loaded.views):
        covered = overlaps(drawn, sight, np.array([width]))
        found = compare_with_photograph(drawn, sight)
        errors[found.name] = found.to_dict() | {"covered_iou": float(covered[0])}
    return errors


def photograph_means(
    title: str, photographs: dict[str, dict[str, float | None]]
) -> dict[str, float]:
    """Return the means over photographs, as far as they are known."""
    means = {}
    for key in ("mean_angle_deg", "median_angle_deg", "hair_iou", "covered_iou"):
        known = [x for one in photographs.values() if (x := one[key]) is not None]
        if known:
            means[f"{title}.{key}"] = float(np.mean(known))
    return means


def flat_figures(nested: dict[str, Any], before: str = "") -> dict[str, float]:
    """Return nested figures in one level, such as `all.2mm_20deg.unsigned.f`.

    What is unknown is left out.
    """
    flat: dict[str, float] = {}
    for key, value in nested.items():
        if isinstance(value, dict):
            flat |= flat_figures(value, f"{before}{key}.")
        elif value is not None:
            flat[f"{before}{key}"] = float(value)
    return flat
