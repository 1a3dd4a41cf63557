import numpy as np

from lookdev.light.mapping import direction_to_uv, rotate_z, uv_to_direction


def test_known_directions() -> None:
    uvs = {(1, 0, 0): (0.5, 0.5), (0, 1, 0): (0.25, 0.5), (0, -1, 0): (0.75, 0.5), (1, 0, 1): (0.5, 0.75)}
    for direction, uv in (uvs | {(1, 0, -1): (0.5, 0.25)}).items():
        np.testing.assert_allclose(direction_to_uv(direction), uv, atol=1e-15)
        np.testing.assert_allclose(uv_to_direction(uv), direction / np.linalg.norm(direction), atol=1e-15)


def test_poles_are_finite_and_exact() -> None:
    assert direction_to_uv([[0, 0, 1], [0, 0, -1]])[:, 1].tolist() == [1.0, 0.0]
    # Both poles must be exact: sin(pi) in float64 is 1.2e-16, so that angles are measured from the nearer pole.
    np.testing.assert_array_equal(uv_to_direction([[0.3, 1.0], [0.7, 0.0]]), [[0, 0, 1], [0, 0, -1]])


def test_round_trip_of_random_directions_and_u_is_periodic() -> None:
    rng = np.random.default_rng(1)
    direction = rng.normal(size=(4, 1000, 3))
    direction[0, :, :2] *= 1e-9  # close to the poles
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    uv = direction_to_uv(direction)
    assert ((uv >= 0.0) & (uv <= 1.0)).all()
    # atan2 and its inverse round a few times in units of pi.
    np.testing.assert_allclose(uv_to_direction(uv), direction, atol=2e-15)
    np.testing.assert_allclose(uv_to_direction(uv + np.array([1.0, 0.0])), direction, atol=4e-15)


def test_rotation_about_z() -> None:
    np.testing.assert_allclose(rotate_z([1, 0, 0.5], 90), [0, 1, 0.5], atol=1e-15)
    both = rotate_z([1.0, 2.0, 3.0], [[0.0], [360.0]])
    np.testing.assert_allclose(both, np.broadcast_to([1.0, 2.0, 3.0], (2, 1, 3)), atol=1e-14)
    # A rotation of the world by +36 degrees moves texels from u to u - 0.1.
    uv = direction_to_uv(rotate_z(uv_to_direction([0.5, 0.7]), 36.0))
    np.testing.assert_allclose(uv, [0.4, 0.7], atol=1e-15)
