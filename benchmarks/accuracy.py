"""How close fits come to the truth, and what they cost.

Run `python benchmarks/accuracy.py [CAPTURE ...] [--quality normal] [--out FOLDER]`. A
capture is fitted by the command line in a process of its own, whose wall time (with
compilation, reading and the report) and peak memory are measured, and then evaluated
against its `truth.npz`, all points and all neighbours. Prints a Markdown table.
"""

import argparse
import json
import os
import pathlib
import platform
import subprocess
import sys
import tempfile
import time

CAPTURES = pathlib.Path(__file__).parents[2] / "shared" / "captures"
RING = "00,01,02,03,04,05,06,07"
THRESHOLDS = ("2mm_20deg", "3mm_30deg", "4mm_40deg")
HAIRFIT = (
    sys.executable,
    "-c",
    "from hairfit.cli import main; raise SystemExit(main())",
)


def hairfit(*words: str) -> tuple[dict, float, float]:
    """Run a command; return its JSON, its seconds and its peak memory in GB."""
    start = time.monotonic()
    with tempfile.TemporaryFile("w+") as output:
        process = subprocess.Popen(
            [*HAIRFIT, *words, "--json", "--quiet"], stdout=output
        )
        _, status, usage = os.wait4(process.pid, 0)
        seconds = time.monotonic() - start
        if status:
            raise SystemExit(f"`hairfit {' '.join(words)}` failed")
        output.seek(0)
        found = json.loads(output.read().strip().splitlines()[-1])
    return found, seconds, usage.ru_maxrss / 1e6


def row(capture: pathlib.Path, views: str, quality: str, out: pathlib.Path) -> str:
    """Fit and evaluate one capture, and return its row of the table."""
    result = out / f"{capture.name}-{quality}"
    _, seconds, memory = hairfit(
        *("fit", str(capture), "--out", str(result)),
        *("--views", views, "--quality", quality),
    )
    found, _, _ = hairfit("evaluate", str(result), str(capture))
    (out / f"{result.name}.json").write_text(json.dumps(found, indent=1))

    def scores(part: str, kind: str) -> str:
        return ", ".join(f"{100 * found[part][t][kind]['f']:.1f}" for t in THRESHOLDS)

    angle = [p["median_angle_deg"] for p in found["photographs"].values()]
    overlap = [p["hair_iou"] for p in found["photographs"].values()]
    cells = (
        capture.name,
        scores("all", "unsigned"),
        scores("all", "signed"),
        scores("visible", "unsigned"),
        scores("interior", "unsigned"),
        f"{found['head']['points_deeper_than_1mm']}",
        f"{sum(angle) / len(angle):.1f}°, {100 * sum(overlap) / len(overlap):.0f} %",
        f"{seconds:.0f} s, {memory:.1f} GB",
    )
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("captures", nargs="*", type=pathlib.Path)
    parser.add_argument("--views", default=RING)
    parser.add_argument("--quality", default="normal")
    parser.add_argument("--out", type=pathlib.Path, default=None)
    given = parser.parse_args()
    captures = given.captures or [CAPTURES / "ruby", CAPTURES / "ponytail"]
    missing = [str(c) for c in captures if not (c / "truth.npz").is_file()]
    if missing:
        raise SystemExit(f"no truth.npz in {', '.join(missing)}; name other captures.")
    out = given.out or pathlib.Path(tempfile.mkdtemp(prefix="hairfit-accuracy-"))
    out.mkdir(parents=True, exist_ok=True)
    print(
        f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, "
        f"views {given.views}, quality {given.quality}, results in {out}\n"
    )
    print(
        "| capture | F at 2 mm/20°, 3 mm/30°, 4 mm/40° | signed | visible | interior "
        "| points deeper than 1 mm | photographs: angle, IoU | time, memory |"
    )
    print("|---" * 8 + "|")
    for capture in captures:
        print(row(capture, given.views, given.quality, out), flush=True)


if __name__ == "__main__":
    main()
