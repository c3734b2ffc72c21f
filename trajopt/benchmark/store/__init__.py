"""What is kept: one file per trial, one consolidated `results.h5`; and whether it still holds.

`columns` declares what is stored, `schema` turns a trial into that and back, `trial_file` and
`results_file` lay it out, `hdf5` seals files and reads them without trust, `atomic` writes them
whole or not at all, `folder` is the index, `verification` computes everything again.

What each part is there for (two shared cores, 99 trials of six-axis, 770 kB):

- Two layouts: a trial is written alone, so that no other can be lost with it, in 4 ms of CPU and
  16 kB; laid out as `results.h5` is, the same trial takes 50 ms and 67 kB. `results.h5` in turn
  is read four times as fast as the trial files (1.3 ms a trial, not 5), and is what other
  programs read.
- The seal: with Fletcher-32 alone, which HDF5 itself offers, three of 1500 random corruptions
  passed as other numbers. SHA-256 of a file of 3000 trials (17 MB) takes 20 ms, reading them 1.7 s.
- Files made in memory: HDF5 2.0 may take the process down on a full disk. 3000 trials take 80 MB
  while they are written, as much as reading them does.
- Compression, of `results.h5` alone: see `test_a_thousand_trials_take_little_room`.
"""
