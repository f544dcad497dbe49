"""The monitor's kernels against plain NumPy written from the monitor's text."""

from __future__ import annotations

import numpy as np

from camnet.control.monitor_kernel import advance_envelopes, realised_disturbance, row_norms, without_slip
from camnet.geometry import rotations

RNG = np.random.default_rng(0)
N, DT = 5, 0.02


def quaternions() -> np.ndarray:
    return rotations.normalise(RNG.normal(size=(N, 4)))


def test_disturbance_is_motion_less_command() -> None:
    p0, p1, u_l, u_a = (RNG.normal(size=(N, 3)) for _ in range(4))
    q0, out = quaternions(), np.empty((N, 6))
    rate = RNG.normal(size=(N, 3))
    q1 = -rotations.multiply(q0, rotations.exp(rate * DT))  # the other sign: the same orientation
    norms = realised_disturbance(p0, q0, p1, q1, u_l, u_a, DT, out)
    np.testing.assert_allclose(out, np.hstack([(p1 - p0) / DT - u_l, rate - u_a]), atol=1e-9)
    np.testing.assert_allclose(
        norms, [np.linalg.norm(out[:, :3], axis=1), np.linalg.norm(out[:, 3:], axis=1)]
    )


def test_slip_is_taken_off_in_the_cameras_frame() -> None:
    d, p0, p1, v, w = RNG.normal(size=(N, 6)), *(RNG.normal(size=(N, 3)) for _ in range(4))
    q0, q_then, q_now = quaternions(), quaternions(), quaternions()
    rate = rotations.log(rotations.multiply(rotations.conjugate(q_then), q_now)) / DT - w
    in_camera = rotations.rotate(rotations.conjugate(q0), rotations.rotate(q_then, rate))
    expected = [
        np.linalg.norm(d[:, :3] - ((p1 - p0) / DT - v), axis=1),
        np.linalg.norm(d[:, 3:] - in_camera, axis=1),
    ]
    np.testing.assert_allclose(without_slip(d, q0, p0, q_then, v, w, p1, q_now, DT), expected, rtol=1e-9)


def test_envelopes_follow_their_recursion() -> None:
    a2, b, d = (RNG.uniform(0.1, 1.0, size=(2, N)) for _ in range(3))
    d_bar, layer, k1 = np.array([0.3, 0.5]), np.array([0.01, 0.02]), 2.0
    held = 0.5 * DT * (d + np.sqrt(3.0) * d_bar[:, None]) ** 2
    a2_next = a2 * np.exp(-2 * k1 * DT) + 2 * DT * (layer[:, None] + held)
    b_next = b * np.exp(-k1 * DT) + DT * np.maximum(d - d_bar[:, None], 0.0)
    bound = advance_envelopes(a2, b, d, d_bar, layer, k1, DT)
    np.testing.assert_allclose(a2, a2_next)
    np.testing.assert_allclose(b, b_next)
    np.testing.assert_allclose(bound, np.sqrt(a2_next) + b_next)


def test_row_norms() -> None:
    v = RNG.normal(size=(N, 3))
    np.testing.assert_allclose(row_norms(v), np.linalg.norm(v, axis=1))
