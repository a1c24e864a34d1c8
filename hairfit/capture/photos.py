"""Photographs: finding them, reading them, and their colours as linear light."""

from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8

from ..errors import InputError

SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp")
PHONE_SUFFIXES = (".heic", ".heif", ".dng", ".cr2", ".nef", ".arw", ".avif")


def stem(name: str) -> str:
    """Return `name` without the suffix of a picture; other dots belong to the name."""
    path = Path(name)
    known = path.suffix.lower() in SUFFIXES + PHONE_SUFFIXES
    return path.stem if known else path.name


def find_photos(folder: Path) -> dict[str, Path]:
    """Return the pictures in `folder`, by name without suffix.

    Raises:
        InputError: If there are none, or two differ only in their suffix.
    """
    if not folder.is_dir():
        raise InputError(
            f"no folder '{folder}'; put the photographs into it as PNG or JPEG files."
        )
    files = sorted(path for path in folder.iterdir() if not path.name.startswith("."))
    photos: dict[str, Path] = {}
    for path in files:
        if path.suffix.lower() in PHONE_SUFFIXES:
            raise InputError(
                f"'{path}' is of a kind that hairfit cannot read; convert it to PNG "
                "or JPEG first."
            )
        if path.suffix.lower() not in SUFFIXES:
            continue
        if path.stem in photos:
            raise InputError(
                f"'{path}' and '{photos[path.stem].name}' have the same name; remove "
                "or rename one of them."
            )
        photos[path.stem] = path
    if not photos:
        raise InputError(
            f"no photographs in '{folder}'; put them there as PNG or JPEG files."
        )
    return photos


def decode_picture(path: Path, flags: int) -> np.ndarray:
    """Return the pixels of a picture file as OpenCV decodes them with `flags`.

    Raises:
        InputError: If the file cannot be read as a picture.
    """
    import cv2

    try:
        data = np.fromfile(path, np.uint8)
    except OSError as error:
        raise InputError(
            f"cannot read '{path}' ({error.strerror}); check that it is a file and "
            "that you may read it."
        ) from error
    try:
        pixels = cv2.imdecode(data, flags) if data.size else None
    except cv2.error:
        pixels = None
    if pixels is None:
        raise InputError(
            f"'{path}' is not a picture, whatever its name says; replace it with a "
            "PNG or JPEG file."
        )
    return pixels


def read_photo(path: Path) -> Float[np.ndarray, "height width 3"]:
    """Return a photograph as linear RGB, 1 being white; 8 and 16 bits are sRGB.

    The turn that a phone notes in the file (EXIF) is applied, transparency dropped.

    Raises:
        InputError: If the file cannot be read as a picture.
    """
    import cv2

    pixels = decode_picture(path, cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH)
    rgb = pixels[..., ::-1]
    if np.issubdtype(rgb.dtype, np.integer):
        # A table is faster than 2.4th powers of millions of floats.
        white = np.iinfo(rgb.dtype).max
        table = linear_from_srgb(np.linspace(0.0, 1.0, white + 1))
        return table.astype(np.float32)[rgb]
    return np.ascontiguousarray(rgb, np.float32)


def linear_from_srgb(value: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Return linear light of sRGB values in [0, 1] (IEC 61966-2-1)."""
    return np.where(
        value <= 0.04045, value / 12.92, ((np.maximum(value, 0) + 0.055) / 1.055) ** 2.4
    )


def srgb_from_linear(value: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Return sRGB values in [0, 1] of linear light, which is clipped to [0, 1]."""
    value = np.clip(value, 0.0, 1.0)
    return np.where(
        value <= 0.0031308, value * 12.92, 1.055 * value ** (1 / 2.4) - 0.055
    )


def encode_picture(
    rgb: UInt8[np.ndarray, "height width channels"],
    suffix: str,
    *,
    height: int | None = None,
    quality: int = 85,
) -> bytes:
    """Return a picture (sRGB) as the bytes of a file.

    Args:
        rgb: The picture; of a PNG perhaps with alpha, not premultiplied.
        suffix: ".png" or ".jpg".
        height: Reduce the picture to this height if it is higher.
        quality: Of a JPEG, up to 100.
    """
    import cv2

    if height is not None and rgb.shape[0] > height:
        width = max(1, round(rgb.shape[1] * height / rgb.shape[0]))
        rgb = np.asarray(cv2.resize(rgb, (width, height), interpolation=cv2.INTER_AREA))
    options = [cv2.IMWRITE_JPEG_QUALITY, quality] if suffix == ".jpg" else []
    order = [2, 1, 0, 3][: rgb.shape[2]]
    written, data = cv2.imencode(suffix, np.ascontiguousarray(rgb[..., order]), options)
    if not written:
        raise ValueError(f"OpenCV cannot write '{suffix}'.")
    return data.tobytes()
