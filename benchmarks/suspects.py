"""How often a bad photograph is found, named, or a good one accused.

Run `python benchmarks/suspects.py [CAPTURE ...] [--views 8 4 3] [--each 3]`. First all
subsets as they are, where every doubt is a false alarm; then every kind of corruption
of every `--each`-th view. Captures default to those that are there: the shared ones,
`data/synthetic/wavy`, and styles drawn anew.
"""

import argparse
import collections
import pathlib
import tempfile
import time

from corruptions import corruptions

from hairfit.capture import load_capture
from hairfit.capture.capture import Capture, require_for_fit
from hairfit.capture.select import directions, spread
from hairfit.fit.suspects import find_suspects
from hairfit.render import mesh_depth
from hairfit.synthetic import Scene, make_head, make_scalp, make_style, write_capture

ROOT = pathlib.Path(__file__).parents[1]
SHARED = ROOT.parent / "shared" / "captures"
STYLES = ("straight", "wavy", "curly", "ponytail")


def subset(capture: Capture, count: int) -> list[int]:
    """Return `count` views, spread evenly."""
    return sorted(spread(directions(capture.views), count))


def drawn(folder: pathlib.Path) -> list[pathlib.Path]:
    """Draw a capture of every style, and return where they are."""
    head = make_head()
    for style in STYLES:
        scene = Scene(8, (384, 512), strands=4000)
        write_capture(
            make_style(style, 0, make_scalp(head)), head, folder / style, scene
        )
    return [folder / style for style in STYLES]


def main() -> None:
    """Print a line for every surprise, then the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("captures", nargs="*", type=pathlib.Path)
    parser.add_argument("--views", nargs="*", type=int, default=[12, 8, 4, 3])
    parser.add_argument("--each", type=int, default=3, help="0 for none")
    parser.add_argument("--side", type=int, default=640, help="pixels, at most")
    given = parser.parse_args()
    folders = given.captures
    with tempfile.TemporaryDirectory() as drawings:
        if not folders:
            found = [SHARED / name for name in ("ruby", "ponytail", "walk")]
            folders = [f for f in found if f.is_dir()]
            folders += [ROOT / "data" / "synthetic" / "wavy"]
            folders += drawn(pathlib.Path(drawings))
        table = collections.defaultdict(collections.Counter)
        for folder in folders:
            capture = load_capture(folder, longest_side=given.side)
            for count in given.views:
                if count <= len(capture.views):
                    try_all(capture, count, given.each, table)
    print("| corruption | tried | named | other kind | missed | good views accused |")
    print("|---" * 6 + "|")
    for name, row in table.items():
        cells = [row[k] for k in ("tried", "named", "kind", "missed", "false")]
        print("| " + " | ".join([name, *map(str, cells)]) + " |")


def try_all(capture: Capture, count: int, each: int, table) -> None:
    """Count what is found in one subset of a capture, clean and corrupted."""
    head = require_for_fit(capture)
    chosen = subset(capture, count)
    views = [capture.views[k] for k in chosen]
    depths = [mesh_depth(head, view.camera) for view in views]
    start = time.perf_counter()
    doubts = find_suspects(views, depths, head)
    taken = time.perf_counter() - start
    place = f"{capture.folder.name}, {count} views"
    print(f"{place}: {len(doubts)} doubts when clean, {taken:.1f} s", flush=True)
    table["none"]["tried"] += 1
    table["none"]["false"] += len(doubts)
    for doubt in doubts:
        print(f"  FALSE {doubt.view} {doubt.kind} {doubt.strength:.3f}", flush=True)
    for k in range(0, len(views) if each else 0, each or 1):
        other = views[(k + 2) % len(views)]
        for name, (kind, spoil) in corruptions(other, head).items():
            if kind == "shaken":  # Orientation maps tell; `robustness.py` asks them.
                continue
            bad = [*views]
            bad[k] = spoil(views[k])
            there = [*depths]
            if kind == "camera":
                there[k] = mesh_depth(head, bad[k].camera)
            doubts = find_suspects(bad, there, head)
            judge(f"{place}, {views[k].name}, {name}", doubts, views[k].name, kind)
            row = table[f"{name}, {count}"]
            mine = [d for d in doubts if d.view == views[k].name]
            row["tried"] += 1
            row["false"] += len(doubts) - len(mine)
            verdict = "missed"
            if mine:
                verdict = "named" if mine[0].kind == kind else "kind"
            row[verdict] += 1


def judge(place: str, doubts, name: str, kind: str) -> None:
    """Print what was not as it should be."""
    said = [f"{d.view} {d.kind} {d.strength:.3f} {d.remedy}" for d in doubts]
    if [(d.view, d.kind) for d in doubts] != [(name, kind)]:
        print(f"  {place}: {said or 'nothing'}", flush=True)


if __name__ == "__main__":
    main()
