"""What is kept: one file per trial, one consolidated `results.h5`; and whether it still holds.

`columns` declares what is stored, `schema` turns a trial into that and back, `trial_file` and
`results_file` lay it out, `draft` makes HDF5 files in memory, `hdf5` reads them without trust,
`seal` says whether they are damaged, `atomic` writes them whole or not at all, `folder` is the
index, `verification` computes everything again.

What each part is there for (two shared cores, 99 trials of six-axis, 770 kB):

- Two layouts: a trial is written alone, so that no other can be lost with it, in 1.5 ms of CPU and
  16 kB; laid out as `results.h5` is, the same trial takes 15 ms and 68 kB. `results.h5` in turn
  is read three times as fast as the trial files (0.7 ms a trial, not 2), and is what other
  programs read.
- HDF5's own calls: h5py's `Group` and `Dataset` take three times as long to write a trial, and
  twice as long to read it.
- The seal: with Fletcher-32 alone, which HDF5 itself offers, three of 1500 random corruptions
  passed as other numbers. SHA-256 of a file of 3000 trials (17 MB) takes 20 ms, reading them 1.7 s.
- Files made in memory: HDF5 2.0 may take the process down on a full disk. 3000 trials take 80 MB
  while they are written, as much as reading them does.
- Compression, of `results.h5` alone: see `test_a_thousand_trials_take_little_room`.
"""
