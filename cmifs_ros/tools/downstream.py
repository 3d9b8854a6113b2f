# SPDX-License-Identifier: Apache-2.0

"""A downstream node: prints the selected state, whatever is selected at the time."""

import rclpy
from rclpy.executors import ExternalShutdownException
from sensor_msgs.msg import JointState


def on_selected_state(msg: JointState) -> None:
    state = dict(zip(msg.name, msg.position, strict=True))
    print(' '.join(f'{name}={value:g}' for name, value in state.items()), flush=True)


def main() -> None:
    try:
        rclpy.init()
        node = rclpy.create_node('downstream')
        node.create_subscription(JointState, 'selected_state', on_selected_state, 10)
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


if __name__ == '__main__':
    main()
