# SPDX-License-Identifier: Apache-2.0

"""From messages to steps, with the same code for a running robot and for bags."""
