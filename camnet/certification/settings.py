"""Settings of the certificates: the bounds that the proofs assume."""

from __future__ import annotations

from camnet.settings import NonNegative, Positive, Settings

__all__ = ["CertificateSettings"]


class CertificateSettings(Settings):
    """Bounds assumed by the dwell-time conditions (spec 02, 03).

    ``v_lo`` is the Lyapunov level the error must fall below while observed (``None``: from the noise floor).
    """

    eps_bar: NonNegative = 0.01
    etadot_max: Positive | None = None
    v_lo: Positive | None = None
    working_range_m: Positive | None = None
