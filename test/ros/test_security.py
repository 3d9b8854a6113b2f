# SPDX-License-Identifier: Apache-2.0

"""The SROS2 policy names what the nodes use: all of it, and nothing else."""

from pathlib import Path
from xml.etree import ElementTree

import pytest
from ament_index_python.packages import get_package_share_directory

#: What a policy calls it, and what rclpy's graph interface does.
KINDS = {
    ('topics', 'publish'): 'publisher',
    ('topics', 'subscribe'): 'subscriber',
    ('services', 'reply'): 'service',
    ('services', 'request'): 'client',
}


#: As the policy's comment says, it holds in any namespace.
NAMESPACE = '/robot1'


def allowed(node):
    """Return the names that the policy allows a node, by kind."""
    path = Path(get_package_share_directory('cmifs_ros'), 'config', 'sros2_policy.xml')
    (enclave,) = ElementTree.parse(path).findall(f"enclaves/enclave[@path='/cmifs_ros/{node}']")
    (profile,) = enclave.findall('profiles/profile')
    assert profile.attrib == {'ns': '/', 'node': node}
    names = {kind: [] for kind in KINDS.values()}
    for group in profile:
        for verb, verdict in group.attrib.items():
            assert verdict == 'ALLOW'
            names[KINDS[group.tag, verb]] += [
                name.text if name.text.startswith('/') else f'{NAMESPACE}/{name.text}'
                for name in group
            ]
    return {kind: sorted(found) for kind, found in names.items()}


@pytest.mark.parametrize('node', ['selector', 'simulator'])
def test_the_policy_allows_exactly_what_a_running_node_uses(start, robot, node):
    # With simulated time, a node subscribes to the clock too, and with an environment, the
    # simulator publishes actions.
    options = {}
    if node == 'simulator':
        pytest.importorskip('gymnasium', reason='gymnasium is not here')
        options = {'env': 'CartPole-v1'}
    start(f'{node}_node', '-r', f'__ns:={NAMESPACE}', use_sim_time=True, **options)

    def used():
        found = {}
        for kind in KINDS.values():
            ask = getattr(robot.node, f'get_{kind}_names_and_types_by_node')
            found[kind] = sorted(name for name, _ in ask(node, NAMESPACE))
        return found

    nodes = robot.node.get_node_names_and_namespaces
    robot.until(lambda: (node, NAMESPACE) in nodes() and used() == allowed(node))
    assert used() == allowed(node)
