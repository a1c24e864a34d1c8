"""Zip files of arrays, the same bytes for the same arrays."""

import io
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from .atomic import atomic_path

# What reading a damaged zip file, header or array can raise.
DAMAGE = (
    zipfile.BadZipFile,
    zlib.error,
    ValueError,
    KeyError,
    TypeError,
    EOFError,
    OSError,
    NotImplementedError,
)


def write_archive(
    path: Path, entries: Mapping[str, bytes], *, compress: bool = False
) -> None:
    """Write a zip file whose bytes depend on `entries` alone.

    Args:
        path: The file.
        entries: Content by name, in the order of the file.
        compress: Deflate them. Compressors differ between machines, so only stored
            entries are the same bytes everywhere.
    """
    method = zipfile.ZIP_DEFLATED if compress else zipfile.ZIP_STORED
    with atomic_path(path) as new, zipfile.ZipFile(new, "w") as archive:
        for name, content in entries.items():
            # Zip's first possible time; the time of writing would change the bytes.
            info = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
            info.create_system = 3
            info.external_attr = 0o644 << 16
            archive.writestr(info, content, method, compresslevel=9)


def encode_array(array: np.ndarray) -> bytes:
    """Return an array as the content of an `.npy` file."""
    buffer = io.BytesIO()
    plain = np.ascontiguousarray(array).reshape(array.shape)
    np.lib.format.write_array(buffer, plain, version=(1, 0), allow_pickle=False)
    return buffer.getvalue()


def decode_array(content: bytes) -> np.ndarray:
    """Return the array of an `.npy` file's content.

    Raises:
        ValueError: If it is damaged or holds Python objects.
    """
    buffer = io.BytesIO(content)
    array = np.lib.format.read_array(buffer, allow_pickle=False)
    if buffer.read(1):
        raise ValueError("there is more than the array's header says.")
    return array
