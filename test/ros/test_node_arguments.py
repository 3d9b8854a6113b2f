# SPDX-License-Identifier: Apache-2.0

"""The command line of the nodes."""

import importlib
import sys

import pytest

from cmifs_ros.ros.node_arguments import check_arguments


@pytest.mark.parametrize('name', ['selector_node', 'sampler_node', 'simulator_node'])
def test_help_names_every_parameter_of_a_node(name, monkeypatch, capsys):
    specs = importlib.import_module(f'cmifs_ros.ros.{name}').PARAMETERS
    monkeypatch.setattr(sys, 'argv', [name, '--help'])
    with pytest.raises(SystemExit) as end:
        check_arguments(name, 'What it does.', specs)
    assert end.value.code == 0
    shown = capsys.readouterr().out
    assert 'What it does.' in shown
    assert f'{name} [--help] [--ros-args -p {specs[0].name}:=' in shown
    for spec in specs:
        assert f'\n  {spec.name}\n' in shown
        assert spec.description.split()[0] in shown


@pytest.mark.parametrize(
    ('arguments', 'is_right'),
    [
        ([], True),
        (['--ros-args', '-p', 'robot_file:=a.yaml', '-r', '__ns:=/b'], True),
        (['--ros-args', '-r', 'a:=b', '--'], True),
        (['my.yaml'], False),
        (['--robot_file', 'my.yaml'], False),
        (['--ros-args', '-r', 'a:=b', '--', 'my.yaml'], False),
    ],
)
def test_only_arguments_of_ros_are_taken(arguments, is_right, monkeypatch, capsys):
    monkeypatch.setattr(sys, 'argv', ['sampler_node', *arguments])
    if is_right:
        check_arguments('sampler_node', '')
        return
    with pytest.raises(SystemExit) as end:
        check_arguments('sampler_node', '')
    assert end.value.code == 2
    assert 'unrecognized arguments: ' in capsys.readouterr().err
