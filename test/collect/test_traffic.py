# SPDX-License-Identifier: Apache-2.0

"""What topics carry, and what is saved while they are off."""

import pytest

from cmifs_ros.collect.traffic import Rate, TrafficMeter, rate_in_words


def test_what_a_topic_would_have_carried_while_it_was_off_is_saved():
    meter = TrafficMeter()
    meter.pass_time(5.0, ())  # Nothing has come yet: that time does not count.
    for _ in range(40):
        meter.take('/imu')
    meter.weigh('/imu', 300)
    meter.pass_time(2.0, ())
    assert meter.rate('/imu') == (20.0, 6000.0)
    assert meter.saved == {}
    meter.pass_time(10.0, {'/imu'})
    meter.pass_time(5.0, {'/imu'})
    assert meter.saved == {'/imu': (300.0, 90_000.0)}
    assert meter.rate('/imu') == (20.0, 6000.0)  # The mean of the time when it was on.
    assert rate_in_words(meter.rate('/imu')) == '20 messages/s, 6 kB/s'
    assert rate_in_words(Rate(1.0, 80.0)) == '1 message/s, 80 B/s'


def test_of_a_topic_that_never_spoke_nothing_is_saved():
    meter = TrafficMeter()
    meter.pass_time(10.0, {'/imu'})
    assert meter.saved == {'/imu': (0.0, 0.0)}


def test_the_share_of_a_core_is_told_with_and_without_saving():
    meter = TrafficMeter()
    assert meter.cpu_share(is_saving=False) is None
    meter.use_cpu(1.0, 5.0, is_saving=False)
    meter.use_cpu(0.75, 2.0, is_saving=False)
    meter.use_cpu(0.75, 15.0, is_saving=True)
    assert meter.cpu_share(is_saving=False) == pytest.approx(0.25)
    assert meter.cpu_share(is_saving=True) == pytest.approx(0.05)
