"""Check an archive of records: python check_all.py

The checksums of all files, and every lower bound in exact fractions (`check_proof.py`). It imports
the standard library only. Exit code 1 if anything does not hold.
"""

import hashlib
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

HERE = Path(__file__).resolve().parent


def changed(line):
    sums, _, name = line.partition("  ")
    file = HERE / name
    return not file.is_file() or hashlib.sha256(file.read_bytes()).hexdigest() != sums


def refused(record):
    """Return what the proof's check says, or an empty text where the bound holds."""
    command = [sys.executable, "-I", "-S", str(HERE / "check_proof.py")]
    with record.open("rb") as text:
        ran = subprocess.run(command, stdin=text, capture_output=True, text=True, check=False)
    return ran.returncode and (ran.stdout + ran.stderr).strip().splitlines()[-1]


lines = (HERE / "SHA256SUMS").read_text(encoding="utf-8").splitlines()
listed = {line.partition("  ")[2]: line for line in lines}
records = sorted((HERE / "records").glob("*.json"))
faults = [f"{name}: not the file of SHA256SUMS" for name, line in listed.items() if changed(line)]
found = [f"records/{record.name}" for record in records]
faults += [f"{name}: not in SHA256SUMS" for name in found if name not in listed]
with ThreadPoolExecutor(os.cpu_count()) as pool:
    for name, said in zip(found, pool.map(refused, records), strict=True):
        if said:
            faults.append(f"{name}: {said}")
for fault in faults:
    print(fault)
print(f"files: {len(lines)}; lower bounds: {len(records)}; faults: {len(faults)}")
sys.exit(bool(faults) or not records)
