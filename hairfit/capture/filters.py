"""Oriented quadrature filters: how much a picture varies across each direction.

The filters are log-Gabor, polar-separable in the frequency plane. Each passes one side
of the spectrum only, so that its response is complex: the real part is the even (ridge)
filter, the imaginary part the odd (edge) filter, and the squared modulus the local
energy, whatever the phase of the hair under the pixel. They run as products in the
frequency plane, which for filters of this size is the fastest convolution.
"""

import contextlib
import math
import threading
from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from torch import Tensor

# torch counts its threads for the whole process.
THREADS = threading.Lock()


def line_moments(
    values: "Tensor", wavelength: float, length: float, bandwidth: float
) -> "Tensor":
    r"""Return the doubled-angle moments of the energy, on a grid of half the size.

    With $E(\theta)$ the energy of the filter along the line $\theta$, they are
    $\sum E \cos 2\theta$, $\sum E \sin 2\theta$ and $\sum E$, scaled such that the last
    is the variance of the picture where that is white noise.

    Args:
        values: The picture, `(rows, columns)`, both even; zero where nothing is known.
        wavelength: Wavelength of the filters' centre, in pixels.
        length: Standard deviation of the filters along the line, in pixels.
        bandwidth: Standard deviation of the logarithm of the frequency that passes.

    Returns:
        The three moments, `(3, rows / 2, columns / 2)`.
    """
    import torch

    rows, columns = values.shape
    # Of a band below a quarter of the sampling rate, every other sample is enough.
    step = 2 if wavelength >= 11.0 else 1
    pad = 2 * math.ceil(max(wavelength, length))
    size = [fast_size(count + pad, 2 * step) for count in (rows, columns)]
    spectrum = low_frequencies(torch.fft.fft2(values, s=size), step) / step**2
    fy = torch.fft.fftfreq(size[0] // step, device=values.device)[:, None] / step
    fx = torch.fft.fftfreq(size[1] // step, device=values.device)[None] / step
    octave = torch.log(torch.hypot(fx, fy).clamp_min(1e-6) * wavelength)
    band = torch.exp(-0.5 * (octave / bandwidth) ** 2)
    # A filter of this length passes frequencies within this angle; at 0.8 spacings the
    # squared responses of neighbouring directions overlap without ripple.
    spread = wavelength / (2 * math.pi * length)
    orientations = max(8, math.ceil(0.8 * math.pi / spread))
    turn = torch.atan2(fy, fx)
    moments, gain = torch.zeros((), device=values.device), 0.0
    for theta in (math.pi * index / orientations for index in range(orientations)):
        # A line along theta has its frequencies across, at theta + pi / 2.
        off = torch.remainder(turn - theta + 0.5 * math.pi, 2 * math.pi) - math.pi
        passed = band * torch.exp(-0.5 * (off / spread) ** 2)
        gain += float(passed.square().mean()) / step**2
        response = torch.fft.ifft2(spectrum * passed)
        energy = torch.view_as_real(response).square().sum(-1)
        energy = energy[: rows // step, : columns // step]
        if step == 1:
            energy = torch.nn.functional.avg_pool2d(energy[None], 2)[0]
        axis = (math.cos(2 * theta), math.sin(2 * theta), 1.0)
        moments = moments + torch.stack([share * energy for share in axis])
    return moments / gain


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


def low_frequencies(spectrum: "Tensor", step: int) -> "Tensor":
    """Return the spectrum as if every `step`-th pixel had been taken, low-passed."""
    import torch

    if step == 1:
        return spectrum
    rows, columns = (count // step for count in spectrum.shape)
    top, left = (spectrum.shape[0] - rows) // 2, (spectrum.shape[1] - columns) // 2
    centred = torch.fft.fftshift(spectrum)[top : top + rows, left : left + columns]
    return torch.fft.ifftshift(centred)


def gaussian_blur(maps: "Tensor", sigma: float) -> "Tensor":
    """Return maps, `(channels, rows, columns)`, blurred; beyond the border all is 0."""
    import kornia

    size = 2 * math.ceil(3.5 * sigma) + 1
    return kornia.filters.gaussian_blur2d(
        maps[None], (size, size), (sigma, sigma), border_type="constant"
    )[0]


@contextlib.contextmanager
def one_thread_per_operation() -> Iterator[None]:
    """Keep torch from splitting single operations, for callers that run bands abreast.

    Pictures are small: threads that wait for each other within every operation take ten
    times as long as soon as another process wants the same cores.
    """
    import torch

    with THREADS:
        before = torch.get_num_threads()
        torch.set_num_threads(1)
        try:
            yield
        finally:
            torch.set_num_threads(before)
