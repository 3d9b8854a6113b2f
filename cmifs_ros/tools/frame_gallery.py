# SPDX-License-Identifier: Apache-2.0

"""Frames of a camera as HTML, embedded."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from html import escape

import numpy as np

from cmifs_ros.collect.example_frames import ExampleFrame
from cmifs_ros.core.targets import RETURN, REWARD


def gallery(camera: str, frames: Sequence[ExampleFrame]) -> str:
    """Return a section with the frames at which a camera matters most, of which at least one."""
    camera, predicted = escape(camera), escape(_predicted(frames[0].variable))
    raising = [_figure(frame) for frame in frames if frame.value > 0]
    lowering = [_figure(frame) for frame in frames if frame.value <= 0]
    rows = [f'<div class="frames">{"".join(row)}</div>' for row in (raising, lowering) if row]
    return (
        f'<h2>Where {camera} matters most</h2><p class="note">The steps at which {camera} changes '
        f'the prediction of {predicted} most, given the other selected sensors: first those at '
        f'which it predicts more, then less, in standard deviations of {predicted}. Those of a row '
        f'are of different episodes; episodes and steps count from 0.</p>{"".join(rows)}'
    )


def _predicted(variable: str) -> str:
    """Return what is predicted, in words, given the variable of a `Contribution`."""
    if variable in (RETURN, REWARD):
        return f'the {variable}'
    name = variable.removeprefix('predicts ')
    return variable if name == variable else f'the next value of {name}'


def _figure(frame: ExampleFrame) -> str:
    where = f'episode {frame.episode}, step {frame.step}'
    picture = embedded(_png(frame.picture), where)
    return f'<figure>{picture}<figcaption>{frame.value:+.1f}: {where}</figcaption></figure>'


def _png(grey: np.ndarray) -> bytes:
    from PIL import Image  # Matplotlib needs it as well.

    stream = io.BytesIO()
    Image.fromarray(grey).save(stream, format='png')
    return stream.getvalue()


def embedded(png: bytes, description: str) -> str:
    """Return a picture as an element."""
    data = base64.b64encode(png).decode('ascii')
    return f'<img alt="{escape(description)}" src="data:image/png;base64,{data}">'
