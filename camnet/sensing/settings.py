"""Settings of sensing."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from camnet.settings import Fraction, NonNegative, Positive, Settings

__all__ = ["FeatureSettings", "ImageSettings", "SensingSettings", "TrackerSettings"]


class FeatureSettings(Settings):
    """Level ``features``: where the target's ``features_m`` appear in the image, and the pose that explains it.

    ``pixel_noise_px`` is the standard deviation of each coordinate. ``solver: auto`` is ``ippe`` for points in one
    plane and ``sqpnp`` for others; ``refine`` ends it with Levenberg-Marquardt on the reprojection error. A pose is
    refused when that error (root mean square) is above ``max_reprojection_px``.
    """

    pixel_noise_px: NonNegative = 0.2
    solver: Literal["auto", "ippe", "sqpnp"] = "auto"
    refine: bool = True
    max_reprojection_px: Positive = 3.0


class ImageSettings(Settings):
    """Level ``image``: a fiducial marker on the target is imaged, detected by OpenCV's ArUco, and its pose solved.

    ``renderer: homography`` draws the part of the image around the marker, ``pybullet`` the whole scene (slowly).
    Every pixel is the mean of ``samples`` points. ``exposure_s`` blurs what moves, ``readout_s`` is the time from the
    first to the last row (rolling shutter; 0: global); both need the homography. ``blur_px`` is the lens's, grey
    levels (0 to 255) get noise of ``noise_levels``, and every frame's brightness varies by the share ``gain_std``.
    ``background_contrast`` is how strongly (levels) the surroundings vary about their mean. A pose is refused when its
    reprojection error (root mean square) is above ``max_reprojection_px``.
    """

    renderer: Literal["homography", "pybullet"] = "homography"
    samples: Annotated[int, Field(ge=1, le=256)] = 16
    exposure_s: NonNegative = 0.0
    readout_s: NonNegative = 0.0
    blur_px: NonNegative = 0.5
    noise_levels: NonNegative = 2.0
    gain_std: NonNegative = 0.05
    background_contrast: NonNegative = 15.0
    max_reprojection_px: Positive = 1.5


class TrackerSettings(Settings):
    """Level ``image_tracker``: no marker; a correlation tracker follows the target's box through rendered pictures.

    The first box of a sighting is a detector's, its edges off by ``detector_noise_px``. Below a peak-to-sidelobe ratio
    of ``least_psr`` the target is lost and the detector asked again. The heading is the direction of travel, known
    once the target has moved by ``heading_m``. Grey levels get noise of ``noise_levels``.
    """

    detector_noise_px: NonNegative = 1.0
    least_psr: NonNegative = 8.0
    heading_m: Positive = 0.1
    noise_levels: NonNegative = 2.0


class SensingSettings(Settings):
    """How the truth becomes measurements.

    ``level: pose`` is the true relative pose plus noise, ``features`` that which explains noisy pixels of the
    target's feature points, ``image`` that of a marker found in an image, ``image_tracker`` that of a box followed
    through images, without a marker; ``position_noise_m`` and
    ``orientation_noise_rad`` are of the first level alone. ``regression_samples`` is the window from which rates
    are regressed (20 in parikh2018), never from the truth; ``regression_degree`` 1 gives the rates in the middle of
    that window, 2 those at its end with four times the noise. A measurement comes ``latency_s`` after its image.
    """

    level: Literal["pose", "features", "image", "image_tracker"] = "pose"
    rate_hz: Positive = 30.0
    position_noise_m: NonNegative = 0.01
    orientation_noise_rad: NonNegative = 0.01
    latency_s: NonNegative = 0.0
    dropout_probability: Fraction = 0.0
    regression_samples: Annotated[int, Field(ge=3, le=10_000)] = 20
    regression_degree: Literal[1, 2] = 1
    features: FeatureSettings = FeatureSettings()
    image: ImageSettings = ImageSettings()
    tracker: TrackerSettings = TrackerSettings()
