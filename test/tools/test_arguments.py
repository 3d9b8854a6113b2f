# SPDX-License-Identifier: Apache-2.0

"""Paths on command lines: a mistake is told before the work, with what was expected."""

import pytest

from cmifs_ros.tools import demo, make_robot_file, select_from_bag


@pytest.fixture
def here(tmp_path, monkeypatch):
    """Work in a folder that holds an empty file."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'file').touch()


@pytest.mark.parametrize(
    ('main', 'arguments', 'said'),
    [
        (demo.main, ['--out', '.'], '. is a folder; expected the name of a file, as in NAME'),
        (make_robot_file.main, ['--out', '.'], '. is a folder; expected the name of a file'),
        (make_robot_file.main, ['--out', 'file/new'], 'file is not a folder; expected a folder'),
        (select_from_bag.main, ['bag', '--out', 'file'], 'file is not a folder; expected a folder'),
        (
            select_from_bag.main,
            ['bag', '--report', 'file/x/y'],
            'file is not a folder; expected a folder',
        ),
        (select_from_bag.main, ['bag', '--episodes-file', '.'], '. is a folder; expected the name'),
        (select_from_bag.main, ['bag', '--episodes-file', 'file'], 'file exists; expected'),
        (make_robot_file.main, ['--out', 'file'], 'file exists; expected the name of a new file'),
    ],
)
@pytest.mark.usefixtures('here')
def test_a_path_that_cannot_be_written_is_a_sentence_at_once(main, arguments, said, capsys):
    with pytest.raises(SystemExit) as end:
        main(arguments)
    assert end.value.code == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    ('name', 'said'),
    [
        ('.', 'cannot be read (Is a directory)'),
        ('none', 'cannot be read (No such file or directory)'),
        ('file', 'is empty'),
    ],
)
@pytest.mark.usefixtures('here')
def test_a_robot_file_that_is_none_is_a_sentence(name, said, capsys):
    assert select_from_bag.main(['bag', '--robot', name]) == 1
    error = capsys.readouterr().err
    assert f'{name} {said}; expected a robot file; make_robot_file writes a first one' in error
    assert error.count('\n') == 1
