"""Where pictures go: a PNG, a folder of them, an animated GIF or a film."""

import contextlib
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from ..capture.photos import encode_picture
from ..errors import InputError
from ..io.atomic import atomic_path

FRAMES_PER_SECOND = 25

Picture = UInt8[np.ndarray, "height width channels"]
Write = Callable[[Picture], None]


def check_film(out: Path, count: int | None) -> None:
    """Refuse a place where pictures cannot go.

    Args:
        out: Where to.
        count: How many pictures; None for a single one that is no film.

    Raises:
        InputError: If `out` has the wrong suffix, or something is there already.
    """
    suffix = out.suffix.lower()
    if count is None:
        if suffix != ".png":
            raise InputError(f"--out '{out}' must end with .png; rename it.")
        return
    if suffix == ".mp4" and shutil.which("ffmpeg") is None:
        raise InputError(
            "films need ffmpeg, which is not here; install it (on Debian or Ubuntu: "
            "`apt-get install ffmpeg`), or end --out with .gif or name a folder."
        )
    if suffix in (".gif", ".mp4"):
        return
    if suffix in (".png", ".jpg", ".jpeg", ".webm", ".mov", ".avi"):
        raise InputError(
            f"--out '{out}' must be a folder, .gif or .mp4 for {count} pictures; "
            "rename it."
        )
    if out.is_file() or (out.is_dir() and any(out.iterdir())):
        raise InputError(f"--out '{out}' must be a new or empty folder; name another.")


@contextlib.contextmanager
def open_film(out: Path, names: Sequence[str]) -> Iterator[Write]:
    """Give a function that takes picture after picture; what they make is at `out`.

    Nothing is left there if something fails on the way.

    Args:
        out: A PNG, a GIF, an MP4 or a folder; `check_film` has seen it.
        names: Of the pictures, for a folder.

    Raises:
        InputError: If it cannot be written there.
    """
    kinds = {".png": write_png, ".gif": write_gif, ".mp4": write_mp4}
    with atomic_path(out) as new:
        kind = kinds.get(out.suffix.lower())
        with kind(new) if kind else write_folder(new, names) as write:
            yield write


@contextlib.contextmanager
def write_png(path: Path) -> Iterator[Write]:
    """Give a function that writes the one picture."""
    yield lambda picture: write_picture(path, picture)


@contextlib.contextmanager
def write_folder(path: Path, names: Sequence[str]) -> Iterator[Write]:
    """Give a function that writes pictures into a folder, by their names."""
    path.mkdir()
    left = iter(names)
    yield lambda picture: write_picture(path / f"{next(left)}.png", picture)


@contextlib.contextmanager
def write_gif(path: Path) -> Iterator[Write]:
    """Give a function that takes the frames of an animated GIF."""
    from PIL import Image

    frames: list[Image.Image] = []

    def write(picture: Picture) -> None:
        # Colours are chosen for each frame: 256 are few.
        frame = Image.fromarray(np.ascontiguousarray(picture[..., :3]))
        frames.append(frame.quantize(256, Image.Quantize.MEDIANCUT))

    yield write
    frames[0].save(
        path,
        save_all=True,
        append_images=frames[1:],
        duration=1000 // FRAMES_PER_SECOND,
        loop=0,
        disposal=1,
    )


@contextlib.contextmanager
def write_mp4(path: Path) -> Iterator[Write]:
    """Give a function that hands frames to ffmpeg."""
    program = shutil.which("ffmpeg")
    assert program is not None
    process: subprocess.Popen | None = None
    with tempfile.TemporaryFile() as words:

        def write(picture: Picture) -> None:
            nonlocal process
            height, width = picture.shape[:2]
            if process is None:
                process = subprocess.Popen(
                    [program, *ffmpeg_words(width, height), str(path)],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.DEVNULL,
                    stderr=words,
                )
            assert process.stdin is not None
            # If ffmpeg has stopped, its exit status says so below.
            with contextlib.suppress(BrokenPipeError):
                process.stdin.write(np.ascontiguousarray(picture[..., :3]).tobytes())

        try:
            yield write
            assert process is not None and process.stdin is not None
            with contextlib.suppress(BrokenPipeError):
                process.stdin.close()
            if process.wait() != 0 or not path.exists():
                words.seek(0)
                said = words.read().decode(errors="replace").strip().splitlines()
                reason = said[-1] if said else f"exit status {process.returncode}"
                raise InputError(
                    f"ffmpeg could not write the film ({reason}); end --out with .gif, "
                    "or name a folder."
                )
        finally:
            if process is not None and process.poll() is None:
                process.kill()
                process.wait()
            if process is not None and process.stdin is not None:
                with contextlib.suppress(BrokenPipeError):
                    process.stdin.close()


def ffmpeg_words(width: int, height: int) -> list[str]:
    """Return what ffmpeg is told about frames that come as bytes, but for the file."""
    size, rate = f"{width}x{height}", str(FRAMES_PER_SECOND)
    raw = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", size, "-r", rate, "-i", "-"]
    # Players want colours at half the size, which odd sizes do not have.
    even = "pad=ceil(iw/2)*2:ceil(ih/2)*2:color=white"
    return ["-loglevel", "error", "-y", *raw, "-vf", even, "-pix_fmt", "yuv420p"]


def write_picture(path: Path, picture: Picture) -> None:
    """Write one PNG."""
    path.write_bytes(encode_picture(picture, ".png"))
