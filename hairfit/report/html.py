"""`report.html`: one file that shows a result, also without a network."""

import base64
import dataclasses
import html
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import UInt8

from ..capture.photos import encode_picture
from .certainty import LEGEND

# Pictures are reduced to the first height at which all fit into the report's size.
HEIGHTS = (480, 360, 240, 160)
MOST_BYTES = 4_200_000  # of pictures; base64 makes 4 bytes of 3, 6 MB at most in all

STYLE = """
:root { color-scheme: light dark; --line: #8884; --soft: #8889; }
body { font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 76rem;
  padding: 0 1rem; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.15rem; margin-top: 2.5rem; }
p.soft, figcaption { color: var(--soft); font-size: .85rem; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { text-align: left; padding: .15rem 1.2rem .15rem 0;
  border-bottom: 1px solid var(--line); }
td { text-align: right; }
section.view { display: grid; grid-template-columns: repeat(4, 1fr); gap: .8rem;
  margin-top: 1.5rem; }
section.view h3 { grid-column: 1 / -1; margin: 0; font-size: 1rem; }
section.view h3 span { font-weight: normal; color: var(--soft); margin-left: 1rem; }
figure { margin: 0; } img { width: 100%; border-radius: 4px; display: block; }
section.sides { display: grid; grid-template-columns: repeat(4, 1fr); gap: .8rem; }
#turntable { max-width: 26rem; } #turntable img { display: none; }
#turntable img.shown { display: block; } #turntable input { width: 100%; }
"""

SCRIPT = """
const slider = document.querySelector('#turntable input');
const frames = document.querySelectorAll('#turntable img');
if (slider) slider.addEventListener('input', () => frames.forEach(
  (frame, k) => frame.classList.toggle('shown', k === Number(slider.value))));
"""


@dataclasses.dataclass(frozen=True)
class ViewPage:
    """What a report shows of one photograph; pictures of one size.

    Attributes:
        name: The photograph's name.
        photo: The photograph.
        orientation: Its orientation map.
        overlay: The recovered strands over it.
        again: The photograph drawn again from what was recovered.
        figures: Numbers by what they are, with units, as text.
    """

    name: str
    photo: UInt8[np.ndarray, "height width 3"]
    orientation: UInt8[np.ndarray, "height width 3"]
    overlay: UInt8[np.ndarray, "height width 3"]
    figures: dict[str, str]
    again: UInt8[np.ndarray, "_height _width 3"] | None = None

    @property
    def pictures(self) -> dict[str, UInt8[np.ndarray, "_height _width 3"]]:
        """All of its pictures by what they are."""
        found = {
            "photograph": self.photo,
            "orientation": self.orientation,
            "recovered strands": self.overlay,
        }
        return found if self.again is None else {**found, "drawn again": self.again}


def report_html(
    title: str,
    pages: Sequence[ViewPage],
    figures: dict[str, Any],
    turntable: Sequence[UInt8[np.ndarray, "height width 3"]],
    warnings: Sequence[str] = (),
    certainty: Sequence[UInt8[np.ndarray, "height width 3"]] = (),
) -> str:
    """Return the whole report as one HTML text without any outer link.

    Args:
        title: What was fitted.
        pages: The photographs.
        figures: Figures over all; nested ones are shown as `outer / inner`.
        turntable: Pictures of the hair from all around, evenly spread.
        warnings: Sentences on photographs that contradict the others.
        certainty: Pictures of the hair coloured by how sure the fit is of it.
    """
    encoded = encode_all(pages, turntable, certainty)
    body = [
        f"<h1>{html.escape(title)}</h1>",
        warnings_html(warnings),
        turntable_html(encoded.turntable),
        certainty_html(encoded.certainty),
        "<h2>Figures</h2>",
        table_html(flat(figures)),
        "<h2>Photographs</h2>",
        "<p class='soft'>Left the photograph, then what it says about the direction of "
        "the hair (hue is angle, bright is certain), then the recovered strands "
        "over it in the same colours, and the photograph drawn again from hair, colour "
        "and light as they were recovered.</p>",
        *(
            view_html(page, pictures)
            for page, pictures in zip(pages, encoded.views, strict=True)
        ),
    ]
    return (
        "<!doctype html>\n<html lang='en'><head><meta charset='utf-8'>\n"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>\n"
        f"<title>{html.escape(title)}</title>\n<style>{STYLE}</style></head>\n<body>\n"
        + "\n".join(body)
        + f"\n<script>{SCRIPT}</script>\n</body></html>\n"
    )


