"""``instruments.png``: the Lyapunov analysis along a run as papers draw it, shaded where nobody sees the target."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from camnet.report.run_data import RunData, spans
from camnet.report.style import UNSEEN, figure_style, plain_ticks, save

__all__ = ["has_instruments", "write_instruments"]

#: the switching signals, and what they say
_SIGNALS = (("sigma_f", "feedback"), ("sigma_d", "excited"), ("sigma_h", "excited before"))


def has_instruments(run: RunData) -> bool:
    """Whether the run logged them."""
    return f"{run.targets[0]}.V" in run.columns


def write_instruments(run: RunData, path: Path) -> None:
    """Plot V, the weights' norm, the stack's least eigenvalue and the switching signals of the first target."""
    who = run.targets[0]
    with figure_style():
        figure = Figure(figsize=(12, 9))
        axes = figure.subplots(
            4, 1, sharex=True, gridspec_kw={"hspace": 0.16, "height_ratios": [3, 2, 2, 1.6]}
        )
        for a in axes:
            for start, end in spans(run.t_s, run.columns[f"{who}.seen_by"] < 0):
                a.axvspan(start, end, color=UNSEEN, zorder=0, linewidth=0)
        _curves(
            axes[0],
            run,
            who,
            (("V", "V, against the weights at the end"), ("V_pose", "its part of the pose")),
        )
        axes[0].set_ylabel("V")
        axes[1].plot(run.t_s, run.columns[f"{who}.W_hat"], color="#0072b2", linewidth=1.2)
        axes[1].set_ylabel("norm of the\nweights in force")
        reached = ("psi_min_visited_s2", "over the kernels that data reached")
        stacks = (reached, ("psi_min_s2", "over all kernels, (3-19)"))
        _curves(axes[2], run, who, stacks)
        axes[2].set_ylabel("least eigenvalue of\nthe stack (s\u00b2)")
        _switches(axes[3], run, who)
        axes[3].set_xlabel("time (s)")
        axes[3].set_xlim(run.t_s[0], run.t_s[-1])
        figure.legend(
            [Patch(color=UNSEEN)],
            ["nobody sees it"],
            loc="upper center",
            bbox_to_anchor=(0.5, 0.94),
            fontsize=9,
        )
        save(figure, path)


def _curves(axes: Axes, run: RunData, who: str, which: tuple[tuple[str, str], ...]) -> None:
    """Draw positive quantities on a logarithmic scale; what is 0 leaves a gap."""
    for (name, label), colour in zip(which, ("#c1121f", "#3a5ba0"), strict=True):
        value = run.columns[f"{who}.{name}"]
        shown = np.where(value > 1e-12, value, np.nan)
        if np.isfinite(shown).any():
            axes.semilogy(run.t_s, shown, color=colour, linewidth=1.2, label=label)
        else:
            axes.plot([], [], color=colour, label=f"{label}: 0 throughout")
    if axes.get_yscale() == "log":
        plain_ticks(axes)
    else:
        axes.set_yticks([])
    axes.legend(loc="upper right", fontsize=8)


def _switches(axes: Axes, run: RunData, who: str) -> None:
    for k, (name, _) in enumerate(_SIGNALS):
        on = run.columns[f"{who}.{name}"]
        axes.fill_between(run.t_s, 2.0 - k, 2.0 - k + 0.8 * on, step="post", color="#009e73", linewidth=0)
    axes.set(yticks=[2.4 - k for k in range(3)], ylim=(-0.1, 3.0))
    axes.set_yticklabels([f"{name.replace('_', '^')}, {words}" for name, words in _SIGNALS])
    axes.grid(visible=False, axis="y")
