"""A ROS 2 node between a planner and a controller: it forwards only goals that keep the limits."""

import numpy as np
import rclpy
from action_msgs.msg import GoalStatus
from control_msgs.action import FollowJointTrajectory
from guard import refusal
from rclpy.action import ActionClient, ActionServer, CancelResponse, GoalResponse
from rclpy.node import Node
from rosidl_runtime_py import message_to_ordereddict

from trajopt import Limits

NAMES = ["joint1", "joint2"]
LIMITS = Limits(velocity=np.array([2.0, 2.5]), acceleration=np.array([5.0, 6.0]))
CONTROLLER = "joint_trajectory_controller/follow_joint_trajectory"


class Guard(Node):
    def __init__(self):
        super().__init__("guard")
        self.running = {}  # the controller's goals by the identifiers of ours
        self.client = ActionClient(self, FollowJointTrajectory, CONTROLLER)
        self.server = ActionServer(
            self,
            FollowJointTrajectory,
            "guarded/follow_joint_trajectory",
            self.forward,
            goal_callback=self.judge,
            cancel_callback=self.cancel,
        )

    def judge(self, goal):
        why = refusal(message_to_ordereddict(goal), NAMES, LIMITS)
        if why:
            self.get_logger().error(f"refused: {why}")
        return GoalResponse.REJECT if why else GoalResponse.ACCEPT

    def cancel(self, handle):
        sent = self.running.get(bytes(handle.goal_id.uuid))
        if sent:
            sent.cancel_goal_async()
        return CancelResponse.ACCEPT

    async def forward(self, handle):
        sent = await self.client.send_goal_async(handle.request)
        if not sent.accepted:
            self.get_logger().error("the controller rejected the goal")
            handle.abort()
            return FollowJointTrajectory.Result(
                error_code=FollowJointTrajectory.Result.INVALID_GOAL
            )
        identifier = bytes(handle.goal_id.uuid)
        self.running[identifier] = sent
        if handle.is_cancel_requested:  # before the controller had it
            sent.cancel_goal_async()
        done = await sent.get_result_async()
        del self.running[identifier]
        if done.status == GoalStatus.STATUS_SUCCEEDED:
            handle.succeed()
        elif done.status == GoalStatus.STATUS_CANCELED and handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.abort()
        return done.result


rclpy.init()
rclpy.spin(Guard())