@dataclasses.dataclass(frozen=True)
class Encoded:
    """All pictures of a report as `data:` links: some a view, and those of all."""

    views: list[list[str]]
    turntable: list[str]
    certainty: list[str]


def encode_all(
    pages: Sequence[ViewPage],
    turntable: Sequence[UInt8[np.ndarray, "height width 3"]],
    certainty: Sequence[UInt8[np.ndarray, "height width 3"]],
) -> Encoded:
    """Return the pictures as large as fits into the report's size."""
    pictures = [p for page in pages for p in page.pictures.values()]
    files: list[bytes] = []
    for height in HEIGHTS:
        files = [
            encode_picture(picture, ".jpg", height=height)
            for picture in (*pictures, *turntable, *certainty)
        ]
        if sum(map(len, files)) <= MOST_BYTES:
            break
    links = [
        "data:image/jpeg;base64," + base64.b64encode(file).decode() for file in files
    ]
    rest, views = links, []
    for page in pages:
        count = len(page.pictures)
        views.append(rest[:count])
        rest = rest[count:]
    return Encoded(views, rest[: len(turntable)], rest[len(turntable) :])


def view_html(page: ViewPage, pictures: Sequence[str]) -> str:
    """Return the part on one photograph."""
    figures = ", ".join(f"{key} {value}" for key, value in page.figures.items())
    name = html.escape(page.name)
    shown = "".join(
        f"<figure><img src='{link}' alt='{caption} {name}'>"
        f"<figcaption>{caption}</figcaption></figure>"
        for caption, link in zip(page.pictures, pictures, strict=True)
    )
    heading = f"<h3>{name}<span>{html.escape(figures)}</span></h3>"
    return f"<section class='view'>{heading}{shown}</section>"


def turntable_html(links: Sequence[str]) -> str:
    """Return the turntable: one picture shown, chosen by a slider."""
    if not links:
        return ""
    frames = "".join(
        f"<img src='{link}' alt='from {round(360 * k / len(links))} degrees'"
        f"{' class=shown' if k == 0 else ''}>"
        for k, link in enumerate(links)
    )
    return (
        f"<div id='turntable'>{frames}<input type='range' min='0' "
        f"max='{len(links) - 1}' value='0' aria-label='turn'></div>"
    )


def certainty_html(links: Sequence[str]) -> str:
    """Return the pictures of how sure the fit is, with what their colours mean."""
    if not links:
        return ""
    shown = "".join(f"<img src='{link}' alt='how sure the fit is'>" for link in links)
    return (
        f"<h2>How sure the fit is</h2><p class='soft'>{html.escape(LEGEND)}</p>"
        f"<section class='sides'>{shown}</section>"
    )


def warnings_html(warnings: Sequence[str]) -> str:
    """Return sentences that the user should read first."""
    if not warnings:
        return ""
    lines = "".join(
        f"<li>{html.escape(text[0].upper() + text[1:])}</li>" for text in warnings
    )
    return f"<h2>Doubtful photographs</h2><ul id='suspects'>{lines}</ul>"


def table_html(rows: dict[str, str]) -> str:
    """Return a table of names and values."""
    lines = "".join(
        f"<tr><th>{html.escape(key)}</th><td>{html.escape(value)}</td></tr>"
        for key, value in rows.items()
    )
    return f"<table>{lines}</table>"


def flat(figures: dict[str, Any], before: str = "") -> dict[str, str]:
    """Return nested figures in one level, as text."""
    rows: dict[str, str] = {}
    for key, value in figures.items():
        name = f"{before}{key}".replace("_", " ")
        if isinstance(value, dict):
            rows |= flat(value, f"{name} / ")
        elif isinstance(value, float):
            rows[name] = f"{value:.4g}"
        elif isinstance(value, list | tuple):
            rows[name] = ", ".join(
                f"{item:.4g}" if isinstance(item, float) else str(item)
                for item in value
            )
        else:
            rows[name] = "unknown" if value is None else str(value)
    return rows
