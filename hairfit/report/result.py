"""Result folders: written whole or not at all, and fits that can be taken up again."""

import contextlib
import dataclasses
import hashlib
import json
import os
import secrets
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ..capture.capture import Capture
from ..capture.fingerprint import fingerprint
from ..errors import InputError
from ..io.atomic import atomic_path

FORMAT = "hairfit result"
PARTIAL_FORMAT = "hairfit partial fit"


def is_result(folder: Path) -> bool:
    """Return whether a folder is a result that hairfit wrote."""
    try:
        report = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(report, dict) and report.get("format") == FORMAT


def read_report(folder: Path) -> dict[str, Any]:
    """Return what `report.json` of a result says.

    Raises:
        InputError: If the folder is not a result.
    """
    if not is_result(folder):
        raise InputError(
            f"'{folder}' is not a result of hairfit; make one with `hairfit fit`."
        )
    return json.loads((folder / "report.json").read_text(encoding="utf-8"))


def write_report(folder: Path, report: dict[str, Any]) -> None:
    """Write `report.json`."""
    text = json.dumps(plain(report), indent=1, ensure_ascii=False) + "\n"
    (folder / "report.json").write_text(text, encoding="utf-8")


def captured_from(result: Path) -> Path | None:
    """Return the capture that a result was made from, None if it is gone."""
    folder = Path(os.path.normpath(result / read_report(result)["capture"]))
    return folder if (folder / "cameras.json").is_file() else None


def check_out(out: Path, capture: Path) -> None:
    """Refuse a place for a result where something else would be lost.

    Raises:
        InputError: If `out` is the capture, a file, or a folder of something else.
    """
    if out.resolve() == capture.resolve():
        raise InputError(
            f"--out '{out}' is the capture itself; name another folder for the result."
        )
    if out.is_file():
        raise InputError(
            f"--out '{out}' is a file; name a folder for the result, new or of an "
            "earlier result."
        )
    if out.is_dir() and any(out.iterdir()) and not is_result(out):
        raise InputError(
            f"--out '{out}' is a folder that is not a result of hairfit; name another, "
            "or empty it first."
        )


@contextlib.contextmanager
def whole_folder(out: Path) -> Iterator[Path]:
    """Give a new folder beside `out` to write into, and move it there at the end.

    What was at `out` is replaced only then; on any exception it stays as it was.
    """
    old = out.with_name(f".{out.name}.{secrets.token_hex(4)}.old")
    try:
        with atomic_path(out) as new:
            new.mkdir()
            yield new
            if out.exists():
                out.rename(old)
    finally:
        if old.exists() and not out.exists():
            old.rename(out)
        shutil.rmtree(old, ignore_errors=True)


@dataclasses.dataclass(frozen=True)
class Checkpoint:
    """Where a fit leaves its finished stages.

    Attributes:
        folder: The folder, empty at first.
        resuming: Whether it holds stages of the same fit.
    """

    folder: Path
    resuming: bool


def open_checkpoint(out: Path, capture: Capture, config: Any) -> Checkpoint:
    """Return the checkpoint of a fit beside its result; stages of another are removed.

    Args:
        out: The result's folder.
        capture: What is fitted.
        config: The frozen dataclass of the fit's settings.

    Raises:
        InputError: If something else is in its place.
    """
    folder = out.with_name(out.name + ".partial")
    key = {"format": PARTIAL_FORMAT, "key": fit_key(capture, config)}
    key_file = folder / "key.json"
    found = None
    if folder.exists():
        with contextlib.suppress(OSError, ValueError):
            found = json.loads(key_file.read_text(encoding="utf-8"))
        if not isinstance(found, dict) or found.get("format") != PARTIAL_FORMAT:
            raise InputError(
                f"'{folder}' is in the way of the fit's checkpoint; move it elsewhere."
            )
        if found != key:
            shutil.rmtree(folder)
    folder.mkdir(parents=True, exist_ok=True)
    key_file.write_text(json.dumps(key), encoding="utf-8")
    return Checkpoint(folder, any(path != key_file for path in folder.iterdir()))


def close_checkpoint(checkpoint: Checkpoint, *, keep: bool) -> None:
    """Remove a checkpoint; with `keep` only if it holds no stage."""
    if not keep or len(list(checkpoint.folder.iterdir())) <= 1:
        shutil.rmtree(checkpoint.folder, ignore_errors=True)


def fit_key(capture: Capture, config: Any) -> str:
    """Return a hash of a fit's inputs and of the program that runs it."""
    digest = hashlib.sha256(fingerprint(capture).encode())
    digest.update(json.dumps(dataclasses.asdict(config), sort_keys=True).encode())
    package = Path(__file__).parents[1]
    for path in sorted(package.rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def plain(value: Any) -> Any:
    """Return a value as JSON has it: no arrays, no NaN."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if hasattr(value, "tolist"):
        return plain(np.asarray(value).tolist())
    if isinstance(value, float):
        return float(f"{value:.6g}") if np.isfinite(value) else None
    return value
