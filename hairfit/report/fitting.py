"""A fit from capture to result folder: progress, checkpoint, files."""

import dataclasses
import os
from pathlib import Path
from typing import Any

import numpy as np

from ..capture.capture import Capture
from ..capture.scalp_file import save_scalp
from ..fit import FitConfig, FitResult, fit_capture
from ..fit.appearance import Appearance
from ..fit.cost import affordable, expected_cost, free_gigabytes
from ..fit.suspects import Doubt
from ..fit.unfaced import unfaced_side
from ..host import one_blas_thread
from ..io.strands import save_strands
from ..io.tree import save_tree
from .pictures import hexadecimal
from .progress import about, say, shown_progress
from .result import (
    FORMAT,
    close_checkpoint,
    open_checkpoint,
    whole_folder,
    write_report,
)
from .show import show_result

# Share of the time that the fit itself takes; the rest are pictures.
FIT_SHARE = 0.85


@one_blas_thread()
def fit_to_folder(
    capture: Capture, config: FitConfig, out: Path, *, quiet: bool = False
) -> dict[str, Any]:
    """Fit a capture, write the result folder, and return what `report.json` says.

    Stages that are done are kept beside `out`, and taken up by the next call, until
    the result is written.
    """
    # What is kept does not depend on when to stop.
    quality = affordable(capture.views, config.quality, config.time_limit)
    kept = dataclasses.replace(config, quality=quality, time_limit=None)
    checkpoint = open_checkpoint(out, capture, kept)
    if checkpoint.resuming:
        say(f"resuming the fit that '{checkpoint.folder}' holds.", quiet=quiet)
    done = False
    try:
        with shown_progress(quiet=quiet) as progress:
            fitted = fit_capture(
                capture,
                config,
                checkpoint=checkpoint.folder,
                progress=lambda stage, share: progress(stage, share * FIT_SHARE),
            )
            progress("drawing the report", FIT_SHARE)
            with whole_folder(out) as folder:
                report = write_result(folder, out, capture, fitted, config)
            progress("done", 1.0)
        done = True
    finally:
        close_checkpoint(checkpoint, keep=not done)
    return report


def before_fit(capture: Capture, config: FitConfig) -> list[str]:
    """Return what to say before a fit starts: of time, memory and what nobody sees."""
    limit = config.time_limit
    quality = affordable(capture.views, config.quality, limit)
    cost = expected_cost(capture.views, quality)
    said = [
        f"{len(capture.views)} photographs at quality {quality}: "
        f"{about(cost.seconds)} and {cost.gigabytes:.1f} GB on two cores."
    ]
    if quality != config.quality:
        asked = expected_cost(capture.views, config.quality).seconds
        said[0] = f"{config.quality} would take {about(asked)}; " + said[0]
    if limit is not None and cost.seconds > limit:
        said.append(
            "that is longer than --time-limit: what can be left out of the refinement "
            "is; fewer photographs, or smaller ones, are faster."
        )
    head = capture.head
    unfaced = None if head is None else unfaced_side(capture.views, head)
    if unfaced is not None:
        said.append(
            f"no photograph faces {unfaced}: hair there will go on as it is on both "
            "sides; photographs from there would show it."
        )
    free = free_gigabytes()
    if free is not None and free < cost.gigabytes:
        said.append(
            f"only {free:.1f} GB of memory are free; close other programs, or use "
            "fewer or smaller photographs."
        )
    return said


def write_result(
    folder: Path, out: Path, capture: Capture, fitted: FitResult, config: FitConfig
) -> dict[str, Any]:
    """Write all files of a result, and return what `report.json` says.

    Args:
        folder: Where to write.
        out: Where the folder will be moved; links to the capture start there.
        capture: What was fitted.
        fitted: What came out.
        config: The settings.
    """
    save_tree(folder / "tree.hairtree", fitted.tree)
    save_strands(folder / "strands.hair", fitted.strands)
    save_scalp(folder / "scalp.json", fitted.tree.scalp)
    photographs = show_result(folder, capture, fitted)
    strand_counts = np.diff(np.asarray(fitted.strands.offsets))
    report = {
        "format": FORMAT,
        "version": 1,
        "capture": os.path.relpath(capture.folder.resolve(), out.resolve()),
        "views": [view.name for view in capture.views],
        "settings": {
            "quality": config.quality,
            "seed": config.seed,
            "strands": config.strands,
            **limited(config),
        },
        "clusters": len(fitted.tree.parent),
        "strands": fitted.strands.count,
        "points": int(strand_counts.sum()),
        "suspects": [in_report(doubt) for doubt in fitted.doubts],
        "looks": None if fitted.looks is None else looks_in_report(fitted.looks),
        "figures": fitted.figures,
        "photographs": photographs,
    }
    write_report(folder, report)
    return report


def limited(config: FitConfig) -> dict[str, float]:
    """Return the limit of a fit that had one, as a setting."""
    limit = config.time_limit
    return {} if limit is None else {"time_limit": limit}


def looks_in_report(looks: Appearance) -> dict[str, Any]:
    """Return what `report.json` says of the hair's looks and the light on it."""
    return {
        "colour": hexadecimal(np.array(looks.colour)),
        "linear_rgb": looks.colour,
        "specular": looks.specular,
        "shininess": looks.shininess,
        "skin": looks.skin,
        "lights": [
            {"towards": way, "strength": strength}
            for way, strength in zip(looks.to_light, looks.strength, strict=True)
        ],
        "sky": looks.sky,
        "exposure": looks.exposure,
        "relative_error": looks.error,
        "total_width": looks.total_width,
    }


def in_report(doubt: Doubt) -> dict[str, Any]:
    """Return what `report.json` says of a doubtful photograph."""
    return {
        "view": doubt.view,
        "kind": doubt.kind,
        "strength": doubt.strength,
        "unit": doubt.unit,
        "remedy": doubt.remedy,
        "sentence": doubt.sentence,
    }
