import numpy as np
import pytest

from hairfit.render.single_layer import (
    look_up,
    simulate_layer,
)


def exact(ior, bins=360, rays=2_000_000, bounces=40):
    """The same by sums over even offsets instead of chances."""
    entry = np.arcsin(np.linspace(-1, 1, rays + 1)[1:-1:2])
    refracted = np.arcsin(np.sin(entry) / ior)
    outside, within = np.cos(entry), np.cos(refracted)
    # Fresnel's equations by the angles alone.
    crossed = np.sin(entry - refracted) / np.sin(entry + refracted)
    flat = np.tan(entry - refracted) / np.tan(entry + refracted)
    back = 0.5 * (crossed**2 + flat**2)
    assert (outside <= within).all()
    edges = np.linspace(-np.pi, np.pi, bins + 1)
    total = np.zeros(bins)
    for p in range(bounces):
        share = back if p == 0 else (1 - back) ** 2 * back ** (p - 1)
        leaves = 2 * p * refracted - 2 * entry + p * np.pi
        turned = np.mod(leaves + np.pi, 2 * np.pi) - np.pi
        total += np.histogram(turned, edges, weights=share)[0]
    return total / (len(entry) * np.diff(edges))


@pytest.fixture(scope="module", params=[1.2, 1.5, 2.5])
def layer(request):
    return request.param, simulate_layer(request.param, rays=1_000_000, bins=90)


def test_chances_come_to_the_sum_over_all_paths(layer):
    ior, table = layer
    expected = exact(ior, bins=90)
    # The noise of a bin is the root of its count.
    noise = np.sqrt(expected * 1_000_000 * 2 * np.pi / 90) / (
        1_000_000 * 2 * np.pi / 90
    )
    assert (np.abs(table.density - expected) < 5 * noise + 2e-4).all()


def test_what_leaves_is_what_came(layer):
    _, table = layer
    assert np.isclose((table.density * np.diff(table.edges)).sum(), 1.0)


def test_at_index_one_and_a_half_light_goes_on_and_two_peaks_stand_beside_the_light():
    """Figure 5-11b: the peaks are the rainbows of one reflection inside."""
    table = simulate_layer(1.5, rays=4_000_000, bins=360, seed=1)
    middle = 0.5 * (table.edges[1:] + table.edges[:-1])
    ahead = np.abs(middle) > np.pi / 2
    assert (table.density[ahead] * np.diff(table.edges)[ahead]).sum() > 0.85
    # Descartes: the azimuth stands still where cos^2 of the entry is (n^2 - 1) / 3.
    entry = np.arccos(np.sqrt((1.5**2 - 1) / 3))
    rainbow = abs(4 * np.arcsin(np.sin(entry) / 1.5) - 2 * entry)
    right = (middle > 0.1) & (middle < 1.2)
    peak = middle[right][np.argmax(table.density[right])]
    assert abs(peak - rainbow) < np.radians(1.5)
    left = (middle < -0.1) & (middle > -1.2)
    peak = middle[left][np.argmax(table.density[left])]
    assert abs(peak + rainbow) < np.radians(1.5)
    level = table.density[(middle > rainbow + 0.2) & (middle < 1.2)].mean()
    assert table.density[right].max() > 3 * level


def test_a_dense_fibre_sends_more_back_than_a_thin_one():
    back = []
    for ior in (1.2, 1.5, 2.5, 3.5):
        table = simulate_layer(ior, rays=200_000, bins=60)
        middle = 0.5 * (table.edges[1:] + table.edges[:-1])
        near = np.abs(middle) < np.pi / 2
        back.append((table.density * np.diff(table.edges))[near].sum())
    assert (np.diff(back) > 0).all()


def test_the_table_is_looked_up_between_its_bins():
    table = simulate_layer(1.5, rays=10_000, bins=4)
    middle = 0.5 * (table.edges[1:] + table.edges[:-1])
    assert np.allclose([look_up(table, x) for x in middle], table.density)
    assert np.isclose(
        look_up(table, np.pi), 0.5 * (table.density[0] + table.density[-1])
    )
    assert np.isclose(look_up(table, 0.0), 0.5 * (table.density[1] + table.density[2]))


@pytest.mark.parametrize(("ior", "rays"), [(1.0, 10), (0.5, 10), (1.5, 0), (np.nan, 1)])
def test_what_does_not_refract_is_refused(ior, rays):
    with pytest.raises(ValueError, match="refracts with an index above 1"):
        simulate_layer(ior, rays=rays)
