import cv2
import numpy as np
import pytest

from hairfit.capture import linear_from_srgb, srgb_from_linear
from hairfit.capture.photos import encode_picture, find_photos, read_photo, stem
from hairfit.errors import InputError


def test_srgb_has_its_known_values_and_its_inverse():
    value = np.array([0.0, 0.04045, 0.5, 1.0])
    expected = [0.0, 0.0031308, 0.2140411, 1.0]
    assert np.allclose(linear_from_srgb(value), expected, atol=1e-7)
    assert np.allclose(srgb_from_linear(linear_from_srgb(value)), value, atol=1e-6)


def test_eight_and_sixteen_bits_and_grey_read_alike(tmp_path):
    eight = np.arange(0, 256, 5, dtype=np.uint8).reshape(4, 13)
    colour = np.stack([eight] * 3, -1)
    cv2.imwrite(str(tmp_path / "8.png"), colour)
    cv2.imwrite(str(tmp_path / "16.png"), colour.astype(np.uint16) * 257)
    cv2.imwrite(str(tmp_path / "grey.png"), eight)
    expected = np.repeat(linear_from_srgb(eight / 255.0)[..., None], 3, axis=2)
    for name in ("8.png", "16.png", "grey.png"):
        assert np.allclose(read_photo(tmp_path / name), expected, atol=1e-6)


def test_channels_are_red_green_blue(tmp_path):
    picture = np.zeros((2, 2, 3), np.uint8)
    picture[..., 0] = 255
    (tmp_path / "red.png").write_bytes(encode_picture(picture, ".png"))
    assert np.allclose(read_photo(tmp_path / "red.png")[0, 0], [1, 0, 0])


def test_an_encoded_picture_is_reduced_to_the_height_asked_for():
    picture = np.full((100, 80, 3), 128, np.uint8)
    data = encode_picture(picture, ".jpg", height=50)
    decoded = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert decoded is not None and decoded.shape == (50, 40, 3)


def test_dots_are_part_of_a_name():
    assert stem("anna.front.JPG") == "anna.front"
    assert stem("anna.front") == "anna.front"


def test_pictures_of_one_name_are_refused(tmp_path):
    for name in ("a.png", "a.jpg"):
        (tmp_path / name).write_bytes(b"")
    with pytest.raises(InputError, match="have the same name; remove or rename"):
        find_photos(tmp_path)


def test_a_phones_own_format_is_refused(tmp_path):
    (tmp_path / "a.HEIC").write_bytes(b"")
    with pytest.raises(InputError, match="convert it to PNG or JPEG first"):
        find_photos(tmp_path)
