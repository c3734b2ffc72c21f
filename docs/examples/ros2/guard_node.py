"""A ROS 2 node between a planner and a controller: it forwards only goals that keep the limits."""

import numpy as np
import rclpy
from control_msgs.action import FollowJointTrajectory
from guard import refusal
from rclpy.action import ActionClient, ActionServer, GoalResponse
from rclpy.node import Node
from rosidl_runtime_py import message_to_ordereddict

from trajopt import Limits

NAMES = ["joint1", "joint2"]
LIMITS = Limits(velocity=np.array([2.0, 2.5]), acceleration=np.array([5.0, 6.0]))


class Guard(Node):
    def __init__(self):
        super().__init__("guard")
        self.client = ActionClient(self, FollowJointTrajectory, "arm_controller/follow")
        self.server = ActionServer(
            self, FollowJointTrajectory, "guarded/follow", self.forward, goal_callback=self.judge
        )

    def judge(self, goal):
        why = refusal(message_to_ordereddict(goal), NAMES, LIMITS)
        if why:
            self.get_logger().error(f"refused: {why}")
        return GoalResponse.REJECT if why else GoalResponse.ACCEPT

    async def forward(self, handle):
        sent = await self.client.send_goal_async(handle.request)
        done = await sent.get_result_async()
        handle.succeed()
        return done.result


rclpy.init()
rclpy.spin(Guard())
