# SPDX-License-Identifier: Apache-2.0

"""What the package promises about itself agrees with what it is."""

import configparser
import re
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from cmifs_ros.collect.robot_file.reader import parse_robot_file

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / 'README.md', *(ROOT / 'docs').glob('*.md')]
PACKAGE = ElementTree.parse(ROOT / 'package.xml').getroot()
#: Of the imports that are not of the standard library, the rosdep key or package that brings them.
KEYS = {
    'joblib': 'python3-joblib',
    'matplotlib': 'python3-matplotlib',
    'numba': 'python3-numba',
    'numpy': 'python3-numpy',
    'rich': 'python3-rich',
    'scipy': 'python3-scipy',
    'tqdm': 'python3-tqdm',
    'yaml': 'python3-yaml',
}
#: Imports that the package does without until they are asked for: the extra that brings each, and
#: what pip calls it.
OPTIONAL = {
    'PIL': ('images', 'pillow'),
    'av': ('videos', 'av'),
    'distributed': ('cluster', 'distributed'),
    'ennemi': ('peers', 'ennemi'),
    'gymnasium': ('tasks', 'gymnasium'),
    'h5py': ('tables', 'h5py'),
    'hidimstat': ('peers', 'hidimstat'),
    'mcap': ('bags', 'mcap'),
    'pyarrow': ('tables', 'pyarrow'),
    'pyulog': ('tables', 'pyulog'),
    'rosbags': ('bags', 'rosbags'),
    'sklearn': ('peers', 'scikit-learn'),
    'threadpoolctl': ('threads', 'threadpoolctl'),
    'zstandard': ('bags', 'zstandard'),
}
#: The same of ROS, which pip does not have: dependencies of tests.
OPTIONAL_OF_ROS = {'control_msgs'}


def imported():
    names = set()
    for path in (ROOT / 'cmifs_ros').rglob('*.py'):
        names |= set(re.findall(r'^\s*(?:from|import) ([a-zA-Z]\w*)', path.read_text(), re.M))
    return names - set(sys.stdlib_module_names) - {'cmifs_ros'}


def test_every_import_is_a_declared_dependency():
    declared = {element.text for element in PACKAGE.findall('exec_depend')}
    needed = imported() - OPTIONAL.keys() - OPTIONAL_OF_ROS
    assert {KEYS.get(name, name) for name in needed} <= declared


def test_optional_imports_are_extras_or_of_tests_and_stand_inside_functions():
    setup = (ROOT / 'setup.py').read_text()
    folders = ('cmifs_ros', 'studies')
    code = '\n'.join(p.read_text() for folder in folders for p in (ROOT / folder).rglob('*.py'))
    installed = '\n'.join(p.read_text() for p in (ROOT / 'cmifs_ros').rglob('*.py'))
    for extra, package in OPTIONAL.values():
        assert re.search(rf"'{extra}': \[.*'{package}\b", setup)
    assert {element.text for element in PACKAGE.findall('test_depend')} >= OPTIONAL_OF_ROS
    for name in OPTIONAL.keys() | OPTIONAL_OF_ROS:
        assert re.search(rf'^ +from {name}[.\w]* import', code, re.M)
        assert not re.search(rf'^(from|import) {name}\b', installed, re.M)


def test_core_sim_and_collect_know_no_ros():
    allowed = {
        'core': {'numpy', 'scipy', 'numba', 'threadpoolctl'},
        'sim': {'numpy', 'gymnasium'},
        'collect': {
            'numpy',
            'yaml',
            'rosbags',
            'mcap',
            'zstandard',
            'pyarrow',
            'h5py',
            'pyulog',
            'PIL',
            'av',
        },
    }
    for folder, packages in allowed.items():
        for path in (ROOT / 'cmifs_ros' / folder).rglob('*.py'):
            names = set(re.findall(r'^\s*(?:from|import) ([a-zA-Z]\w*)', path.read_text(), re.M))
            assert names <= set(sys.stdlib_module_names) | packages | {'cmifs_ros'}, path


