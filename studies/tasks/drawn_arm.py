# SPDX-License-Identifier: Apache-2.0

"""An arm with a camera, drawn as blobs.

It moves at random about its home, and is rewarded for being close to an object that drifts. The
camera shows the object as a bright blob, next to another blob that does not matter, under a light
that changes.
"""

from __future__ import annotations

import numpy as np

from cmifs_ros.collect.encoders import Image
from cmifs_ros.core import Episode

from .cameras import ANOTHER, GIVEN, image_of

NUM_EPISODES, NUM_STEPS, SIZE = 60, 25, 24
_HOME = -0.5


def wandering(rng: np.random.Generator, width: int, memory: float = 0.9) -> np.ndarray:
    """Return an autoregressive series, shape (NUM_STEPS, width), of variance 1."""
    values = rng.normal(size=(NUM_STEPS, width))
    for step in range(1, NUM_STEPS):
        values[step] = memory * values[step - 1] + np.sqrt(1 - memory**2) * values[step]
    return values


def drawn(rng: np.random.Generator, blobs: np.ndarray, light: float) -> np.ndarray:
    """Return a picture of blobs at some places, shape (n, 2), within -1 and 1."""
    axis = np.linspace(-1, 1, SIZE)
    shapes = np.exp(-((axis - blobs[:, :, None]) ** 2) / (2 * 0.15**2))  # (n, 2, SIZE)
    grey = light * (60 + 120 * np.einsum('nv,nh->vh', shapes[:, 1], shapes[:, 0]))
    return np.clip(grey + rng.normal(0, 4, grey.shape), 0, 255).astype(np.uint8)


def arm_with_camera(seed: int, kind: str) -> tuple[list[Episode], list[str]]:
    """Return the episodes of a recording and the names of their channels; see `cameras.KINDS`."""
    rng, camera, episodes = np.random.default_rng(seed), Image(), []
    for _ in range(NUM_EPISODES):
        arm = _HOME + 0.3 * wandering(rng, 2)
        objects = np.clip(0.4 * wandering(rng, 2), -1, 1)
        distractor = np.clip(0.5 * wandering(rng, 2), -1, 1)
        light = 1 + 0.15 * wandering(rng, 1)[:, 0]
        seen = np.clip(0.4 * wandering(rng, 2), -1, 1) if kind == ANOTHER else objects
        views = [
            camera.encode(image_of(drawn(rng, np.stack(blobs), max(0.3, bright))))
            for *blobs, bright in zip(seen, distractor, light, strict=True)
        ]
        states = [arm, objects, views] if kind == GIVEN else [arm, views]
        rewards = -np.hypot(*(arm - objects).T) + 0.1 * rng.normal(size=NUM_STEPS)
        episodes.append(Episode(np.hstack(states), rewards))
    names = ['arm_x', 'arm_y', *(('object_x', 'object_y') if kind == GIVEN else ())]
    return episodes, names + [f'camera{suffix}' for suffix in camera.suffixes]
