"""Problems by name: files, robots, families, degenerate cases."""
