"""The best known answer of every problem of the suites: a motion that anyone can check.

In reading order: `record` (a record's file), `records` (where they are), `verification` (whether
one holds), `proposal` (better answers than the recorded ones), `surveyed` (records beside what the
references find).
"""
