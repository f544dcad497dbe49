"""The handoff environment carries the certificate of the current gap in its infos."""

from __future__ import annotations

import logging

import numpy as np

from camnet.env.handoff_v0 import HandoffEnv


def test_infos_carry_time_left_and_violations_and_errors_are_logged(caplog):
    env = HandoffEnv("mobile_certified", overrides=["certificate.off_max_s=0.4"], max_cycles=400)
    try:
        _, infos = env.reset(seed=0)
        still = dict.fromkeys(env.agents, np.zeros(5, dtype=np.float32))
        rows = [infos["camera_0"]["certificate"]]
        with caplog.at_level(logging.ERROR):
            while env.agents and not rows[-1]["overdue"]:
                _, _, _, _, infos = env.step(still)
                rows.append(infos["camera_0"]["certificate"])
    finally:
        env.close()
    assert infos["camera_1"]["certificate"] == rows[-1]  # common to all agents
    assert rows[-1]["overdue"] == 1
    assert rows[-1]["violations"] == 0
    assert any("longer than the 0.4 s" in r.getMessage() for r in caplog.records)
    left = [r["time_left_s"] for r in rows if r["time_left_s"] is not None]
    assert left[0] > left[-1]  # it runs down
    assert left[-1] < 0.0
