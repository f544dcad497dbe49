"""Random settings of ``sound``, and hostile targets for the estimators that it accepts; plain NumPy, all at once.

The simulated estimator is the sampled law written down again (twist form, quaternions, implicit weight step, smooth
projection, trapezoid windows); it shares no code with `camnet.estimation` nor with the certificate.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from camnet.certification.constants import EstimatorBounds, lattice_sigma_bar, lattice_slope, sound
from camnet.certification.dwell import DwellBounds
from camnet.certification.network import default_levels
from camnet.certification.premises import contradictions
from camnet.certification.sampled import Sampling, window_error

LAYER = 0.05
LATTICE = np.array([[x, y] for x in (-0.5, 0.5) for y in (-0.5, 0.5)])


@dataclass(frozen=True)
class Setting:
    """One accepted setting with its dwell times; ``excited``: its stack is full and excited from the start."""

    bounds: EstimatorBounds
    dwell: DwellBounds
    width: float
    spacing: float
    excited: bool
    on_s: float
    off_s: float
    exit_level: float
    rows: np.ndarray | None


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def draw(rng: np.random.Generator) -> tuple[EstimatorBounds, float, float, np.ndarray, float, bool, bool]:
    """Draw bounds, spacing, width, an excited stack's rows (n, 4), radius, mobile, shared."""
    spacing = _log(rng, 0.4, 2.0)
    width = spacing * rng.uniform(0.5, 1.2)
    window, size = _log(rng, 0.1, 1.0), int(_log(rng, 4.0, 80.0))
    places = rng.uniform(-0.6, 0.6, (size, 2)) * spacing
    centres = LATTICE * spacing
    rows = window * np.exp(-0.5 * ((places[:, None] - centres) ** 2).sum(-1) / width**2)
    excitation = float(np.linalg.eigvalsh(rows.T @ rows)[0])
    inverse = 1.0 / _log(rng, 0.2, 5.0)
    sampling = Sampling(
        period_s=1.0 / _log(rng, 10.0, 60.0), slope=lattice_slope(spacing, width),
        position_noise_m=_log(rng, 1e-5, 3e-2), orientation_noise_rad=_log(rng, 1e-5, 3e-2),
        leakage=float(rng.choice([0.0, 1e-4, 1e-3, 1e-2])), switching_gain=_log(rng, 1e-3, 0.1),
        average=int(rng.integers(1, 5)),
    )  # fmt: skip
    rim = _log(rng, 0.02, 0.6) * (1.0 + LAYER)
    bounds = EstimatorBounds(
        k=_log(rng, 1.0, 10.0), kcl=_log(rng, 0.05, 5.0), gamma_inv_min=inverse, gamma_inv_max=inverse, alpha=1.0,
        window_s=max(window, sampling.period_s), stack_size=size, eps_bar=_log(rng, 1e-4, 3e-2), etadot_max=1.0,
        sigma_bar=lattice_sigma_bar(spacing, width), weight_bound=rim, lambda_min_psi=max(excitation, 1e-9),
        sampling=sampling,
    )  # fmt: skip
    return bounds, spacing, width, rows, _log(rng, 0.2, 3.0), rng.random() < 0.5, rng.random() < 0.5


def examine(rng: np.random.Generator) -> Setting | None:
    """Draw a setting and return it if ``sound`` accepts it: consistent premises and dwell times that exist."""
    bounds, spacing, width, rows, radius, mobile, shared = draw(rng)
    speed = rng.uniform(0.2, 1.1) * (bounds.weight_bound / (1 + LAYER) * bounds.sigma_bar + bounds.eps_bar)
    if contradictions(
        bounds, v_max_mps=speed, pose_rate=speed, projection_radius=bounds.weight_bound, sigma_attained=1.0,
        ideal_radius=bounds.weight_bound / (1 + LAYER),
    ):  # fmt: skip
        return None
    constants = sound(bounds, mobile=mobile)
    v_hi, v_lo = default_levels(constants, radius, None)
    if not v_lo > 0.0:
        return None
    dwell = DwellBounds(constants, v_hi, v_lo, shared_model=shared)
    excited = rng.random() < 0.5
    on = dwell.on_min(h=excited).seconds
    if on is None:
        return None
    on += 2.0 * constants.lag_s  # the simulation's periods are whole
    off = dwell.off_max(on, on, d=excited, h=excited).seconds
    if off is None:
        return None
    level = dwell.exit_level(on, on, d=excited, h=excited)
    return Setting(bounds, dwell, width, spacing, excited, on, off, level, rows if excited else None)


