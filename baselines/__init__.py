"""Reference methods, one file each, reusable alone."""
