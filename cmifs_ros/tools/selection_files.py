# SPDX-License-Identifier: Apache-2.0

"""The files that `select_from_bag` writes."""

from __future__ import annotations

import argparse
import json
import os
import time
from collections import Counter
from typing import NamedTuple

from cmifs_ros.collect.advice import Advice, advice_lines, advice_of
from cmifs_ros.collect.episodes import file as episode_file
from cmifs_ros.collect.example_frames import example_frames
from cmifs_ros.collect.pooling import Pool
from cmifs_ros.collect.recorded_episodes import RecordedEpisodes
from cmifs_ros.collect.robot_file import RobotFile
from cmifs_ros.collect.selection_fields import fields_of
from cmifs_ros.collect.selection_report import nothing_selected
from cmifs_ros.collect.sensor_topics import SensorTopics
from cmifs_ros.collect.simulated_time import CLOCK
from cmifs_ros.collect.traffic import rates_of
from cmifs_ros.core.selection import Selection
from cmifs_ros.core.thinning import ThinnedEpisodes

from .program import CommandError
from .recordings import Recordings


class Data(NamedTuple):
    """What a selection rests on.

    Attributes
    ----------
    recordings : Recordings
    facts : list of RecordedEpisodes
        What is known of each, without episodes.
    pool : Pool
        Which of their episodes are used.
    episodes : ThinnedEpisodes
        These.

    """

    recordings: Recordings
    facts: list[RecordedEpisodes]
    pool: Pool
    episodes: ThinnedEpisodes


def write_files(
    selection: Selection, data: Data, robot: RobotFile | None, options: argparse.Namespace
) -> None:
    """Print a selection and the advice, and write the files that the options name.

    Raises
    ------
    CommandError
        If the file of episodes exists by now. Everything else has been written.

    """
    from .html_report import write_report
    from .ranking import draw_ranking, ranking_text

    dropped = sum((Counter(one.dropped) for one in data.facts), Counter())
    topics = _topics(data.facts, robot)
    advice = advice_of(selection, *(topics or ()))
    print(f'\n{ranking_text(selection)}\n')
    found = ', '.join(selection.selected) or f'nothing: {nothing_selected(selection)}'
    print(f'selected: {found} ({selection.seconds:.1f} s)')
    options.out.mkdir(parents=True, exist_ok=True)
    written = [options.out / 'selection.json', options.out / 'selection.png']
    written[0].write_text(json.dumps(fields_of(selection, topics), indent=1) + '\n')
    draw_ranking(selection).savefig(written[1], dpi=150)
    # A selector may have made it since the command began, and hold episodes of its own there.
    is_taken = options.episodes_file is not None and os.path.lexists(options.episodes_file)
    if options.episodes_file and not is_taken:
        # A selector restored with a selection without channels would publish nothing.
        kept = selection if selection.indices else None
        saved = episode_file.Saved(
            data.pool.channel_names, data.recordings.episodes(data.pool), kept, time.time(),
            action_names=data.pool.action_names,
        )  # fmt: skip
        options.episodes_file.parent.mkdir(parents=True, exist_ok=True)
        episode_file.write(options.episodes_file, saved)
        written.append(options.episodes_file)
    if options.topics:
        options.topics.parent.mkdir(parents=True, exist_ok=True)
        options.topics.write_text(_record_arguments(advice, data.facts) + '\n')
        written.append(options.topics)
    if options.report:
        page = write_report(
            options.report,
            selection,
            data.episodes,
            data.pool.channel_names,
            dropped,
            advice=advice,
            frames=example_frames(
                selection, data.episodes, data.pool, data.facts, options.order == 'time'
            ),
        )
        written.append(page)
    print(f'written: {", ".join(map(str, written))}')
    print('\n'.join(['', *advice_lines(advice)]))
    if is_taken:
        raise CommandError(f'{options.episodes_file} exists by now, and is not replaced')


def _topics(facts: list[RecordedEpisodes], robot: RobotFile | None) -> SensorTopics | None:
    if robot is None:
        return None
    rates = rates_of([one.traffic for one in facts])
    return SensorTopics(robot.channel_topics, rates, robot.topics_for(()))


def _record_arguments(advice: Advice, facts: list[RecordedEpisodes]) -> str:
    """Return arguments of `ros2 bag record` for all topics except those that can go."""
    gone = {item.name for item in advice.can_go}
    kept = (topic for one in facts for name, topic in one.topics.items() if name not in gone)
    topics = list(dict.fromkeys(kept))
    topics += [CLOCK] if any(one.traffic.is_simulated for one in facts) else []
    hidden = ['--include-hidden-topics'] if any('/_' in topic for topic in topics) else []
    return ' '.join([*hidden, '--topics', *topics])
