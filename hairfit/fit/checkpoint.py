"""Stages of a fit that are done, kept in a folder."""

import dataclasses
from pathlib import Path

import numpy as np

from ..io.atomic import atomic_path


@dataclasses.dataclass(frozen=True)
class Checkpoint:
    """Arrays by stage. Without a folder nothing is kept."""

    folder: Path | None

    def path(self, name: str) -> Path:
        """Return where a file of the checkpoint is."""
        assert self.folder is not None
        return self.folder / name

    def save(self, stage: str, arrays: dict[str, np.ndarray]) -> None:
        """Keep what a stage found; it is there as a whole or not at all."""
        if self.folder is None:
            return
        with (
            atomic_path(self.path(f"{stage}.npz")) as temporary,
            temporary.open("wb") as f,
        ):
            np.savez(f, allow_pickle=False, **arrays)

    def load(self, stage: str) -> dict[str, np.ndarray] | None:
        """Return what a stage found, or None if it is not done."""
        if self.folder is None or not self.path(f"{stage}.npz").is_file():
            return None
        with np.load(self.path(f"{stage}.npz"), allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
