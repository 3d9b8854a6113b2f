"""From messages to steps: the same for a running robot and for its bags."""
