"""What does the check of stored proofs make of forged ones?

    python -m experiments.forgeries             # 585 forgeries, a few seconds
    python -m experiments.forgeries --script    # a minute: check_proof.py is asked too

Every forgery is a record of a built-in problem whose proof claims three times the best known
duration. *Proved* is what the check makes of it, in percent above the best known duration: more
than 0 is a false bound; what it refuses has none, and *refused* says why. The table goes to
`forgeries.csv` and `.md` in `--output`. Exit code 1 if a forgery is believed.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import cyclopts
import pandas as pd

from experiments.common.forgeries import PROBLEMS, Forgery, forgeries
from experiments.common.output import save_table
from trajopt.benchmark.best_known.record import parsed
from trajopt.benchmark.best_known.verification import proved
from trajopt.core.exceptions import TrajoptError

SCRIPT = Path(__file__).parents[1] / "docs" / "examples" / "best-known" / "check_proof.py"
BELIEVED_ABOVE = 1e-9  # of the best known duration, which is certified to so much


def judged(forgery: Forgery) -> dict[str, object]:
    """What a forgery proves, percent above the best known duration, or why it is refused."""
    bound = None
    refused = ""
    try:
        bound = proved(parsed(forgery.text))
    except TrajoptError as error:
        refused = str(error)
    above = None if bound is None else 100 * (bound / forgery.duration - 1)
    return {"forgery": forgery.name, "proved %": above, "refused": refused}


def confirmed(forgery: Forgery) -> bool:
    """Whether the independent script believes it."""
    command = [sys.executable, "-I", str(SCRIPT)]
    ran = subprocess.run(command, input=forgery.text, text=True, capture_output=True, check=False)
    return ran.returncode == 0


def believed(rows: pd.DataFrame) -> pd.DataFrame:
    """Those that prove more than is true."""
    return rows[rows["proved %"] > 100 * BELIEVED_ABOVE]


def main(*, script: bool = False, output: Path = Path("results/forgeries")) -> None:
    """Check every forgery, write the table and print it.

    Args:
        script: Ask docs/examples/best-known/check_proof.py too.
        output: Folder of the table.
    """
    attempts = [forgery for problem in PROBLEMS for forgery in forgeries(problem)]
    rows = pd.DataFrame([judged(forgery) for forgery in attempts])
    save_table(rows, output / "forgeries")
    print(rows.to_string(index=False, na_rep="", max_colwidth=70, float_format="{:.3g}".format))
    false = believed(rows)
    print(f"{len(rows)} forgeries: {len(false)} believed, {(rows['refused'] != '').sum()} refused")
    by_script = [forgery.name for forgery in attempts if script and confirmed(forgery)]
    if script:
        print(f"{SCRIPT.name} confirms {len(by_script)}: {'; '.join(by_script)}")
    if len(false) or by_script:
        sys.exit(1)


if __name__ == "__main__":
    cyclopts.run(main)
