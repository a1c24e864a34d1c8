import cv2
import numpy as np
import pytest
from tiny_capture import HEIGHT, WIDTH, write_tiny_capture

from hairfit.capture.backdrop import read_depth, read_photograph
from hairfit.capture.cameras import read_cameras
from hairfit.errors import InputError


@pytest.fixture
def capture(tmp_path):
    return write_tiny_capture(tmp_path / "tiny")


def test_a_photograph_is_brought_to_a_size(capture):
    entry = read_cameras(capture / "cameras.json")[0]
    for size in ((WIDTH, HEIGHT), (2 * WIDTH, 2 * HEIGHT), (24, 32)):
        picture = read_photograph(capture, entry, size)
        assert picture.shape == (size[1], size[0], 3)
        assert picture[0, 0, 0] == pytest.approx(0.456, abs=0.01)


def test_a_missing_photograph_is_refused(capture):
    entry = read_cameras(capture / "cameras.json")[0]
    (capture / "images/00.png").unlink()
    with pytest.raises(InputError, match="no picture of camera '00'"):
        read_photograph(capture, entry, (WIDTH, HEIGHT))


def test_a_photograph_of_another_size_is_refused(capture):
    entry = read_cameras(capture / "cameras.json")[0]
    cv2.imwrite(str(capture / "images/00.png"), np.zeros((9, 9, 3), np.uint8))
    with pytest.raises(InputError, match=f"9x9 pixels but its camera {WIDTH}x{HEIGHT}"):
        read_photograph(capture, entry, (WIDTH, HEIGHT))


def test_what_has_no_depth_is_infinitely_far(tmp_path):
    depth = np.array([[0.5, np.nan, 0.0], [np.inf, -1.0, 2.0]], np.float32)
    np.save(tmp_path / "a.npy", depth)
    cv2.imwrite(str(tmp_path / "a.tiff"), depth)
    expected = [[0.5, np.inf, np.inf], [np.inf, np.inf, 2.0]]
    for kind in ("npy", "tiff"):
        assert np.array_equal(read_depth(tmp_path / f"a.{kind}"), expected)


@pytest.mark.parametrize("name", ["a.npy", "b.npy", "c.tiff", "d.exr", "gone.npy"])
def test_what_is_no_depth_is_refused(tmp_path, name):
    np.save(tmp_path / "a.npy", np.zeros((3, 3, 3)))
    (tmp_path / "b.npy").write_text("no array")
    cv2.imwrite(str(tmp_path / "c.tiff"), np.zeros((3, 3), np.uint8))
    sentences = {
        "a.npy": r"holds float64 of shape \(3, 3, 3\), not one depth in metres",
        "b.npy": "cannot read",
        "c.tiff": "holds uint8",
        "d.exr": "must be .npy or .tiff; convert it",
        "gone.npy": "cannot read",
    }
    with pytest.raises(InputError, match=sentences[name]):
        read_depth(tmp_path / name)
