"""The best known answer of every problem of the suites: a motion that anyone can check."""
