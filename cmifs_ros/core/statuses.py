# SPDX-License-Identifier: Apache-2.0

"""What a selection says of a sensor; declared here and nowhere else."""

#: `confirmed`: there is evidence that the sensor is informative beside the others selected.
#: `dispensable`: there is none, and with 95 % confidence it adds less than a margin to what the
#: others predict. `undecided`: neither; more episodes may settle it.
CONFIRMED, UNDECIDED, DISPENSABLE = STATUSES = ('confirmed', 'undecided', 'dispensable')
