"""Policies, one per file: a policy sees observations, never the truth and never the physics engine.

Import as ``camnet.agents``. The top-level name ``agents`` belongs to other packages.
"""

if __name__ != "camnet.agents":
    raise ImportError("import this package as camnet.agents")
