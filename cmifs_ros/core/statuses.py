"""What a test says of a sensor; declared here and nowhere else."""

#: Evidence that the sensor is informative beside those selected, weak evidence, and none.
CONFIRMED, TENTATIVE, REJECTED = STATUSES = ('confirmed', 'tentative', 'rejected')
