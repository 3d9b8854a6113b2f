from array import array

from cmifs_ros.collect.episode_buffer import EpisodeBuffer
from cmifs_ros.collect.input_watch import InputWatch, Topic
from cmifs_ros.collect.transitions import EpisodeAssembler, RewardSample


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
