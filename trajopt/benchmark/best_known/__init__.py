"""The best known answer of every problem of the suites: a motion that anyone can check.

In reading order:

- `records`: a record, its file, and its check;
- `proposal`: better answers than the recorded ones;
- `surveyed`: the records compared with what the references find.
"""
