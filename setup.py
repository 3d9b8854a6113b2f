# SPDX-License-Identifier: Apache-2.0

import sys
from glob import glob

from setuptools import find_packages, setup

package_name = 'cmifs_ros'

#: `ros2 run` finds these in lib/cmifs_ros. A wheel, which pip builds, puts its commands onto the
#: path, where others are called `watch` and `demo`: it has one command with subcommands.
EXECUTABLES = [
    'demo = cmifs_ros.tools.program:demo',
    'downstream = cmifs_ros.tools.program:downstream',
    'make_robot_file = cmifs_ros.tools.program:make_robot_file',
    'sampler_node = cmifs_ros.ros.run_node:sampler_node',
    'select_from_bag = cmifs_ros.tools.program:select_from_bag',
    'selector_node = cmifs_ros.ros.run_node:selector_node',
    'simulator_node = cmifs_ros.ros.run_node:simulator_node',
    'watch = cmifs_ros.tools.program:watch',
]
COMMAND = 'cmifs = cmifs_ros.tools.program:cmifs'
is_wheel = not {'bdist_wheel', 'dist_info', 'editable_wheel'}.isdisjoint(sys.argv)

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(include=[package_name, f'{package_name}.*']),
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
        (f'share/{package_name}/config', glob('config/*')),
        (f'share/{package_name}/launch', glob('launch/*.launch.xml')),
    ],
    python_requires='>=3.10',
    install_requires=[
        'setuptools',
        'numpy>=1.26',
        'scipy>=1.11',
        'numba>=0.59',
        'matplotlib',
        'tqdm',
        'joblib>=1.3',
        'pyyaml',
        'rich',
    ],
    extras_require={
        'bags': ['rosbags>=0.11,<0.12', 'mcap', 'zstandard'],
        'cluster': ['distributed', 'joblib>=1.4'],
        'images': ['pillow'],
        'peers': ['ennemi', 'scikit-learn', 'boruta', 'hidimstat'],
        'tables': ['pyarrow>=14', 'h5py', 'pyulog'],
        'tasks': ['gymnasium[mujoco]>=1.0', 'ir-sim'],
        'test': ['pytest', 'hypothesis', 'pexpect'],
        'threads': ['threadpoolctl'],
        'videos': ['av'],
    },
    zip_safe=True,
    maintainer='cmifs_ros maintainers',
    maintainer_email='maintainers@users.noreply.example.com',
    description="Selects the sensors that a robot's return depends on, live or from bags.",
    license='Apache-2.0',
    entry_points={'console_scripts': [COMMAND] if is_wheel else EXECUTABLES},
)
