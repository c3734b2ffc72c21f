"""The general transcription of the problem on a grid, for IPOPT; it names no kind of limit.

- `symbols.py`: polynomials on all intervals, which take part in NumPy's arithmetic;
- `asked.py`: what limits ask, by their rows: boxes, and constraints on Bernstein coefficients;
- `uniform.py`: equal intervals, and the NLP with equal or free intervals: `collocation`;
- `refined.py`: free intervals, halved until the error is small: `collocation-refined`.
"""
