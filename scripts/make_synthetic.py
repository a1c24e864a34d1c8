"""Write the small scenes of `data/synthetic` again, byte for byte on one processor.

`--check` writes them to a temporary folder and compares.
"""

import argparse
import filecmp
import sys
import tempfile
from pathlib import Path

from hairfit.synthetic import Look, Scene, make_head, make_scalp, make_style
from hairfit.synthetic.scene import write_capture

DATA = Path(__file__).resolve().parents[1] / "data" / "synthetic"
SEED = 0
# Small on purpose: little noise, which no compressor can pack, and few strands.
SCENES = {
    "wavy": Scene(
        size=(384, 512), strands=3200, points=36, seed=SEED, look=Look(noise=0.0015)
    )
}


def write_scene(name: str, folder: Path) -> None:
    """Write one scene to a folder that does not exist yet."""
    head = make_head()
    tree = make_style(name, SEED, make_scalp(head))
    write_capture(tree, head, folder, SCENES[name])


def differences(name: str, folder: Path) -> list[str]:
    """Return the files in which a scene differs from the one in the repository."""
    kept = DATA / name
    files = {
        p.relative_to(root).as_posix()
        for root in (kept, folder)
        for p in root.rglob("*")
        if p.is_file()
    }
    same, _, _ = filecmp.cmpfiles(kept, folder, sorted(files), shallow=False)
    return sorted(files - set(same))


def main() -> int:
    """Write or check all scenes; the exit status is 1 if one differs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="compare, write nothing")
    check = parser.parse_args().check
    status = 0
    for name in SCENES:
        with tempfile.TemporaryDirectory(dir=None if check else DATA) as temporary:
            folder = Path(temporary) / name
            write_scene(name, folder)
            changed = differences(name, folder)
            if check and changed:
                print(f"{name}: these files differ: {', '.join(changed)}")
                status = 1
            elif check:
                print(f"{name}: the same bytes")
            elif changed:
                replace(DATA / name, folder)
                print(f"{name}: written, {len(changed)} files changed")
    return status


def replace(kept: Path, folder: Path) -> None:
    """Put a new scene in the place of the old one."""
    old = folder.with_name("old")
    if kept.exists():
        kept.rename(old)
    folder.rename(kept)


if __name__ == "__main__":
    sys.exit(main())
