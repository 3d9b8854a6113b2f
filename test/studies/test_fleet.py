# SPDX-License-Identifier: Apache-2.0

import re
import socket
import threading

import pytest

pytest.importorskip('rosbags', reason='rosbags is not here')
from cmifs_ros.collect.bag import episodes_of_bag
from studies.speed.fleet import main
from studies.speed.fleet_bags import write_bag
from studies.speed.relay import Relay


def test_a_bag_has_the_size_that_was_asked_for(tmp_path):
    write_bag(tmp_path / 'bag', 3, episodes=4, steps=6, channels=5)
    found = episodes_of_bag(tmp_path / 'bag')
    assert [episode.states.shape for episode in found.episodes] == [(6, 5)] * 4
    assert not found.dropped
    again = episodes_of_bag(tmp_path / 'bag').episodes[2]
    assert (again.states == found.episodes[2].states).all()


def test_a_relay_passes_on_and_counts():
    server = socket.create_server(('127.0.0.1', 0))

    def answer():
        connection, _ = server.accept()
        with connection:
            connection.sendall(2 * connection.recv(100))

    thread = threading.Thread(target=answer)
    thread.start()
    with server, Relay(f'tcp://127.0.0.1:{server.getsockname()[1]}') as relay:
        host, port = relay.address.removeprefix('tcp://').split(':')
        with socket.create_connection((host, int(port))) as client:
            client.sendall(b'hello')
            received = b''
            while part := client.recv(100):
                received += part
        thread.join()
        assert received == b'hellohello'
        assert (relay.sent, relay.received) == (5, 10)


def test_one_process_and_a_cluster_select_the_same(capsys, tmp_path):
    pytest.importorskip('distributed', reason='distributed is not here')
    size = ['--bags', '2', '--episodes', '10', '--steps', '5', '--channels', '3']
    assert main([*size, '--workers', '1', '--writers', '1', '--folder', str(tmp_path)]) == 0
    here, there = re.findall(r'^\| 100 \|(.*)\|$', capsys.readouterr().out, re.M)
    here, there = ([cell.strip() for cell in row.split('|')] for row in (here, there))
    assert [row[1] for row in (here, there)] == ['one process', '1 worker']
    assert there[-1] == 'the same'
    assert list(tmp_path.iterdir()) == []
