"""Store trials: a sealed text per trial, `results.h5` for other tools, and the recheck.

In reading order:

- `fields`: every field of a trial, declared once;
- `own_breaks`: a trajectory joint by joint, as records state it;
- `document`: values, solutions and problems as JSON;
- `trial_text`: a trial as one sealed JSON text, and back;
- `atomic`: files that exist whole or not at all;
- `proofs`: a stored lower bound, proved again;
- `verdicts`: the verdict on a stored motion, computed here and kept in the user's cache;
- `layout`: groups and datasets of `results.h5`, by name;
- `results_file`: `results.h5`, written, read and compared with its texts;
- `folder`: the results folder, and the one reader of folders, `results.h5` and texts;
- `recheck`: all statements of a text, computed again.
"""
