# SPDX-License-Identifier: Apache-2.0

"""The statuses of a sensor."""

#: `confirmed`: there is evidence that the sensor is informative given the other selected ones.
#: `dispensable`: there is none, and with 95 % confidence it adds less than a margin to what the
#: others predict; with fewer than `FEWEST_EPISODES`, none is, because the error of a share is
#: too uncertain. `undecided`: neither; more episodes may settle it. A p-value up to `USUAL_LEVEL`
#: is some evidence even where a selection has a stricter level.
CONFIRMED, UNDECIDED, DISPENSABLE = STATUSES = ('confirmed', 'undecided', 'dispensable')
FEWEST_EPISODES = 20
USUAL_LEVEL = 0.05
