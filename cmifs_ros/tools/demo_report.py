# SPDX-License-Identifier: Apache-2.0

"""The options and the output that the demos of the nodes and of the library share."""

from __future__ import annotations

import argparse
from pathlib import Path

from cmifs_ros.collect.advice import advice_lines, advice_of
from cmifs_ros.collect.selection_report import headline
from cmifs_ros.core.selection import Selection
from cmifs_ros.sim import SCENARIOS, channel_names

from .arguments import file_to_write, number_from
from .ranking import draw_ranking, ranking_text

#: The sensors that matter in each world; used only to comment on the result.
RELEVANT = {
    'without_gravel': ('x', 'y'),
    'with_gravel': ('x', 'y', 'battery', 'gravel'),
}
READING = """\
adds       share of the return's variance that the sensor predicts beyond the
           selected ones; an estimate, which may be below 0 by chance
p          p-value of a separate test; this decides whether a sensor matters
status     confirmed: there is evidence; dispensable: there is none, and the
           sensor adds less than {margin:.0%} (with 95 % confidence); undecided:
           neither; more episodes may settle it"""


def demo_parser(program: str, description: str) -> argparse.ArgumentParser:
    """Return a parser for the options of both demos."""
    parser = argparse.ArgumentParser(program, description=description)
    parser.add_argument(
        '--scenario', choices=SCENARIOS, default='without_gravel',
        help='world of the robot: two of its 14 sensors matter, with gravel four (default: '
        '%(default)s)',
    )  # fmt: skip
    parser.add_argument(
        '--episodes', type=number_from(2), default=100, metavar='N',
        help='episodes to collect (default %(default)s)',
    )  # fmt: skip
    parser.add_argument(
        '--num-features', type=number_from(1), metavar='N',
        help='sensors to select (default: the confirmed ones)',
    )  # fmt: skip
    parser.add_argument(
        '--seed', type=number_from(0), default=0, metavar='N', help='seed of the world (default 0)'
    )
    parser.add_argument(
        '--out', type=file_to_write, metavar='FILE',
        help='file of the picture (default demo_SCENARIO.png)',
    )  # fmt: skip
    return parser


def print_selection(selection: Selection, scenario: str) -> None:
    """Print the ranking with its evidence, a legend, and how right it is."""
    print(f'\n{ranking_text(selection)}\n')
    print(READING.format(margin=selection.margin))
    relevant = RELEVANT[scenario]
    found = [name for name in relevant if name in selection.names]
    count = len(channel_names(scenario))
    print(f'\n{headline(selection)}: {len(selection.names)} of {count} sensors')
    print(
        f'{len(found)} of the {len(relevant)} that matter in this world ({", ".join(relevant)}),\n'
        f'{len(selection.names) - len(found)} of the {count - len(relevant)} that do not\n'
    )
    print('\n'.join(advice_lines(advice_of(selection))))


def save_picture(selection: Selection, scenario: str, path: Path | None) -> Path:
    """Save the ranking as a picture, and return its path; sensors that matter here are bold."""
    path = path or Path(f'demo_{scenario}.png')
    figure = draw_ranking(selection)
    (axes,) = figure.axes
    for label in axes.get_yticklabels():
        if label.get_text() in RELEVANT[scenario]:
            label.set_fontweight('bold')
    axes.set_ylabel('sensor (bold: matters in this world)')
    figure.suptitle(f'{scenario}: {selection.episodes} episodes, {selection.seconds:.1f} s')
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=150)
    return path.resolve()
