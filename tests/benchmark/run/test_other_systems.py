"""A system without Unix's modules runs trials in its own process."""

import subprocess
import sys

SCRIPT = """
import sys
sys.modules["fcntl"] = sys.modules["resource"] = None
from trajopt import compare
results = compare(["one-joint"], ["unoptimised"], sys.argv[1], jobs=0, fresh_reference=True)
print(*results.trials()["status"])
"""


def test_a_comparison_needs_no_module_of_unix(tmp_path):
    command = [sys.executable, "-c", SCRIPT, str(tmp_path)]
    found = subprocess.run(command, capture_output=True, text=True, check=True)
    assert found.stdout.split() == ["solved", "solved"]
