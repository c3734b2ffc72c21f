"""A processor step of LeRobot: the chunk that is sent is one that the arm can follow.

Between policy and robot, in place of a clamp: each chunk `(batch, targets, joints)` becomes the
positions of the fastest certified motion through it, at the rate at which they are sent. It takes
over from the motion that runs, in its state.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from lerobot.processor import PolicyActionProcessorStep, ProcessorStepRegistry

import trajopt
from trajopt.chunks import take_over


@ProcessorStepRegistry.register("lawful_chunk")
@dataclass
class LawfulChunk(PolicyActionProcessorStep):
    velocity: list[float]  # rad/s, one per joint
    acceleration: list[float]  # rad/s²
    rate: float = 30.0  # targets per second
    tolerance: float = 0.005  # rad
    every: float = 0.5  # s of a motion that are sent before the next chunk takes over
    running: Any = field(default=None, repr=False)
    sent: int = 0  # positions of the running motion that were handed out

    def action(self, action: Any) -> Any:
        targets = np.asarray(action, dtype=float)[0]
        limits = trajopt.Limits(self.velocity, self.acceleration)
        asked = {"rate": self.rate, "tolerance": self.tolerance}
        if self.running is None:
            found = trajopt.from_samples(targets, limits, **asked).fastest()
        else:
            found = take_over(self.running, self.sent / self.rate, targets, limits, **asked)
        if found.motion is not None:  # else the running motion goes on: it ends at rest
            self.running, self.sent = found.motion, 0
        left = max(self.running.duration * self.rate - self.sent, 1)
        steps = self.sent + np.arange(1, int(np.ceil(left)) + 1)
        self.sent = int(min(self.sent + self.every * self.rate, steps[-1]))
        rows = self.running(np.minimum(steps / self.rate, self.running.duration))
        return torch.as_tensor(rows[None])

    def get_config(self) -> dict[str, Any]:
        names = ("velocity", "acceleration", "rate", "tolerance", "every")
        return {name: getattr(self, name) for name in names}

    def transform_features(self, features: Any) -> Any:
        return features
