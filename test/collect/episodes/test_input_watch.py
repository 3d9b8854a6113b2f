# SPDX-License-Identifier: Apache-2.0

from array import array

from cmifs_ros.collect.episodes.buffer import EpisodeBuffer
from cmifs_ros.collect.episodes.builder import RewardSample
from cmifs_ros.collect.episodes.input_watch import InputWatch, Topic
from cmifs_ros.collect.episodes.pairing import EpisodeAssembler


def test_until_an_episode_ends_its_length_is_told():
    assembler, buffer = EpisodeAssembler(max_episode_steps=3), EpisodeBuffer()
    watch = InputWatch(assembler, buffer)
    said = []
    for stamp in range(1, 4):
        assembler.add_state(stamp, ['a'], array('d', [float(stamp)]))
        for episode in assembler.add_reward(stamp, RewardSample(0.5)):
            buffer.append(episode)
        watch.look(float(stamp), {'state': Topic(0.0), 'reward': Topic(0.0)})
        said.append(watch.assessment.message)
    assert said == [
        'collecting; the first episode has 1 step so far',
        'collecting; the first episode has 2 steps so far',
        'collecting',
    ]


def test_of_a_silent_topic_it_tells_whether_anybody_publishes_it():
    watch = InputWatch(EpisodeAssembler(max_episode_steps=3), EpisodeBuffer())

    def said(state, reward):
        watch.look(0.0, {'state': state, 'reward': reward})
        return watch.assessment.message

    talker, nobody = ('/robot',), ()
    assert said(Topic(), Topic()) == 'no state has arrived yet; nobody publishes it'
    assert said(Topic(publishers=talker), Topic()) == 'no state has arrived yet'
    assert said(Topic(8.0, publishers=nobody), Topic()) == 'no state for 8 s; nobody publishes it'
    assert said(Topic(8.0, publishers=talker), Topic()) == 'no state for 8 s'
    missing = 'states come, but no reward for 5 s'
    assert said(Topic(0.0, publishers=talker), Topic()) == f'{missing}; nobody publishes it'
    assert said(Topic(0.0, publishers=talker), Topic(publishers=talker)) == missing


def test_while_topics_are_switched_off_silence_is_no_problem():
    watch = InputWatch(EpisodeAssembler(max_episode_steps=3), EpisodeBuffer())

    def found(*switched_off, publishers=('/sampler',)):
        silent = Topic(60.0, publishers=publishers)
        watch.look(0.0, {'state': silent, 'reward': silent}, switched_off)
        return watch.assessment.level, watch.assessment.message

    assert found() == ('STALE', 'no state for 60 s')
    assert found('/imu') == ('OK', 'no episodes to learn from while /imu is switched off')
    assert found('/imu', '/scan')[1].endswith('while /imu, /scan are switched off')
    assert found('/imu', publishers=()) == ('STALE', 'no state for 60 s; nobody publishes it')


def test_drops_that_go_on_are_logged_ever_more_rarely_and_new_causes_soon():
    assembler = EpisodeAssembler(max_episode_steps=3)
    watch, logged = InputWatch(assembler, EpisodeBuffer()), []
    topics = dict.fromkeys(('state', 'reward'), Topic(0.0))
    for second in range(20_000):
        if second < 10_000:
            assembler.drop_message('not_finite', 'x is nan')
        if second in (5000, 19_000):
            assembler.drop_message('wrong_length' if second == 5000 else 'not_finite', 'an error')
        logged += [(second, line) for line in watch.look(float(second), topics)]
    times = [second for second, _ in logged]
    assert times[:6] == [0, 10, 30, 70, 150, 310]
    assert 5000 <= next(t for t, line in logged if 'wrong_length' in line) <= 5010
    assert len([t for t in times if t < 10_100]) < 25
    assert times[-1] == 19_000  # After a quiet time, at once.
    # Nothing is left out of the numbers.
    total = sum(int(line.split(' not_finite')[0].split()[-1]) for _, line in logged)
    assert total == 10_001
