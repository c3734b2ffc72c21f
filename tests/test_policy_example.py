"""The processor step of docs/examples/policy, with stand-ins for LeRobot and for torch."""

import importlib.util
import sys
import types
from pathlib import Path

import numpy as np
import pytest

from trajopt.benchmark.suites.chunks import targets

FILE = Path(__file__).parents[1] / "docs" / "examples" / "policy" / "lawful_chunk.py"
V, A, RATE = 2.0, 10.0, 30.0


@pytest.fixture
def step(monkeypatch):
    """The step of the example, for three joints."""
    lerobot = types.ModuleType("lerobot.processor")
    lerobot.PolicyActionProcessorStep = type("PolicyActionProcessorStep", (), {})
    register = staticmethod(lambda name: lambda own: own)
    lerobot.ProcessorStepRegistry = type("ProcessorStepRegistry", (), {"register": register})
    torch = types.ModuleType("torch")
    torch.as_tensor = np.asarray
    for name, module in {"lerobot.processor": lerobot, "torch": torch}.items():
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setitem(sys.modules, "lerobot", types.ModuleType("lerobot"))
    spec = importlib.util.spec_from_file_location("lawful_chunk", FILE)
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "lawful_chunk", module)
    spec.loader.exec_module(module)
    return module.LawfulChunk([V] * 3, [A] * 3, rate=RATE, every=0.2)


def test_chunks_of_an_episode_are_joined_in_motion(step):
    """Positions that are sent keep velocity and acceleration, also where a chunk takes over."""
    way = targets("noisy", 0, 24, 3)
    first = step.action(way[None])
    assert first.shape[2] == 3
    assert first[0, -1] == pytest.approx(way[-1], abs=1e-6)
    before, at = step.running, step.sent / RATE
    second = step.action(way[None, 12:] + 0.01)
    assert step.running(0.0) == pytest.approx(before(at), abs=1e-9)
    assert step.running(0.0, 1) == pytest.approx(before(at, 1), abs=1e-7)
    sent = np.vstack([before(np.arange(round(at * RATE) + 1) / RATE), second[0]])
    assert np.abs(np.diff(sent, axis=0)).max() * RATE <= V * (1 + 1e-9)
    assert np.abs(np.diff(sent, 2, axis=0)).max() * RATE**2 <= A * (1 + 1e-9)


def test_its_configuration_makes_it_again(step):
    assert type(step)(**step.get_config()).get_config() == step.get_config()
    assert step.transform_features({"a": 1}) == {"a": 1}
