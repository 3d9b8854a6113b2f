# SPDX-License-Identifier: Apache-2.0

"""The result of a selection, as plain data."""

from __future__ import annotations

from dataclasses import dataclass

from .effect import Effect
from .statuses import CONFIRMED
from .targets import RETURN


@dataclass(frozen=True)
class SensorResult:
    """The result for one sensor. Values that the method does not estimate are None or empty.

    Attributes
    ----------
    name : str
    channels : tuple of str
        All channels of the sensor.
    is_selected : bool
        Whether it is selected.
    score : float
        The score of the sensor together with those ranked before it; if it was tested but not
        selected, together with all selected ones.
    is_constant : bool
        Whether none of its channels ever changed, so that it was not tested.
    null_band : (float, float, float) or None
        The score of an uninformative sensor at the same rank: 5 %, median, 95 %.
    pvalue : float or None
        p-value of the hypothesis that the sensor is uninformative given the other selected ones,
        corrected for the number of sensors.
    status : str or None
        One of `STATUSES`.
    supporting_channels : tuple of str
        The channels that carry the evidence: all, or the informative ones of a large group.
    redundant_with : tuple of str
        Confirmed sensors; without one of these there would be strong evidence for this one. A copy
        is redundant with its original.
    stability : float or None
        Share of random halves of the episodes in which the sensor is selected.
    effect : Effect or None
    together_with : tuple of str
        Other unconfirmed sensors together with which it may add the margin or more, although it
        adds less alone.
    why : str
        What the sensor is needed for.

    """

    name: str
    channels: tuple[str, ...]
    is_selected: bool
    score: float
    is_constant: bool = False
    null_band: tuple[float, float, float] | None = None
    pvalue: float | None = None
    status: str | None = None
    supporting_channels: tuple[str, ...] = ()
    redundant_with: tuple[str, ...] = ()
    stability: float | None = None
    effect: Effect | None = None
    why: str = ''
    together_with: tuple[str, ...] = ()


@dataclass(frozen=True)
class Selection:
    """The result of a selection, which all outputs show: the sensors and their evidence.

    Attributes
    ----------
    indices : tuple of int
        Selected channels, best sensor first.
    sensors : tuple of SensorResult
        All ranked sensors, best first.
    episodes, steps : int
        Size of the data used.
    seconds : float
        Computing time.
    means, spreads : tuple of float
        Mean in these data of each channel and, last, of the reward, and how far they go: their
        standard deviation or, if it is greater, as of a battery that drains, twice the range of
        their means in the three thirds of the data. Empty if these data were cleared.
    outdated : int
        Number of the oldest episodes that no longer fit the newest and were left out.
    number : int
        Running number of a selection that a node uses; 0 if it is not in use.
    target : str
        The question; see `targets`.
    gamma : float or None
        Discount factor per step of the return; None with another target.
    predicted_share, predicted_share_of_all, predicted_share_of_none : float or None
        Share of the target's variance that the selected sensors, all sensors, and none predict in
        held-out episodes, each together with the step and the action.
    warnings : tuple of str
        What the data cannot show.
    margin : float or None
        A sensor that adds less than this share of the target's variance is dispensable.
    level : float or None
        The greatest p-value that confirms a sensor. A node divides its significance among all
        selections of a task.
    losses : str
        How the loss of episodes depended on their end; empty if it did not. Then the episodes left
        are biased, and no sensor is dispensable.
    doubt : str
        Why it may no longer hold, such as changed data; empty if nothing suggests that.

    """

    indices: tuple[int, ...]
    sensors: tuple[SensorResult, ...]
    episodes: int
    steps: int
    seconds: float
    means: tuple[float, ...] = ()
    spreads: tuple[float, ...] = ()
    outdated: int = 0
    number: int = 0
    target: str = RETURN
    gamma: float | None = None
    predicted_share: float | None = None
    predicted_share_of_all: float | None = None
    predicted_share_of_none: float | None = None
    warnings: tuple[str, ...] = ()
    margin: float | None = None
    level: float | None = None
    losses: str = ''
    doubt: str = ''

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the selected channels, in the order of `indices`."""
        return tuple(name for s in self.sensors if s.is_selected for name in s.channels)

    @property
    def selected(self) -> tuple[str, ...]:
        """Names of the selected sensors, best first."""
        return tuple(sensor.name for sensor in self.sensors if sensor.is_selected)

    @property
    def ranking(self) -> tuple[str, ...]:
        """Names of all sensors, best first."""
        return tuple(sensor.name for sensor in self.sensors)

    @property
    def scores(self) -> tuple[float, ...]:
        """Scores of all sensors, in the order of `ranking`."""
        return tuple(sensor.score for sensor in self.sensors)

    @property
    def confirmed(self) -> tuple[str, ...]:
        """Names of the confirmed sensors."""
        return tuple(sensor.name for sensor in self.sensors if sensor.status == CONFIRMED)

    @property
    def changing(self) -> tuple[SensorResult, ...]:
        """The sensors that are not constant; the others have no score of their own."""
        return tuple(sensor for sensor in self.sensors if not sensor.is_constant)
