"""The general transcription of the problem on a grid, for IPOPT.

- `uniform.py`: equal intervals, and the NLP with equal or free intervals: `collocation`;
- `refined.py`: free intervals, halved until the error is small: `collocation-refined`.
"""
