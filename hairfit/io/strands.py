"""Strands in files: Cem Yuksel's `.hair`, and `.npz`. `docs/formats.md` has both."""

import struct
import zipfile
from pathlib import Path

import numpy as np
from jaxtyping import Int

from ..errors import InputError
from ..types import Strands
from .archive import DAMAGE, decode_array, encode_array, write_archive
from .atomic import atomic_path

HEADER = struct.Struct("<4sIIIIff3f88s")
SEGMENTS, POINTS, THICKNESS, TRANSPARENCY, COLOURS = (1 << bit for bit in range(5))
MOST_SEGMENTS = 65_535
INFO = b"hairfit; metres, y up"


def save_strands(path: Path | str, strands: Strands) -> None:
    """Write strands to a `.hair` or an `.npz` file, in metres.

    Args:
        path: The file; its suffix says which format.
        strands: The strands; coordinates are written as float32.

    Raises:
        InputError: If the suffix is another, or the format cannot hold the strands.
    """
    path = Path(path)
    if path.suffix == ".npz":
        write_archive(
            path,
            {
                "points.npy": encode_array(strands.points.astype("<f4")),
                "offsets.npy": encode_array(strands.offsets.astype("<i8")),
            },
        )
        return
    if path.suffix != ".hair":
        raise InputError(f"strands are saved as .hair or .npz, not as '{path.name}'.")
    content = encode_hair(strands, path)
    with atomic_path(path) as new:
        new.write_bytes(content)


def load_strands(path: Path | str) -> Strands:
    """Return the strands of a `.hair` file, an `.npz` file or a result folder.

    Args:
        path: The file, or a folder that `hairfit fit` wrote.

    Raises:
        InputError: If there is none, or it is damaged.
    """
    path = Path(path)
    if path.is_dir():
        if not (path / "strands.hair").is_file():
            raise InputError(
                f"no 'strands.hair' in '{path}'; give a result of `hairfit fit`, or a "
                ".hair or .npz file."
            )
        path = path / "strands.hair"
    if path.suffix == ".hairtree":
        raise InputError(
            f"'{path}' is a tree; grow its strands with `hairfit strands {path} "
            f"{path.stem}.hair` first."
        )
    if path.suffix not in (".hair", ".npz"):
        raise InputError(f"'{path}' is not a file of strands; give a .hair or an .npz.")
    if not path.is_file():
        raise InputError(f"there is no '{path}'; check the path.")
    strands = read_npz(path) if path.suffix == ".npz" else read_hair(path)
    return checked(strands, path)


def checked(strands: Strands, path: Path) -> Strands:
    """Return the strands, or refuse them if they cannot be hair."""
    offsets = strands.offsets
    if len(offsets) < 2:
        raise InputError(f"'{path}' holds no strand; export it again.")
    if offsets[0] != 0 or offsets[-1] != len(strands.points):
        raise InputError(
            f"`offsets` in '{path}' do not run from 0 to its {len(strands.points)} "
            "points; export it again."
        )
    if (np.diff(offsets) < 1).any():
        raise InputError(f"'{path}' holds a strand without points; export it again.")
    if not np.isfinite(strands.points).all():
        raise InputError(
            f"'{path}' holds points that are not finite numbers; export it again."
        )
    return strands


def encode_hair(strands: Strands, path: Path) -> bytes:
    """Return the content of a `.hair` file."""
    segments = np.diff(strands.offsets) - 1
    if len(segments) and (segments.min() < 0 or segments.max() > MOST_SEGMENTS):
        raise InputError(
            f"a .hair file holds strands of 1 to {MOST_SEGMENTS + 1} points; save "
            f"'{path.name}' as .npz or with fewer points."
        )
    even = len(segments) > 0 and segments.min() == segments.max()
    flags = POINTS if even else POINTS | SEGMENTS
    header = HEADER.pack(
        b"HAIR",
        strands.count,
        len(strands.points),
        flags,
        int(segments[0]) if even else 0,
        1e-4,  # thickness in metres, as the points are
        0.0,  # transparency
        *(0.25, 0.15, 0.10),  # colour
        INFO,
    )
    table = b"" if even else segments.astype("<u2").tobytes()
    return header + table + strands.points.astype("<f4").tobytes()


def read_hair(path: Path) -> Strands:
    """Return the strands of a `.hair` file; thickness and colours are left aside."""
    content = path.read_bytes()
    if len(content) < HEADER.size or content[:4] != b"HAIR":
        raise InputError(f"'{path}' is not a .hair file: it does not start as one.")
    _, count, points, flags, default, *_ = HEADER.unpack_from(content)
    if not flags & POINTS:
        raise InputError(f"'{path}' holds no points; export it with them.")
    sizes = {
        SEGMENTS: 2 * count,
        POINTS: 12 * points,
        THICKNESS: 4 * points,
        TRANSPARENCY: 4 * points,
        COLOURS: 12 * points,
    }
    expected = HEADER.size + sum(n for flag, n in sizes.items() if flags & flag)
    if len(content) < expected:
        raise InputError(
            f"'{path}' ends early: it has {len(content)} of {expected} bytes; copy or "
            "export it again."
        )
    start = HEADER.size
    segments: Int[np.ndarray, " strands"]
    if flags & SEGMENTS:
        segments = np.frombuffer(content, "<u2", count, start).astype(np.int64)
        start += sizes[SEGMENTS]
    else:
        # A damaged count must not be believed before it agrees with the points.
        if count * (default + 1) != points:
            raise InputError(disagreement(path, count * (default + 1), points))
        segments = np.full(count, default, np.int64)
    if int(segments.sum()) + count != points:
        raise InputError(disagreement(path, int(segments.sum()) + count, points))
    place = np.frombuffer(content, "<f4", 3 * points, start).astype(np.float32)
    offsets = np.concatenate([[0], np.cumsum(segments + 1)]).astype(np.int64)
    return Strands(place.reshape(-1, 3), offsets)


def disagreement(path: Path, needed: int, points: int) -> str:
    """Return the sentence for strands and points that do not add up."""
    return (
        f"'{path}' is damaged: its strands need {needed} points, it has {points}; "
        "copy or export it again."
    )


def read_npz(path: Path) -> Strands:
    """Return the strands of an `.npz` file with `points` and `offsets`."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = set(archive.namelist())
            missing = {"points.npy", "offsets.npy"} - names
            if missing:
                raise InputError(
                    f"'{path}' has no array `{min(missing)[:-4]}`; strands are "
                    "`points` (N, 3) and `offsets` (strands + 1)."
                )
            points = decode_array(archive.read("points.npy"))
            offsets = decode_array(archive.read("offsets.npy"))
    except InputError:
        raise
    except DAMAGE as error:
        raise InputError(
            f"'{path}' is damaged or no .npz of strands; copy or export it again."
        ) from error
    if points.ndim != 2 or points.shape[1:] != (3,) or points.dtype.kind != "f":
        raise InputError(
            f"`points` in '{path}' are {points.dtype} of shape {points.shape}, not "
            "floats of shape (N, 3); export it again."
        )
    if offsets.ndim != 1 or offsets.dtype.kind not in "iu":
        raise InputError(
            f"`offsets` in '{path}' are {offsets.dtype} of shape {offsets.shape}, not "
            "integers of shape (strands + 1); export it again."
        )
    return Strands(points.astype(np.float32), offsets.astype(np.int64))
