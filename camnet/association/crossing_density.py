r"""How likely an entry belongs to an exit: a kernel estimate of the hazard of coming back, from everybody's crossings.

| symbol | name | shape | unit |
| --- | --- | --- | --- |
| x_i, v_i, t_i | an exit: place, velocity, time | (2,), (2,), - | m, m/s, s |
| y_j, u_j, t_j | an entry: place, velocity, time | (2,), (2,), - | m, m/s, s |
| w_il | weight of lesson l for exit i, `Lessons.penalty` c_l | - | |
| f_i(t, y) | density of coming back after ``t`` at ``y`` | - | 1/(s m^2) |
| S_i(t) | share that is still away after ``t`` | - | |

``w_il = exp(-(|x_i - x_l|^2 / s_x^2 + |v_i - v_l|^2 / s_v^2 + c_l) / 2)``: Gaussian kernels of Nadaraya (1964).

``f_i(t, y) = (1 - b) sum_l w_il k_t(t, t_l) k_y(y, y_l + c (x_i - x_l)) / sum_l w_il + b f_0``, with k_t normal in
the logarithm of the time. Lessons that never came back are censored: they stand in the sum of the weights and in
``S_i``, the weighted share of lessons that lasted longer (Beran 1981, the conditional survival function).

Of all exits that are open when an entry happens, the entry is of exit i with probability proportional to the *hazard*
``f_i(t_j - t_i, y_j) / S_i(t_j - t_i)``: that nobody has come back so far is known of each of them, and only the
hazard is left of the likelihood (competing risks, Prentice et al. 1978, eq. 2.3). A density given the elapsed time,
without the hazard of that time, forgets that somebody who is away for ten minutes hardly ever comes back just now.

``f_0`` is what stands in where there is no lesson: the exit velocity, fading, in a circle that grows with time, and
the durations of all lessons.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from camnet.association.settings import DensitySettings
from camnet.compiled import cached_njit
from camnet.types import Array, BoolArray, IntArray

__all__ = ["Ends", "Lessons", "PairDensity", "pair_densities"]

_FAR = 36.0  # squared scaled distance at which a lesson no longer counts: exp(-18)


@dataclass(frozen=True, eq=False, slots=True)
class Ends:
    """Exits or entries of tracklets.

    Attributes
    ----------
    t_s : (n,) times, s
    p_world, v_world : (n, 2) place, m, and velocity, m/s
    moving : (n,) whether the velocity is known
    owner : (n,) who teaches what: lessons of the same owner are left out where that is asked for
    """

    t_s: Array
    p_world: Array
    v_world: Array
    moving: BoolArray
    owner: IntArray


@dataclass(frozen=True, eq=False, slots=True)
class Lessons:
    """Crossings to learn from, in the order in which they became known.

    Attributes
    ----------
    start, start_v, end, end_v : (n, 2) exit and entry, m and m/s; the entry is of no meaning where it never came
    duration_s : (n,) time away, or time after which nobody looked any more
    returned : (n,) whether the entry came
    penalty : (n,) added to a lesson's squared distance
    weight : (n,) how much a lesson counts, 1 for a certain one
    known_s : (n,) ascending
    owner : (n,) whose crossing it was
    """

    start: Array
    start_v: Array
    end: Array
    end_v: Array
    duration_s: Array
    returned: BoolArray
    penalty: Array
    weight: Array
    known_s: Array
    owner: IntArray

    def __len__(self) -> int:
        return len(self.duration_s)

    @staticmethod
    def of(
        exits: Ends, entries: Ends, returned: BoolArray, weight: Array, reversed_penalty: float
    ) -> Lessons:
        """Lessons of pairs (n,) of exits and entries, and of each crossing told backwards.

        Where ``returned`` is false the entry holds only the time at which looking ended.
        """
        back = np.flatnonzero(returned)
        both = np.concatenate([np.arange(len(exits.t_s)), back])
        n = len(exits.t_s)
        flipped = np.arange(len(both)) >= n
        side = flipped[:, None]
        start = np.where(side, entries.p_world[both], exits.p_world[both])
        end = np.where(side, exits.p_world[both], entries.p_world[both])
        start_v = np.where(side, -entries.v_world[both], exits.v_world[both])
        end_v = np.where(side, -exits.v_world[both], entries.v_world[both])
        duration = np.maximum(entries.t_s[both] - exits.t_s[both], 1e-3)
        penalty = np.where(flipped, reversed_penalty, 0.0)
        known = entries.t_s[both]
        order = np.argsort(known, kind="stable")
        columns = (start, start_v, end, end_v, duration, returned[both], penalty, weight[both], known)
        return Lessons(*(column[order] for column in (*columns, exits.owner[both])))


@dataclass(frozen=True, eq=False, slots=True)
class PairDensity:
    """What is known of each pair of an exit and an entry.

    Attributes
    ----------
    log_f : (m,) logarithm of f_i(t, y)
    log_s : (m,) logarithm of S_i(t), the share still away just before
    log_u : (m,) logarithm of the density of the entry's velocity, given pair and place, 1/(m/s)^2; 0 where unknown
    """

    log_f: Array
    log_s: Array
    log_u: Array

    @property
    def log_hazard(self) -> Array:
        """Logarithm (m,) of ``f / S``."""
        return self.log_f - self.log_s


def pair_densities(
    exits: Ends,
    entries: Ends,
    pairs: tuple[IntArray, IntArray],
    lessons: Lessons,
    settings: DensitySettings,
    strictly_earlier: bool,
) -> PairDensity:
    """Densities of pairs.

    Parameters
    ----------
    exits, entries : n exits, k entries
    pairs : indices (m,) of exits, ascending, and (m,) of entries; each entry is later than its exit
    lessons : what is learned from
    settings : scales
    strictly_earlier : use what was known before the entry, of anybody; else what others than the exit's owner taught,
        whenever that was
    """
    which, to = pairs
    dt = np.maximum(entries.t_s[to] - exits.t_s[which], 1e-3)
    starts = np.searchsorted(which, np.arange(len(exits.t_s) + 1))
    out = np.zeros((len(which), 3))
    mean, spread = _durations(lessons)
    s = settings
    widths = np.hypot(s.log_time_scale, s.time_floor_s / lessons.duration_s)
    _fill(
        starts,
        to,
        dt,
        (exits.p_world, exits.v_world, exits.owner, exits.t_s),
        (entries.p_world, entries.v_world, entries.moving, entries.t_s),
        (lessons.start, lessons.start_v, lessons.end, lessons.end_v, np.log(lessons.duration_s), widths),
        (lessons.returned, lessons.penalty, lessons.weight, lessons.known_s, lessons.owner),
        (s.position_scale_m, s.velocity_scale_mps, s.place_scale_m, s.turn_scale_mps, s.carry),
        (s.prior_weight, s.prior_memory_s, s.prior_spread_m, s.prior_growth_mps, mean, spread),
        (s.recency_bonus, s.recency_s),
        strictly_earlier,
        out,
    )
    return PairDensity(out[:, 0], out[:, 1], out[:, 2])


def _durations(lessons: Lessons) -> tuple[float, float]:
    """Mean and standard deviation of the logarithm of the durations of those who came back."""
    logs = np.log(lessons.duration_s[lessons.returned])
    if len(logs) < 2:
        return math.log(60.0), 1.0
    return float(logs.mean()), max(float(logs.std()), 0.3)


@cached_njit
def _normal_tail(z: float) -> float:
    return 0.5 * math.erfc(z / math.sqrt(2.0))


@cached_njit
def _circle(r2: float, s: float) -> float:
    return math.exp(-0.5 * r2 / s**2) / (2.0 * math.pi * s**2)


@cached_njit
def _fill(starts, to, dt, exits, entries, ends, marks, scales, prior, recent, earlier, out) -> None:  # type: ignore[no-untyped-def] # noqa: ANN001
    """Densities of every pair, exit by exit: the lessons near an exit are found once."""
    x, v, owner, t_exit = exits
    y, u, moving, t_entry = entries
    l_start, l_v, l_end, l_u, l_log, l_wide = ends
    returned, penalty, weight, known, l_owner = marks
    sx, sv, sy, su, carry = scales
    near = np.zeros(len(penalty), np.int64)
    w = np.zeros(len(penalty))
    for i in range(len(x)):
        if starts[i] == starts[i + 1]:
            continue
        n = 0
        for k in range(len(penalty)):
            if not earlier and l_owner[k] == owner[i]:
                continue
            d = ((x[i, 0] - l_start[k, 0]) ** 2 + (x[i, 1] - l_start[k, 1]) ** 2) / sx**2
            if d > _FAR:
                continue
            d += ((v[i, 0] - l_v[k, 0]) ** 2 + (v[i, 1] - l_v[k, 1]) ** 2) / sv**2 + penalty[k]
            if d > _FAR:
                continue
            d -= recent[0] * math.exp(-abs(t_exit[i] - known[k]) / recent[1])
            near[n] = k
            w[n] = weight[k] * math.exp(-0.5 * d)
            n += 1
        for m in range(starts[i], starts[i + 1]):
            j, log_dt = to[m], math.log(dt[m])
            total, away, f, f_u = 0.0, 0.0, 0.0, 0.0
            for a in range(n):
                k = near[a]
                if earlier and known[k] >= t_entry[j]:
                    break
                wide = l_wide[k]
                z = (log_dt - l_log[k]) / wide
                total += w[a]
                if z < 5.0:
                    away += w[a] * (_normal_tail(z) if z > -5.0 else 1.0)
                if not returned[k] or abs(z) > 5.0:
                    continue
                k_t = math.exp(-0.5 * z * z) / (math.sqrt(2.0 * math.pi) * wide * dt[m])
                r2 = (y[j, 0] - l_end[k, 0] - carry * (x[i, 0] - l_start[k, 0])) ** 2
                r2 += (y[j, 1] - l_end[k, 1] - carry * (x[i, 1] - l_start[k, 1])) ** 2
                term = w[a] * k_t * (0.85 * _circle(r2, sy) + 0.15 * _circle(r2, 4.0 * sy))
                f += term
                g2 = (u[j, 0] - l_u[k, 0]) ** 2 + (u[j, 1] - l_u[k, 1]) ** 2
                f_u += term * (0.8 * _circle(g2, su) + 0.2 * _circle(g2, 3.0 * su))
            out[m, 0], out[m, 1], out[m, 2] = _with_prior(
                x[i], v[i], y[j], u[j], dt[m], (total, away, f, f_u), prior, su, moving[j]
            )


@cached_njit
def _with_prior(x, v, y, u, dt, sums, prior, su, moving):  # type: ignore[no-untyped-def] # noqa: ANN001, ANN202
    """Logarithms of f, S and the velocity's density, with ``f_0`` as one more lesson."""
    total, away, f, f_u = sums
    b, memory, spread, growth, mean, deviation = prior
    z = (math.log(dt) - mean) / deviation
    reach = memory * (1.0 - math.exp(-dt / memory))
    r2 = (y[0] - x[0] - reach * v[0]) ** 2 + (y[1] - x[1] - reach * v[1]) ** 2
    s = spread + growth * dt
    first = math.exp(-0.5 * z * z) / (math.sqrt(2.0 * math.pi) * deviation * dt)
    first *= 0.9 * _circle(r2, s) + 0.1 * _circle(r2, 4.0 * s)
    speed2 = u[0] ** 2 + u[1] ** 2
    f_u += b * first * _circle(speed2, 3.0 * su)
    f += b * first
    away += b * _normal_tail(z)
    total += b
    log_f = math.log(f / total + 1e-30)
    log_u = math.log(max(f_u, 1e-300) / max(f, 1e-300)) if moving else 0.0
    return log_f, math.log(away / total + 1e-6), max(log_u, -20.0)
