"""How close fits come to the truth, and what they cost: the benchmark that decides.

Run `python benchmarks/accuracy.py [CAPTURE ...] [--views 3 4 8 12] [--seeds 0 1 2]
[--quality normal] [--out FOLDER]`. A capture is a folder with a `truth.npz`, one of the
reference captures (ruby, ponytail), or a synthetic scene of `scenes.py`; by default all
of them. Every fit is made by the command line in a process of its own, whose wall time
(with compilation, reading and the report) and peak memory are measured, and evaluated
against the truth, all points and all neighbours, and against the photographs that were
held back from it.

FOLDER takes `table.md`, `index.html` with pictures, `figures.json` with every figure,
and a file for each run, so that a benchmark that was stopped goes on where it was.
`--gate` compares with `accuracy_baseline.json` and exits 1 with a sentence for each
figure that became worse.
"""

import argparse
import json
import pathlib
import sys
import tempfile
from collections.abc import Sequence

from accuracy_gate import (
    BASELINE,
    Runs,
    complaints,
    not_compared,
    read_baseline,
    write_baseline,
)
from accuracy_page import write_page
from accuracy_run import PACKAGE, SUBSETS, Run, RunFailed, do_run, result_folder
from accuracy_table import gather, markdown
from scenes import SCENES, make_apart
from strands import machine

CAPTURES = pathlib.Path(__file__).parents[2] / "shared" / "captures"
REFERENCES = ("ruby", "ponytail")


def main() -> int:
    """Do all runs, write what was found, and return the exit status."""
    given = parse()
    out = given.out or pathlib.Path(tempfile.mkdtemp(prefix="hairfit-accuracy-"))
    out.mkdir(parents=True, exist_ok=True)
    if given.gate:
        read_baseline(given.baseline)  # Before hours of fits, not after them.
    captures = find_captures(given.captures, given.scenes or out / "scenes")
    print(f"{machine()}; code in {PACKAGE}; results in {out}", file=sys.stderr)
    runs: Runs = {}
    failed: list[str] = []
    shown: dict[str, Run] = {}
    plan = [
        Run(capture, views, seed, given.quality)
        for capture in captures
        for views in given.views
        for seed in given.seeds
    ]
    for number, run in enumerate(plan, 1):
        print(f"{number}/{len(plan)} {run.group}, seed {run.seed}", file=sys.stderr)
        try:
            runs.setdefault(run.group, {})[run.seed] = do_run(run, out)
        except RunFailed as error:
            failed.append(f"{run.group}, seed {run.seed}: {error}")
            continue
        if result_folder(run, out).is_dir():
            shown.setdefault(run.group, run)
        report(runs, out)
    runs = {group: seeds for group, seeds in runs.items() if seeds}
    if not given.no_pictures:
        title = f"{machine()}. Pictures of the first seed, figures over all."
        write_page(out, list(shown.values()), gathered(runs), title)
    print((out / "table.md").read_text(encoding="utf-8") if runs else "no run ended")
    if given.write_baseline and not failed:
        write_baseline(given.baseline, runs, machine())
    return judge(given, runs, failed)


def judge(given: argparse.Namespace, runs: Runs, failed: Sequence[str]) -> int:
    """Print what failed and what became worse; return the exit status."""
    found = list(failed)
    if given.gate:
        baseline = read_baseline(given.baseline)
        found += complaints(runs, baseline)
        for group in not_compared(runs, baseline):
            print(f"not in the baseline: {group}", file=sys.stderr)
    for sentence in found:
        print(sentence)
    return 1 if found else 0


def parse() -> argparse.Namespace:
    """Return what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("captures", nargs="*", help="folders or names")
    parser.add_argument(
        "--views", type=int, nargs="+", default=list(SUBSETS), choices=list(SUBSETS)
    )
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--quality", default="normal")
    parser.add_argument("--out", type=pathlib.Path)
    parser.add_argument(
        "--scenes", type=pathlib.Path, help="where scenes are kept; else in OUT"
    )
    parser.add_argument("--no-pictures", action="store_true")
    parser.add_argument("--gate", action="store_true", help="compare with the baseline")
    parser.add_argument("--write-baseline", action="store_true")
    parser.add_argument("--baseline", type=pathlib.Path, default=BASELINE)
    return parser.parse_args()


def find_captures(names: Sequence[str], scenes: pathlib.Path) -> list[pathlib.Path]:
    """Return the folders of captures, of which synthetic ones are made if need be."""
    every = [n for n in REFERENCES if (CAPTURES / n).is_dir()] + list(SCENES)
    folders = []
    for name in names or every:
        if name in SCENES:
            folders.append(make_apart(name, scenes))
        elif name in REFERENCES:
            folders.append(CAPTURES / name)
        else:
            folders.append(pathlib.Path(name))
    for folder in folders:
        if not (folder / "truth.npz").is_file():
            raise SystemExit(
                f"no truth.npz in '{folder}'; name a capture that has one, or one of "
                f"{', '.join(every)}."
            )
    named = [folder.name for folder in folders]
    twice = sorted({name for name in named if named.count(name) > 1})
    if twice:
        raise SystemExit(
            f"several captures are named {', '.join(twice)}, whose results would "
            "overwrite each other; rename their folders."
        )
    return folders


def gathered(runs: Runs):
    """Return the figures of groups over their seeds."""
    return {group: gather(list(seeds.values())) for group, seeds in runs.items()}


def report(runs: Runs, out: pathlib.Path) -> None:
    """Write the table and all figures as far as they are known."""
    groups = gathered({group: seeds for group, seeds in runs.items() if seeds})
    table = markdown(groups, lambda name: name.split(", ", 1)[1])
    (out / "table.md").write_text(table, encoding="utf-8")
    figures = {
        name: {key: one._asdict() for key, one in group.items()}
        for name, group in groups.items()
    }
    (out / "figures.json").write_text(json.dumps(figures, indent=1), encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
