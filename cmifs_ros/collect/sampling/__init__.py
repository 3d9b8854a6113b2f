# SPDX-License-Identifier: Apache-2.0

"""From messages to steps: the same for a running robot and for its bags."""
