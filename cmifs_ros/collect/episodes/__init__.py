"""From states and rewards to episodes: pairing, buffer, file, filter."""
