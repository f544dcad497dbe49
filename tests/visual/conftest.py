"""Scenes whose truth is known: a textured target on a textured ground."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

Image = NDArray[np.uint8]


def texture(seed: int, height: int, width: int) -> Image:
    rng = np.random.default_rng(seed)
    total = np.zeros((height, width, 3))
    for side in (2, 4, 8, 16, 32):
        coarse = rng.normal(size=(height // side + 2, width // side + 2, 3))
        total += side**0.7 * cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    total -= total.min()
    return (255.0 * total / total.max()).astype(np.uint8)


@dataclass
class Scene:
    """`image(k)`: a target of 40 x 60 px times `zoom`, centred on `centre(k)`, over a ground, under an occluder."""

    velocity: tuple[float, float] = (2.0, 0.5)
    growth: float = 0.0
    start: tuple[float, float] = (80.0, 100.0)
    occluder: tuple[int, int] | None = None
    size: tuple[int, int] = (320, 240)

    def __post_init__(self) -> None:
        self.ground = texture(1, self.size[1], self.size[0])
        self.target = texture(2, 120, 80)
        self.cover = texture(3, self.size[1], self.size[0])

    def centre(self, k: int) -> NDArray[np.float64]:
        return np.array(self.start) + k * np.array(self.velocity)

    def zoom(self, k: int) -> float:
        return float(np.exp(self.growth * k))

    def image(self, k: int) -> Image:
        step = 0.5 * self.zoom(k)  # image pixels per target pixel
        u, v = self.centre(k)
        matrix = np.array([[step, 0.0, u - 0.5 - step * 39.5], [0.0, step, v - 0.5 - step * 59.5]])
        size = self.size
        front = cv2.warpAffine(self.target, matrix, size, flags=cv2.INTER_AREA).astype(float)
        mask = cv2.warpAffine(np.ones((120, 80)), matrix, size, flags=cv2.INTER_AREA)[:, :, None]
        image = self.ground * (1.0 - mask) + front * mask
        if self.occluder is not None:
            left, right = self.occluder
            image[:, left:right] = self.cover[:, left:right]
        noise = np.random.default_rng(1000 + k).normal(size=image.shape)
        return np.clip(image + 2.0 * noise, 0, 255).astype(np.uint8)


@pytest.fixture
def scene() -> type[Scene]:
    return Scene
