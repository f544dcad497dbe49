"""A designed world certified anew: as written, and after the failure of any of its cameras."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from camnet.certification.coverage import Coverage
from camnet.certification.way_search import coverage_rows
from camnet.certification.ways import Ways
from camnet.config.models import Scenario
from camnet.errors import CertificateError
from camnet.experiments.certified import Certified
from camnet.experiments.certify_world import certify_world
from camnet.experiments.promise_world import Limit, fixed_views, seen_ways, solids_of, target_features, watch
from camnet.experiments.site_ways import site_ways

__all__ = ["check_failures", "confirm"]


def confirm(designed: Scenario, limit: Limit, share: float) -> Certified:
    """Certify the designed world anew, for the share of the limit that was found.

    Raises
    ------
    CertificateError
        The certifier does not confirm what the solver found.
    """
    if not designed.fixed_cameras:
        raise CertificateError("the design has no camera: nothing asks for one; allow less out of view")
    off_s, off_m = (None if v is None else share * v for v in (limit.off_s, limit.off_m))
    certified = certify_world(designed, off_max_s=off_s, off_max_m=off_m)
    promise = certified.report["promise"]
    if promise["verdict"] != "certified":
        why = "; ".join(promise["reasons"])
        raise CertificateError(f"the certifier does not confirm the solver's answer: {why}")
    return certified


def check_failures(designed: Scenario, limit: Limit, share: float, survive: int) -> dict[str, Any]:
    """Return the longest stretches out of view after any ``survive`` cameras fail, and which failures those are.

    Raises
    ------
    CertificateError
        They exceed what is allowed.
    """
    watched: list[tuple[Ways, Coverage]] = []
    names: list[str] = []
    for site in site_ways(designed):
        views, names = fixed_views(site.network)
        assert views is not None
        solids, features = solids_of(site.network), target_features(site.network)
        watched += [(ways, seen_ways(site.network, ways, views, solids, features)) for ways in site.ways]
    none: tuple[int, ...] = ()
    worst_m, worst_s = (-1.0, none), (-1.0, none)
    for failed in itertools.combinations(range(len(names)), min(survive, len(names))):
        left = [watch(w, coverage_rows(c, ~np.isin(c.camera, failed))) for w, c in watched]
        worst_m = max(worst_m, (max(w.in_m.longest[0] for w in left), failed))
        worst_s = max(worst_s, (max(w.in_s.longest[0] for w in left), failed))
    far, late = (np.inf if v is None else share * v + 1e-6 for v in (limit.off_m, limit.off_s))
    lost = [names[k] for k in worst_s[1]]
    if worst_m[0] > far or worst_s[0] > late:
        raise CertificateError(
            f"the certifier does not confirm the solver's answer: without {', '.join(lost)} a target is out of view "
            f"for {worst_m[0]:.4g} m, {worst_s[0]:.4g} s"
        )
    return {"unseen_max_m": worst_m[0], "unseen_max_s": worst_s[0], "failed": lost}
