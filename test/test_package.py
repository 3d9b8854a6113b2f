"""What the package promises about itself agrees with what it is."""

import configparser
import re
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ElementTree.parse(ROOT / 'package.xml').getroot()
#: Of the imports that are not of the standard library, the rosdep key or package that brings them.
KEYS = {
    'joblib': 'python3-joblib',
    'matplotlib': 'python3-matplotlib',
    'numpy': 'python3-numpy',
    'rich': 'python3-rich',
    'scipy': 'python3-scipy',
    'tqdm': 'python3-tqdm',
    'yaml': 'python3-yaml',
}
#: Imports that the package does without until they are asked for: the extra that brings each, and
#: what pip calls it.
OPTIONAL = {
    'distributed': ('cluster', 'distributed'),
    'ennemi': ('peers', 'ennemi'),
    'gymnasium': ('tasks', 'gymnasium'),
    'rosbags': ('bags', 'rosbags'),
    'sklearn': ('peers', 'scikit-learn'),
}


def imported():
    names = set()
    for path in (ROOT / 'cmifs_ros').rglob('*.py'):
        names |= set(re.findall(r'^\s*(?:from|import) ([a-zA-Z]\w*)', path.read_text(), re.M))
    return names - set(sys.stdlib_module_names) - {'cmifs_ros'}


def test_every_import_is_a_declared_dependency():
    declared = {element.text for element in PACKAGE.findall('exec_depend')}
    assert {KEYS.get(name, name) for name in imported() - OPTIONAL.keys()} <= declared


def test_optional_imports_are_extras_and_stand_inside_functions():
    setup = (ROOT / 'setup.py').read_text()
    code = '\n'.join(path.read_text() for path in (ROOT / 'cmifs_ros').rglob('*.py'))
    for name, (extra, package) in OPTIONAL.items():
        assert re.search(rf"'{extra}': \[.*'{package}\b", setup)
        assert re.search(rf'^ +from {name}[.\w]* import', code, re.M)
        assert not re.search(rf'^(from|import) {name}\b', code, re.M)


def test_core_sim_and_collect_import_nothing_but_numpy_and_scipy():
    for folder in ('core', 'sim', 'collect'):
        for path in (ROOT / 'cmifs_ros' / folder).rglob('*.py'):
            names = set(re.findall(r'^\s*(?:from|import) ([a-zA-Z]\w*)', path.read_text(), re.M))
            assert names <= set(sys.stdlib_module_names) | {'numpy', 'scipy', 'cmifs_ros'}, path


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


def test_the_launch_file_starts_executables_that_exist():
    entry_points = re.findall(r"'(\w+) = cmifs_ros", (ROOT / 'setup.py').read_text())
    launch = ElementTree.parse(ROOT / 'launch' / 'cmifs_ros.launch.xml').getroot()
    assert {arg.get('name') for arg in launch.findall('arg')} == {
        'namespace', 'params_file', 'scenario'
    }  # fmt: skip
    assert {node.get('exec') for node in launch.findall('node')} <= set(entry_points)


def test_installed_data_files_are_where_ros_looks_for_them():
    pytest.importorskip('rclpy', reason='ROS 2 is not here')
    from ament_index_python.packages import get_package_prefix

    prefix = Path(get_package_prefix('cmifs_ros'))
    for path in (
        'share/ament_index/resource_index/packages/cmifs_ros',
        'share/cmifs_ros/package.xml',
        'share/cmifs_ros/config/cmifs_ros.yaml',
        'share/cmifs_ros/launch/cmifs_ros.launch.xml',
        'lib/cmifs_ros/demo',
        'lib/cmifs_ros/downstream',
        'lib/cmifs_ros/make_robot_file',
        'lib/cmifs_ros/sampler_node',
        'lib/cmifs_ros/select_from_bag',
        'lib/cmifs_ros/selector_node',
        'lib/cmifs_ros/simulator_node',
    ):
        assert (prefix / path).is_file(), path


def test_the_readme_shows_the_downstream_node_as_it_is():
    code = (ROOT / 'cmifs_ros' / 'tools' / 'downstream.py').read_text()
    assert code in (ROOT / 'README.md').read_text()


def test_the_readme_names_every_parameter():
    readme = (ROOT / 'README.md').read_text()
    config = (ROOT / 'config' / 'cmifs_ros.yaml').read_text()
    for name in re.findall(r'^    (\w+):', config, re.M):
        assert f'`{name}`' in readme, name


def test_the_library_example_of_the_readme_runs():
    (code,) = re.findall(
        r'```python\n(from cmifs_ros.core.*?)```', (ROOT / 'README.md').read_text(), re.S
    )
    done = subprocess.run(
        [sys.executable, '-c', code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert re.fullmatch(r"\['\w+' '\w+' '\w+' '\w+'\]\n", done.stdout)
