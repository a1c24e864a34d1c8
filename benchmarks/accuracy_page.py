"""The page of pictures: photograph, fitted and true hair side by side."""

import html
import pathlib
from collections.abc import Sequence

import numpy as np
from accuracy_run import Run, held_back_views, result_folder, view_names
from accuracy_table import COLUMNS, Group
from jaxtyping import UInt8

from hairfit.capture import load_capture
from hairfit.capture.photos import encode_picture, srgb_from_linear
from hairfit.evaluate.visibility import even_strands
from hairfit.report.drawing import draw_hair
from hairfit.report.hairstyles import read_strands
from hairfit.report.html import STYLE, table_html

SHOWN = ("00", "02", "05", "09")
"""Photographs that are shown: before the face, from both sides behind, from above."""

HEIGHT = 480
"""Of a shown picture, in pixels."""

Picture = UInt8[np.ndarray, "height width 3"]


def write_page(
    out: pathlib.Path, shown: Sequence[Run], groups: dict[str, Group], title: str
) -> None:
    """Write `index.html` and its pictures into `out`.

    Pictures are drawn only where those that are there are older than the result.

    Args:
        out: The folder of the benchmark.
        shown: One run of each group.
        groups: The figures.
        title: What was measured, and on what.
    """
    sections = []
    for run in shown:
        draw_run(run, out)
        sections.append(section(run, groups[run.group]))
    contents = "".join(
        f"<li><a href='#{run.name}'>{html.escape(run.group)}</a></li>" for run in shown
    )
    text = (
        "<!doctype html>\n<html lang='en'><head><meta charset='utf-8'>\n"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>\n"
        f"<title>Accuracy</title>\n<style>{STYLE}</style></head>\n<body>\n"
        f"<h1>Accuracy</h1><p class='soft'>{html.escape(title)}</p>"
        f"<ul>{contents}</ul>\n" + "\n".join(sections) + "\n</body></html>\n"
    )
    (out / "index.html").write_text(text, encoding="utf-8")


def shown_views(run: Run) -> list[str]:
    """Return the shown photographs that the capture has."""
    return [name for name in SHOWN if name in view_names(run.capture)]


def picture_paths(run: Run, name: str, out: pathlib.Path) -> list[pathlib.Path]:
    """Return the files of photograph, fitted and true hair."""
    folder = out / "pictures"
    own = f"{run.capture.name}-{name}"
    return [
        folder / f"{own}-photograph.jpg",
        folder / f"{run.name}-{name}.jpg",
        folder / f"{own}-truth.jpg",
    ]


def draw_run(run: Run, out: pathlib.Path) -> None:
    """Write the pictures of a run that are missing or older than what they show."""
    result = result_folder(run, out)
    sources = [run.capture / "cameras.json", result / "report.json"]
    sources.append(run.capture / "truth.npz")
    (out / "pictures").mkdir(parents=True, exist_ok=True)
    paths = [picture_paths(run, name, out) for name in shown_views(run)]
    stale = [
        any(is_older(files[k], source) for files in paths)
        for k, source in enumerate(sources)
    ]
    if not any(stale):
        return
    loaded = load_capture(run.capture, shown_views(run), longest_side=HEIGHT)
    cameras = [view.camera for view in loaded.views]
    drawn: list[list[Picture]] = [
        [np.round(255 * srgb_from_linear(v.image)).astype("u1") for v in loaded.views]
    ]
    drawn += [
        draw_hair(even_strands(read_strands(hair)), loaded.head, cameras) if old else []
        for hair, old in ((result, stale[1]), (sources[2], stale[2]))
    ]
    for k, pictures in enumerate(drawn):
        for files, picture in zip(paths, pictures, strict=False):
            files[k].write_bytes(encode_picture(picture, ".jpg"))


def is_older(file: pathlib.Path, source: pathlib.Path) -> bool:
    """Return whether a file is missing, or older than what it was made from."""
    return not file.is_file() or file.stat().st_mtime < source.stat().st_mtime


def section(run: Run, group: Group) -> str:
    """Return the part of the page on one group."""
    held = held_back_views(run)
    views = []
    for name in shown_views(run):
        files = picture_paths(run, name, pathlib.Path())
        kind = "held back" if name in held else "fitted"
        figures = "".join(
            f"<figure><img loading='lazy' src='{html.escape(file.as_posix())}' "
            f"alt='{caption} {name}'><figcaption>{caption}</figcaption></figure>"
            for file, caption in zip(
                files, ("photograph", "fitted hair", "true hair"), strict=True
            )
        )
        views.append(
            f"<section class='view'><h3>{name}<span>{kind}</span></h3>{figures}"
            "</section>"
        )
    rows = {column.title: column.cell(group) for column in COLUMNS}
    return (
        f"<h2 id='{run.name}'>{html.escape(run.group)}</h2>\n{table_html(rows)}\n"
        + "\n".join(views)
    )
