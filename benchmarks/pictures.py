"""Put previews of results side by side: the pictures of the README.

Run `python benchmarks/pictures.py OUT.jpg RESULT [RESULT ...] [--views 00,02,04]`, with
results of `hairfit fit`; each result is one row.
"""

import argparse
import pathlib

import numpy as np

from hairfit.capture.photos import encode_picture, read_photo, srgb_from_linear


def main() -> None:
    """Write the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("results", nargs="+", type=pathlib.Path)
    parser.add_argument("--views", default="00,02,04")
    given = parser.parse_args()
    rows = []
    for result in given.results:
        paths = [result / "preview" / f"{v}.png" for v in given.views.split(",")]
        shown = np.concatenate([srgb_from_linear(read_photo(p)) for p in paths], axis=1)
        # Half of the size, by the mean of 2 by 2 pixels.
        height, width = shown.shape[0] // 2, shown.shape[1] // 2
        shown = shown[: 2 * height, : 2 * width].reshape(height, 2, width, 2, 3)
        rows.append(np.round(255 * shown.mean(axis=(1, 3))).astype(np.uint8))
    given.out.parent.mkdir(parents=True, exist_ok=True)
    given.out.write_bytes(encode_picture(np.concatenate(rows), ".jpg", quality=85))


if __name__ == "__main__":
    main()
