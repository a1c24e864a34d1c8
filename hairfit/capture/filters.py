"""Oriented quadrature filters: how much a picture varies across each direction.

The filters are log-Gabor, polar-separable in the frequency plane. Each passes one side
of the spectrum only, so that its response is complex: the real part is the even (ridge)
filter, the imaginary part the odd (edge) filter, and the squared modulus the local
energy, whatever the phase of the hair under the pixel. They run as products in the
frequency plane, which for filters of this size is the fastest convolution.
"""

import math

import numpy as np
from jaxtyping import Bool, Complex64, Float, Float32
from scipy import fft


def line_moments(
    values: Float32[np.ndarray, "rows columns"],
    wavelength: float,
    length: float,
    bandwidth: float,
) -> Float32[np.ndarray, "half_rows half_columns 3"]:
    r"""Return the doubled-angle moments of the energy, on a grid of half the size.

    With $E(\theta)$ the energy of the filter along the line $\theta$, they are
    $\sum E \cos 2\theta$, $\sum E \sin 2\theta$ and $\sum E$, scaled such that the last
    is the variance of the picture where that is white noise.

    Args:
        values: The picture, of even size; zero where nothing is known.
        wavelength: Wavelength of the filters' centre, in pixels.
        length: Standard deviation of the filters along the line, in pixels.
        bandwidth: Standard deviation of the logarithm of the frequency that passes.
    """
    rows, columns = values.shape
    # Of a band below a quarter of the sampling rate, every other sample is enough.
    step = 2 if wavelength >= 11.0 else 1
    pad = 2 * math.ceil(max(wavelength, length))
    size = [fast_size(count + pad, 2 * step) for count in (rows, columns)]
    spectrum = low_frequencies(np.asarray(fft.fft2(values, s=size)), step)
    fy = fft.fftfreq(size[0] // step).astype(np.float32)[:, None] / step
    fx = fft.fftfreq(size[1] // step).astype(np.float32)[None] / step
    octave = np.log(np.maximum(np.hypot(fx, fy), 1e-6) * wavelength)
    band = np.exp(-0.5 * (octave / bandwidth) ** 2)
    spectrum = spectrum * (band / step**2)
    # A filter of this length passes frequencies within this angle; at 0.8 spacings the
    # squared responses of neighbouring directions overlap without ripple.
    spread = wavelength / (2 * math.pi * length)
    orientations = max(8, math.ceil(0.8 * math.pi / spread))
    turn = np.arctan2(fy, fx)
    moments = np.zeros((rows // 2, columns // 2, 3), np.float32)
    gain = 0.0
    for theta in (math.pi * index / orientations for index in range(orientations)):
        # A line along theta has its frequencies across, at theta + pi / 2. How far
        # those of the plane are turned from there is less than a turn either way.
        off = turn + np.float32(0.5 * math.pi - theta)
        off -= np.copysign(np.float32(math.pi), off)
        passed = np.exp(np.float32(-0.5 / spread**2) * off**2)
        gain += float(np.mean((band * passed) ** 2)) / step**2
        response = np.asarray(fft.ifft2(spectrum * passed, overwrite_x=True))
        response = response[: rows // step, : columns // step]
        energy = np.real(response) ** 2 + np.imag(response) ** 2
        if step == 1:
            energy = halved(energy)
        for channel, share in enumerate((math.cos(2 * theta), math.sin(2 * theta), 1)):
            moments[..., channel] += np.float32(share) * energy
    return moments / np.float32(gain)


def fast_size(least: int, multiple: int) -> int:
    """Return the next size that has small factors only and divides by `multiple`."""
    size = -(-least // multiple) * multiple
    while True:
        rest = size
        for factor in (2, 3, 5):
            while rest % factor == 0:
                rest //= factor
        if rest == 1:
            return size
        size += multiple


def low_frequencies(
    spectrum: Complex64[np.ndarray, "rows columns"], step: int
) -> Complex64[np.ndarray, "_rows _columns"]:
    """Return the spectrum as if one in `step` pixels had been taken, low-passed.

    Each sample stands in the middle of the pixels it is taken for, as their mean does.
    """
    if step == 1:
        return spectrum
    rows, columns = (count // step for count in spectrum.shape)
    top, left = (spectrum.shape[0] - rows) // 2, (spectrum.shape[1] - columns) // 2
    centred = fft.fftshift(spectrum)[top : top + rows, left : left + columns]
    shift = math.pi * (step - 1) / step
    down, right = (
        np.exp(1j * shift * fft.fftfreq(count)).astype(np.complex64)
        for count in (rows, columns)
    )
    return fft.ifftshift(centred) * down[:, None] * right


def halved(
    values: Float[np.ndarray, "rows columns"],
) -> Float[np.ndarray, "_rows _columns"]:
    """Return the means of every two by two pixels of a picture of even size."""
    pairs = values[0::2] + values[1::2]
    return (pairs[:, 0::2] + pairs[:, 1::2]) / 4


def square_means(
    values: Float[np.ndarray, "height width channels"], times: int
) -> Float32[np.ndarray, "rows columns channels"]:
    """Return means over squares of so many pixels a side, 0 beyond the border."""
    spare = [(0, -size % times) for size in values.shape[:2]]
    values = np.pad(values, [*spare, (0, 0)])
    rows, columns = (size // times for size in values.shape[:2])
    squares = values.reshape(rows, times, columns, times, -1)
    return squares.mean(axis=(1, 3)).astype(np.float32)


def gaussian_blur(
    maps: Float32[np.ndarray, "rows columns *channels"], sigma: float
) -> Float32[np.ndarray, "rows columns *channels"]:
    """Return maps blurred; beyond the border all is 0."""
    import cv2

    size = 2 * math.ceil(3.5 * sigma) + 1
    return cv2.GaussianBlur(maps, (size, size), sigma, borderType=cv2.BORDER_CONSTANT)


def mean_of_hair(
    values: Float32[np.ndarray, "rows columns"],
    hair: Bool[np.ndarray, "rows columns"],
    sigma: float,
) -> Float32[np.ndarray, "rows columns"]:
    """Return the mean of the hair about each pixel, by a Gaussian of so many pixels."""
    counts = hair.astype(np.float32)
    sums = gaussian_blur(np.stack([values * counts, counts], axis=2), sigma)
    return sums[..., 0] / np.maximum(sums[..., 1], np.float32(1e-3))