def multiply(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Hamilton products (S, 4)."""
    w = a[:, :1] * b[:, :1] - (a[:, 1:] * b[:, 1:]).sum(1, keepdims=True)
    v = a[:, :1] * b[:, 1:] + b[:, :1] * a[:, 1:] + np.cross(a[:, 1:], b[:, 1:])
    return np.hstack((w, v))


def exp(v: np.ndarray) -> np.ndarray:
    """Quaternions (S, 4) of rotation vectors (S, 3)."""
    angle = np.linalg.norm(v, axis=1, keepdims=True)
    return np.hstack((np.cos(0.5 * angle), 0.5 * np.sinc(0.5 * angle / np.pi) * v))


def unit(a: np.ndarray, axis: int = 1) -> np.ndarray:
    """Vectors of length 1."""
    return a / np.maximum(np.linalg.norm(a, axis=axis, keepdims=True), 1e-300)


class Trials:
    """All accepted settings, simulated side by side; columns of the weights are v (3) and w (3)."""

    def __init__(self, settings: list[Setting], rng: np.random.Generator) -> None:
        self.settings, self.rng, n = settings, rng, len(settings)
        for f in fields(EstimatorBounds):
            if f.name != "sampling":
                setattr(self, f.name, np.array([getattr(s.bounds, f.name) for s in settings], dtype=float))
        for f in fields(Sampling):
            setattr(
                self, f.name, np.array([getattr(s.bounds.sampling, f.name) for s in settings], dtype=float)
            )
        self.gamma = 1.0 / self.gamma_inv_max
        self.inner = self.weight_bound / (1.0 + LAYER)
        self.width = np.array([s.width for s in settings])
        self.centres = np.array([s.spacing for s in settings])[:, None, None] * LATTICE
        self.excited = np.array([s.excited for s in settings])
        self.w = np.zeros((n, 4, 6))
        self.w[:, :, [0, 1, 5]] = rng.standard_normal((n, 4, 3))
        self.w *= (self.inner / np.linalg.norm(self.w, axis=(1, 2)))[:, None, None]
        self.w_hat = -self.w.copy()
        self.p = rng.uniform(-0.5, 0.5, (n, 3)) * self.centres[:, -1:, 0]
        self.p[:, 2] = 0.0
        self.q = np.zeros((n, 4))
        self.q[:, 0] = 1.0
        self._fill(rng)
        self._first = True
        self.p_hat, self.q_hat = self.p.copy(), self.q.copy()

    def _fill(self, rng: np.random.Generator) -> None:
        """Full stacks of the excited settings, each window off by its largest error in the worst direction."""
        n, self.size = len(self.settings), int(self.stack_size.max())
        self.rows = np.zeros((n, self.size, 4))
        self.increments = np.zeros((n, self.size, 6))
        for i, s in enumerate(self.settings):
            if s.rows is None:
                continue
            b, k = s.bounds, len(s.rows)
            speed = b.weight_bound * b.sigma_bar + b.eps_bar
            worst = window_error(
                b.sampling, window_s=b.window_s, weight_bound=b.weight_bound, eps_bar=b.eps_bar, speed=speed
            )
            self.rows[i, :k] = s.rows
            self.increments[i, :k] = s.rows @ self.w[i] - worst * unit(s.rows @ self.w[i])
        self.held = np.zeros(n, dtype=int)
        self._sums()

    def _sums(self) -> None:
        self.psi = np.einsum("nki,nkj->nij", self.rows, self.rows)
        self.moment = np.einsum("nki,nkj->nij", self.rows, self.increments)

    def sigma(self, p: np.ndarray) -> np.ndarray:
        """Kernels (S, 4)."""
        return np.exp(-0.5 * ((p[:, None, :2] - self.centres) ** 2).sum(-1) / self.width[:, None] ** 2)

    def error(self) -> np.ndarray:
        """eta_til (S, 7), the quaternion's sign that of the estimate."""
        sign = np.where((self.q * self.q_hat).sum(1, keepdims=True) < 0.0, -1.0, 1.0)
        return np.hstack((self.p - self.p_hat, sign * self.q - self.q_hat))

    def value(self) -> np.ndarray:
        """V (S,)."""
        weights = ((self.w - self.w_hat) ** 2).sum((1, 2))
        return 0.5 * (self.error() ** 2).sum(1) + 0.5 * self.gamma_inv_max * weights

    def move(self, parts: int = 4) -> None:
        """Advance the target by one period, its residual along the error."""
        h = (self.period_s / parts)[:, None]
        for _ in range(parts):
            push = self.eps_bar[:, None] * unit(
                self.error()[:, :3] + 1e-9 * self.rng.standard_normal(self.p.shape)
            )
            push[:, 2] = 0.0
            rate = np.einsum("ni,nio->no", self.sigma(self.p), self.w)
            middle = self.p + 0.5 * h * (rate[:, :3] + push)
            rate = np.einsum("ni,nio->no", self.sigma(middle), self.w)
            self.p = self.p + h * (rate[:, :3] + push)
            self.q = unit(multiply(self.q, exp(h * rate[:, 3:])))

    def measure(self) -> tuple[np.ndarray, np.ndarray]:
        """Noisy poses at the bound: half of them pull the estimate away, half are random."""
        x, n = self.error(), len(self.settings)
        away = (self.rng.random((n, 1)) < 0.5).astype(float)
        noise = unit(self.rng.standard_normal((n, 3)) - 50.0 * away * unit(x[:, :3]))
        turn = unit(self.rng.standard_normal((n, 3)))
        p = self.p + self.position_noise_m[:, None] * noise
        q = multiply(self.q, exp(self.orientation_noise_rad[:, None] * turn))
        sign = np.where((q * self.q_hat).sum(1, keepdims=True) < 0.0, -1.0, 1.0)
        return p, sign * q

    def learn(self, on: np.ndarray, sigma: np.ndarray | None, output: np.ndarray | None) -> None:
        """The implicit weight step and the smooth projection where ``on`` (S,)."""
        rate = self.period_s * self.gamma
        right = self.w_hat + (rate * self.kcl)[:, None, None] * self.moment
        if sigma is not None:
            right = right + rate[:, None, None] * sigma[:, :, None] * output[:, None, :]
        eye = np.eye(4)
        matrix = eye + (rate * self.kcl)[:, None, None] * (self.psi + self.leakage[:, None, None] * eye)
        after = np.linalg.solve(matrix, right)
        norm2 = (self.w_hat**2).sum((1, 2))
        outward = (self.w_hat * (after - self.w_hat)).sum((1, 2))
        layer = LAYER * self.inner
        c = np.clip((norm2 - self.inner**2) / (layer**2 + 2.0 * layer * self.inner), 0.0, 1.0)
        c = np.where((norm2 > self.inner**2) & (outward > 0.0), c * outward / np.maximum(norm2, 1e-300), 0.0)
        after = after - c[:, None, None] * self.w_hat
        length = np.linalg.norm(after, axis=(1, 2))
        after *= np.minimum(1.0, self.weight_bound / np.maximum(length, 1e-300))[:, None, None]
        self.w_hat = np.where(on[:, None, None], after, self.w_hat)

    def restart(self, who: np.ndarray, fresh_models: np.ndarray) -> None:
        """Put the pose at a measurement; models of another region begin at the far side of the ball."""
        p, q = self.measure()
        self.p_hat, self.q_hat = np.where(who[:, None], p, self.p_hat), np.where(who[:, None], q, self.q_hat)
        other = -self.w * (self.weight_bound / self.inner)[:, None, None]
        self.w_hat = np.where((who & fresh_models)[:, None, None], other, self.w_hat)
        self.samples = getattr(self, "samples", [[] for _ in self.settings])
        for i in np.flatnonzero(who):
            self.samples[i] = [(p[i], q[i])]

    def seen(self, who: np.ndarray) -> None:
        """One step with feedback where ``who``; the target has moved already."""
        t = self.period_s[:, None]
        p, q = self.measure()
        sigma = self.sigma(p)
        twist = np.einsum("ni,nio->no", sigma, self.w_hat)
        p_hat = self.p_hat + t * twist[:, :3]
        zero = np.zeros((len(p), 1))
        q_hat = unit(self.q_hat + 0.5 * t * multiply(self.q_hat, np.hstack((zero, twist[:, 3:]))))
        q = np.where((q * q_hat).sum(1, keepdims=True) < 0.0, -q, q)
        e_p, e_q = p - p_hat, q - q_hat
        share, gain = (
            -np.expm1(-self.k * self.period_s)[:, None],
            (self.period_s * self.switching_gain)[:, None],
        )
        conjugate = q * np.array([1.0, -1.0, -1.0, -1.0])
        output = np.hstack((e_p, 0.5 * multiply(conjugate, e_q)[:, 1:]))
        p_hat = p_hat + share * e_p + gain * np.sign(e_p)
        q_hat = unit(q_hat + share * e_q + gain * np.sign(e_q))
        self.p_hat = np.where(who[:, None], p_hat, self.p_hat)
        self.q_hat = np.where(who[:, None], q_hat, self.q_hat)
        self.learn(who, sigma, output)
        self._collect(who & ~self.excited, p, q)

    def _collect(self, who: np.ndarray, p: np.ndarray, q: np.ndarray) -> None:
        """Windows of the settings that start with an empty stack."""
        changed = False
        for i in np.flatnonzero(who):
            kept = self.samples[i]
            kept.append((p[i], q[i]))
            span = max(1, int(self.window_s[i] / self.period_s[i]))
            if len(kept) <= span:
                continue
            places = np.array([s[0] for s in kept])
            s = np.exp(-0.5 * ((places[:, None, :2] - self.centres[i]) ** 2).sum(-1) / self.width[i] ** 2)
            row = self.period_s[i] * (s.sum(0) - 0.5 * (s[0] + s[-1]))
            first, last = kept[0][1], kept[-1][1]
            turn = multiply((first * np.array([1.0, -1.0, -1.0, -1.0]))[None], last[None])[0]
            turn = turn if turn[0] >= 0.0 else -turn
            angle = 2.0 * np.arctan2(np.linalg.norm(turn[1:]), turn[0])
            j = self.held[i] % int(self.stack_size[i])
            self.rows[i, j] = row
            self.increments[i, j] = np.r_[places[-1] - places[0], angle * unit(turn[1:], 0)]
            self.held[i] += 1
            self.samples[i] = [kept[-1]]
            changed = True
        if changed:
            self._sums()

    def unseen(self, who: np.ndarray) -> None:
        """One step of the predictor where ``who``: midpoint rule."""
        h = self.period_s[:, None]
        middle = self.p_hat + 0.5 * h * np.einsum("ni,nio->no", self.sigma(self.p_hat), self.w_hat)[:, :3]
        twist = np.einsum("ni,nio->no", self.sigma(middle), self.w_hat)
        self.p_hat = np.where(who[:, None], self.p_hat + h * twist[:, :3], self.p_hat)
        self.q_hat = np.where(who[:, None], unit(multiply(self.q_hat, exp(h * twist[:, 3:]))), self.q_hat)
        self.learn(who, None, None)


def attack(
    settings: list[Setting], rng: np.random.Generator, visits: int = 2, steps: int = 1500
) -> dict[str, float]:
    """Fly every setting through visits and gaps of just the lengths allowed; count what breaks."""
    trials = Trials(settings, rng)
    period = trials.period_s
    on = np.array([s.on_s for s in settings])
    off = np.array([s.off_s for s in settings])
    n_on = np.maximum(
        1, np.ceil(on / period - 1e-9).astype(int)
    )  # samples in view, the first one restarts the pose
    n_off = np.maximum(0, np.floor(off / period + 1e-9).astype(int))
    own = np.array([not s.dwell.shared_model for s in settings])
    v_hi = np.array([s.dwell.v_hi for s in settings])
    level = np.array([s.exit_level for s in settings])
    cycle, worst_off, worst_exit = n_on + n_off, np.zeros(len(settings)), np.zeros(len(settings))
    gaps, total = np.zeros(len(settings), dtype=int), visits * cycle
    for step in range(int(min(steps, total.max()))):
        phase, active = step % cycle, step < total
        first, view = active & (phase == 0), active & (phase < n_on)
        if step:
            trials.move()
        if first.any():
            trials.restart(first, own & (np.arange(1) * 0 + step > 0))
        if (view & ~first).any():
            trials.seen(view & ~first)
        if (active & ~view).any():
            trials.unseen(active & ~view)
        value = trials.value()
        ends = view & (phase == n_on - 1)
        worst_exit = np.where(ends, np.maximum(worst_exit, value / level), worst_exit)
        gone = active & ~view
        worst_off = np.where(gone, np.maximum(worst_off, value / v_hi), worst_off)
        gaps += gone & (phase == cycle - 1)
    return {
        "settings": len(settings),
        "flown": int((gaps > 0).sum()),
        "gaps": int(gaps.sum()),
        "violations": int(((worst_off > 1.0) | (worst_exit > 1.0)).sum()),
        "closest": float(max(worst_off.max(), worst_exit.max())),
        "long": int((off > 0.1).sum()),
    }


def accepted(count: int, seed: int) -> list[Setting]:
    """Those of ``count`` random settings that ``sound`` accepts."""
    rng = np.random.default_rng(seed)
    found = [examine(rng) for _ in range(count)]
    return [s for s in found if s is not None]
