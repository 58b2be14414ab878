"""Integration and differentiation of height maps."""

from __future__ import annotations

import numpy as np
import pytest

from intaglio import InputError, gradients_from_height, height_from_gradients, integrability


def waves(height=24, width=35):
    """A height map that repeats, and its exact gradients; y is upwards."""
    row, column = np.mgrid[:height, :width].astype(float)
    y = -row
    u, v = 2 * np.pi * 2 / width, 2 * np.pi * 3 / height
    z = np.sin(u * column) + 0.5 * np.cos(v * y + 0.4) + 0.3 * np.sin(u * column + v * y)
    p = u * np.cos(u * column) + 0.3 * u * np.cos(u * column + v * y)
    q = -0.5 * v * np.sin(v * y + 0.4) + 0.3 * v * np.cos(u * column + v * y)
    return z, p, q


@pytest.mark.parametrize("shape", [(24, 35), (25, 36), (24, 36), (25, 35)])
def test_fourier_is_exact_on_waves(shape):
    z, p, q = waves(*shape)
    np.testing.assert_allclose(height_from_gradients(p, q), z - z.mean(), atol=1e-12)
    found = gradients_from_height(z, slope=(0, 0))
    np.testing.assert_allclose(found[0], p, atol=1e-12)
    np.testing.assert_allclose(found[1], q, atol=1e-12)


@pytest.mark.parametrize("method", ["fourier", "cosine"])
def test_a_plane_in_a_plane_out(method):
    p, q = np.full((9, 14), 0.3), np.full((9, 14), -0.2)
    z = height_from_gradients(p, q, method=method)
    np.testing.assert_allclose(np.diff(z, axis=1), 0.3, atol=1e-12)
    np.testing.assert_allclose(-np.diff(z, axis=0), -0.2, atol=1e-12)
    assert abs(z.mean()) < 1e-12
    for way in ("fourier", "forward"):
        back = gradients_from_height(z, method=way)
        np.testing.assert_allclose(back[0], 0.3, atol=1e-12)
        np.testing.assert_allclose(back[1], -0.2, atol=1e-12)


def test_cosine_is_exact_on_a_paraboloid():
    """Between neighbours the mean of linear gradients is the exact difference; nothing repeats, and the border is right."""
    row, column = np.mgrid[:13, :20].astype(float)
    x, y = column - 8, 5 - row
    z = 0.02 * x**2 - 0.03 * y**2 + 0.01 * x * y + 0.5 * x
    p, q = 0.04 * x + 0.01 * y + 0.5, -0.06 * y + 0.01 * x
    np.testing.assert_allclose(height_from_gradients(p, q, method="cosine"), z - z.mean(), atol=1e-11)
    # The repeating solution is far off at the border.
    assert np.abs(height_from_gradients(p, q) - (z - z.mean())).max() > 0.1


def test_forward_differences_are_the_thesis_ones():
    z = np.random.default_rng(0).normal(size=(6, 7))
    p, q = gradients_from_height(z, method="forward")
    np.testing.assert_array_equal(p[:, :-1], z[:, 1:] - z[:, :-1])
    np.testing.assert_array_equal(q[1:], z[:-1] - z[1:])
    np.testing.assert_array_equal(p[:, -1], p[:, -2])
    np.testing.assert_array_equal(q[0], q[1])


def test_integration_is_the_nearest_surface():
    """No other height map comes closer to noisy gradients: any change of it makes the residual larger."""
    rng = np.random.default_rng(1)
    p, q = rng.normal(size=(2, 12, 15))
    p, q = p - p.mean(), q - q.mean()
    z = height_from_gradients(p, q)

    def away(s):
        a, b = gradients_from_height(s, slope=(0, 0))
        return ((a - p) ** 2).sum() + ((b - q) ** 2).sum()

    for _ in range(5):
        assert away(z + 0.01 * rng.normal(size=z.shape)) > away(z)


def test_integrability():
    _, p, q = waves()
    assert integrability(p, q).residual < 1e-12
    row, column = np.mgrid[:24, :35].astype(float)
    swirl = np.sin(2 * np.pi * row / 24), np.sin(2 * np.pi * 2 * column / 35)
    assert integrability(*swirl).residual == pytest.approx(1.0, abs=1e-9)
    mixed = integrability(p + swirl[0], q + swirl[1])
    np.testing.assert_allclose(mixed.p, p, atol=1e-9)
    np.testing.assert_allclose(mixed.q, q, atol=1e-9)
    flat = integrability(np.zeros((5, 5)), np.zeros((5, 5)))
    assert flat.residual == 0


@pytest.mark.parametrize("shape", [(1, 1), (1, 6), (6, 1), (2, 2)])
def test_tiny_maps(shape):
    p, q = np.full(shape, 0.5), np.full(shape, 0.25)
    for method in ("fourier", "cosine"):
        assert np.isfinite(height_from_gradients(p, q, method=method)).all()
    for method in ("fourier", "forward"):
        assert np.isfinite(gradients_from_height(p, method=method)).all()


@pytest.mark.parametrize(
    ("p", "q", "message"),
    [
        (np.zeros((3, 4)), np.zeros((4, 3)), "one shape"),
        (np.zeros(3), np.zeros(3), "one shape"),
        (np.zeros((0, 3)), np.zeros((0, 3)), "one shape"),
        (np.full((3, 3), np.nan), np.zeros((3, 3)), "not finite"),
        ("a", "b", "not arrays of numbers"),
    ],
)
def test_bad_gradients(p, q, message):
    with pytest.raises(InputError, match=message):
        height_from_gradients(p, q)
    with pytest.raises(InputError, match="known: fourier, cosine"):
        height_from_gradients(np.zeros((3, 3)), np.zeros((3, 3)), method="x")
