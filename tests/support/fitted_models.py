"""Learned models without a run: the world's own motion, fitted."""

from __future__ import annotations

import numpy as np

from camnet.experiments.certify_flow import true_velocity
from camnet.experiments.certify_world import nominal_path
from camnet.experiments.learned_model import LearnedModel


def fitted_model(network):
    """The world's own motion, fitted by least squares in a band about the path: a model without a run."""
    t, path = nominal_path(network, 160.0)
    path, t = path[::4], t[::4]
    inside = np.array([region.contains(np.c_[path, np.full(len(path), 0.3)]) for region in network.regions])
    seen = np.where(inside.any(axis=0), inside.argmax(axis=0), -1)
    along = np.gradient(path, axis=0)
    across = np.c_[-along[:, 1], along[:, 0]] / np.linalg.norm(along, axis=1, keepdims=True)
    band = np.concatenate([path + s * across for s in (-0.1, 0.0, 0.1)])
    delta = band[:, None] - network.basis.centres
    sigma = np.exp(-0.5 * np.einsum("nki,kij,nkj->nk", delta, network.basis.precision, delta))
    goal = np.c_[true_velocity(network, band), np.ones(len(band))]
    fit = np.linalg.solve(sigma.T @ sigma + 1e-3 * np.eye(sigma.shape[1]), sigma.T @ goal)
    weights = np.zeros((network.basis.size, 8))
    weights[:, :2], weights[:, 7] = fit[:, :2], fit[:, 2]
    gaps = np.zeros((0, 5))
    return LearnedModel(
        network.basis.centres,
        network.basis.precision,
        np.repeat(weights[None], len(network.regions), axis=0),
        np.c_[t, path, seen],
        gaps,
    )