def test_setup_py_and_package_xml_say_the_same():
    asked = ['--name', '--version', '--license', '--description']
    done = subprocess.run(
        [sys.executable, 'setup.py', *asked],
        cwd=ROOT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    name, version, licence, description = done.stdout.splitlines()[-4:]
    assert (name, version) == (PACKAGE.findtext('name'), PACKAGE.findtext('version'))
    assert licence == PACKAGE.findtext('license')
    assert ' '.join(PACKAGE.findtext('description').split()).startswith(description[:-1])


def test_executables_go_where_ros2_run_looks():
    parser = configparser.ConfigParser()
    parser.read(ROOT / 'setup.cfg')
    assert parser['develop']['script_dir'] == '$base/lib/cmifs_ros'
    assert parser['install']['install_scripts'] == '$base/lib/cmifs_ros'


@pytest.mark.parametrize(
    ('name', 'own', 'executables'),
    [
        ('cmifs_ros.launch.xml', {'scenario'}, {'selector_node', 'simulator_node'}),
        (
            'robot.launch.xml',
            {'robot_file', 'use_sim_time', 'respawn'},
            {'selector_node', 'sampler_node'},
        ),
    ],
)
def test_the_launch_files_start_executables_that_exist_and_end_with_them(name, own, executables):
    entry_points = re.findall(r"'(\w+) = cmifs_ros", (ROOT / 'setup.py').read_text())
    launch = ElementTree.parse(ROOT / 'launch' / name).getroot()
    arguments = {arg.get('name') for arg in launch.findall('arg')}
    assert arguments == {'namespace', 'params_file', 'episodes_path'} | own
    nodes = launch.findall('.//node')
    assert {node.get('exec') for node in nodes} == executables
    assert executables <= set(entry_points)
    assert all((node.get('on_exit') == 'shutdown') != (node.get('respawn') == 'true')
               for node in nodes)  # fmt: skip
    documented = (ROOT / 'docs' / 'interface.md').read_text()
    assert all(f'`{argument}`' in documented for argument in arguments)


def test_installed_data_files_are_where_ros_looks_for_them():
    pytest.importorskip('rclpy', reason='ROS 2 is not here')
    from ament_index_python.packages import get_package_prefix

    prefix = Path(get_package_prefix('cmifs_ros'))
    for path in (
        'share/ament_index/resource_index/packages/cmifs_ros',
        'share/cmifs_ros/package.xml',
        'share/cmifs_ros/config/cmifs_ros.yaml',
        'share/cmifs_ros/launch/cmifs_ros.launch.xml',
        'share/cmifs_ros/launch/robot.launch.xml',
        'lib/cmifs_ros/demo',
        'lib/cmifs_ros/downstream',
        'lib/cmifs_ros/make_robot_file',
        'lib/cmifs_ros/sampler_node',
        'lib/cmifs_ros/select_from_bag',
        'lib/cmifs_ros/selector_node',
        'lib/cmifs_ros/simulator_node',
        'lib/cmifs_ros/watch',
    ):
        assert (prefix / path).is_file(), path


def test_the_docs_show_the_downstream_node_as_it_is():
    code = (ROOT / 'cmifs_ros' / 'tools' / 'downstream.py').read_text()
    assert code in (ROOT / 'docs' / 'interface.md').read_text()


def test_the_docs_name_every_parameter():
    page = (ROOT / 'docs' / 'interface.md').read_text()
    config = (ROOT / 'config' / 'cmifs_ros.yaml').read_text()
    for name in re.findall(r'^    (\w+):', config, re.M):
        assert f'`{name}`' in page, name


def python_of(page):
    return re.search(r'```python\n(.*?)```', (ROOT / page).read_text(), re.S)[1]


def output_of(code):
    done = subprocess.run(
        [sys.executable, '-c', code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return done.stdout


def test_the_first_example_of_the_library_page_runs():
    names = output_of(python_of('docs/library.md'))
    assert re.fullmatch(r"\['\w+' '\w+' '\w+' '\w+'\]\n", names)


def test_the_example_of_the_readme_prints_what_the_readme_says():
    pytest.importorskip('gymnasium', reason='Gymnasium is not here')
    (said,) = re.findall(r"`(\['obs.*?\])`", (ROOT / 'README.md').read_text())
    assert output_of(python_of('README.md')).startswith(said)


def test_the_examples_of_the_recordings_page_run_and_confirm_what_it_says(tmp_path, capsys):
    for package in ('gymnasium', 'pandas', 'pyarrow'):
        pytest.importorskip(package, reason=f'{package} is not here')
    from cmifs_ros.tools.select_from_bag import main

    page = (ROOT / 'docs' / 'recordings.md').read_text()
    for code in re.findall(r'```python\n(.*?)```', page, re.S):
        if 'import minari' not in code:  # It is not installed for the tests.
            subprocess.run([sys.executable, '-c', code], cwd=tmp_path, check=True)
    assert main([str(tmp_path / 'cart_pole.parquet'), '--out', str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    first, *_ = printed.splitlines()
    assert first.endswith('cart_pole.parquet: 1355 steps, 60 complete episodes')
    assert 'cart_pole.parquet: 1355 steps, 60 complete episodes\n' in page
    # What makes the pole fall is beyond doubt; whether its cart's speed counts is not.
    for sensor in ('angle', 'turn'):
        row = re.compile(rf'^ +\d +{sensor} .* confirmed ', re.M)
        assert row.search(page)
        assert row.search(printed)
    (text,) = re.findall(r'```yaml\n(.*?)```', page, re.S)
    assert parse_robot_file(text).channel_names == ('slip', 'battery')
    table, robot = tmp_path / 'drive.csv', tmp_path / 'drive.yaml'
    robot.write_text(text)
    assert main([str(table), '--robot', str(robot), '--out', str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert 'drive.csv: 1500 messages, 57 complete episodes\n' in page
    assert 'drive.csv: 1500 messages, 57 complete episodes\n' in printed
    assert re.search(r'^ +\d +slip .* confirmed ', printed, re.M)


def test_the_robot_file_of_the_readme_is_one():
    (text,) = re.findall(r'```yaml\n(.*?)```', (ROOT / 'README.md').read_text(), re.S)
    assert parse_robot_file(text).sources


def test_every_command_of_the_pages_exists():
    entry_points = set(re.findall(r"'(\w+) = cmifs_ros", (ROOT / 'setup.py').read_text()))
    targets = set(re.findall(r'^(\w+):', (ROOT / 'Makefile').read_text(), re.M))
    for page in PAGES:
        text = page.read_text()
        assert set(re.findall(r'ros2 run cmifs_ros ([a-z_]\w*)', text)) <= entry_points, page
        assert set(re.findall(r'^ +make ([a-z]+)', text, re.M)) <= targets, page
        for name in re.findall(r'ros2 launch cmifs_ros (\S+)', text):
            assert (ROOT / 'launch' / name).is_file(), (page, name)
        for module in re.findall(r'python3 -m ((?:studies|cmifs_ros)[.a-z_]*[a-z])', text):
            path = ROOT / module.replace('.', '/')
            assert path.with_suffix('.py').is_file() or path.is_dir(), (page, module)


def test_every_link_of_the_pages_leads_somewhere():
    for page in PAGES:
        for target in re.findall(r'\]\(([^)#\s]+)', page.read_text()):
            if '://' not in target:
                assert (page.parent / target).exists(), (page, target)
