"""Named tuples handed over by their address: `camnet.geometry.borrow`."""

from __future__ import annotations

from camnet.geometry.borrow import lend

__all__ = ["lend"]
